"""What no file may get imported: the values of `hostile` name it, and `watch` finds whoever imports it."""

OBJECT = None
