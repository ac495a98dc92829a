"""Errors that are the user's to mend: each is one line, and the command line prints it without a traceback."""


class ConfigError(ValueError):
    """A configuration that cannot be: what, where, value, limit, unit."""

    def __init__(self, text):
        super().__init__(" ".join(str(text).split()))


class FileError(Exception):
    """A file that cannot be read or written: which, and what is wrong with it."""

    def __init__(self, text):
        super().__init__(" ".join(str(text).split()))
