"""Published file formats of recordings that others made, one loader each; a loader looks at the content, not at a name.

Source  docs/measured_parts.md
"""
