"""Standard streams of a command: closed, full, without a reader, or of an encoding that lacks a character.

    reader gone (a pipe into `head`)   the rest is thrown away; the command ends as it would have
    device full                        FileError, one line
    closed                             standard output: FileError before any work; the others: as the null device
    character outside the encoding     a question mark
Source  docs/configuration.md
"""

import errno
import io
import os
import sys

from testbench.errors import FileError


class Stream(io.FileIO):
    """Descriptor 1 or 2: it fails once at most, standard error never, and neither because nobody reads."""

    def __init__(self, descriptor):
        super().__init__(descriptor, "w", closefd=False)
        self._lost = False

    def write(self, data):
        if not self._lost:
            try:
                return super().write(data)
            except OSError as problem:
                self._lost = True
                if problem.errno != errno.EPIPE and self.fileno() == 1:
                    raise FileError(f"standard output: cannot be written: {problem.strerror}") from None
        return len(data)


def _wrap_stream(stream, descriptor):
    """A text stream on the same descriptor; interactive ones write line by line."""
    raw = io.BufferedWriter(Stream(descriptor))
    text_options = {"encoding": stream.encoding, "errors": "replace", "newline": None}
    return io.TextIOWrapper(raw, line_buffering=stream.isatty() or descriptor == 2, **text_options)


def settle():
    """Give this process streams as above; FileError if standard output is closed."""
    closed = sys.stdout is None
    while (null_descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass  # a closed descriptor would be the next file's, and a child would write into it
    os.close(null_descriptor)
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)
    if closed:
        sys.stdout = open(1, "w", closefd=False)
        raise FileError("standard output: is closed")
    if os.name == "posix":
        sys.stdout = _wrap_stream(sys.stdout, 1)
        sys.stderr = _wrap_stream(sys.stderr, 2)
