"""Errors that are the user's to mend: each is one line, and the command line prints it without a traceback."""

LONGEST = 1000  # characters of a line


def one_line(text):
    """Text without line breaks; of a very long one, its beginning and its end."""
    text = " ".join(str(text).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 200]} ... {text[-190:]}"


class ConfigError(ValueError):
    """A configuration that cannot be: what, where, value, limit, unit."""

    def __init__(self, text):
        super().__init__(one_line(text))


class FileError(Exception):
    """A file that cannot be read or written: which, and what is wrong with it."""

    def __init__(self, text):
        super().__init__(one_line(text))
