"""Every file that somebody hands over is opened here: regular files only, of a limited size, one line for each error.

    open_input  binary file object        read_bytes, read_text   contents
    head        first bytes               read_lines              (number, line)
    read_json   checked against a type    read_toml               a dictionary
    explain_damage  what a library raises inside becomes one FileError

A FIFO, a device or a directory is refused before anything is read, so that nothing waits and nothing is endless. Limits
hold before reading; what expands (archives, HDF5, Parquet) is limited by `expansion` before it is unpacked.
`GYRO_INPUT_MB` sets another limit than `MOST_BYTES`, for files that are meant to be larger.
Source  docs/inputs.md
"""

import contextlib
import functools
import hashlib
import io
import json
import os
import stat
import tomllib
from pathlib import Path

from testbench.errors import ConfigError, FileError

MOST_BYTES = 1 << 28  # of a file that is read as a whole
MOST_TEXT_BYTES = 1 << 24  # of a JSON or TOML text
MOST_TABLE_BYTES = 1 << 25  # of a table of numbers in text
LONGEST_LINE = 1 << 16  # characters
MOST_EXPANSION = 50  # bytes unpacked for each byte of a file, beyond MOST_BYTES


def most_bytes():
    """Largest file (bytes) that is read as a whole."""
    text = os.environ.get("GYRO_INPUT_MB", "")
    if not text:
        return MOST_BYTES
    try:
        limit_bytes = float(text) * 1e6
    except ValueError:
        limit_bytes = -1.0
    if not 1e6 <= limit_bytes <= 1e15:
        raise ConfigError(f"GYRO_INPUT_MB: {text!r} is outside 1 .. 1e9 MB")
    return int(limit_bytes)


@contextlib.contextmanager
def open_input(path, limit=None, error=FileError):
    """Binary file object of a regular file.

    limit  largest size (bytes); None: any size, for readers that take pieces
    error  class of what is raised: FileError, or ConfigError for a configuration
    """
    try:
        # without O_NONBLOCK to open a FIFO waits for a writer
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0))
    except (OSError, ValueError) as problem:
        raise error(f"{path}: cannot be read: {getattr(problem, 'strerror', None) or problem}") from None
    file_stat = os.fstat(handle)
    if not stat.S_ISREG(file_stat.st_mode):
        os.close(handle)
        raise error(f"{path}: is not a regular file")
    with open(handle, "rb") as file:
        if limit is not None and file_stat.st_size > limit:
            raise error(f"{path}: {file_stat.st_size} bytes are more than the limit of {limit} (GYRO_INPUT_MB)")
        try:
            yield file
        except OSError as problem:
            raise error(f"{path}: cannot be read: {problem.strerror or problem}") from None


def read_bytes(path, limit=None, error=FileError):
    """Contents of a regular file of at most `limit` bytes (None: `most_bytes`)."""
    with open_input(path, most_bytes() if limit is None else limit, error) as file:
        return file.read()


def read_text(path, limit=None, encoding="utf-8", error=FileError):
    """Contents as text; other bytes than those of the encoding are an error with their place."""
    data = read_bytes(path, limit, error)
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as problem:
        raise error(f"{path}: is not {encoding.upper()} text (byte {problem.start})") from None


def head(path, count):
    """The first bytes of a regular file, at most `count`."""
    with open_input(path) as file:
        return file.read(count)


def file_sha256(path):
    """SHA-256 of a regular file, hexadecimal."""
    with open_input(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_lines(path, encoding="utf-8", errors="strict"):
    """Yield (number, line) of a table in text; a line that is too long is an error with its number."""
    text = read_bytes(path, MOST_TABLE_BYTES)
    try:
        text = text.decode(encoding, errors)
    except UnicodeDecodeError as problem:
        number = text.count(b"\n", 0, problem.start) + 1
        raise FileError(f"{path}: line {number}: is not {encoding.upper()} text") from None
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        if len(line) > LONGEST_LINE:
            raise FileError(f"{path}: line {number}: {len(line)} characters are more than the limit of {LONGEST_LINE}")
        yield number, line


@contextlib.contextmanager
def explain_damage(source_name, what, error=FileError):
    """What a library raises about damaged input becomes one line: PLACE: is no WHAT that can be read: REASON.

    Only calls of libraries belong inside: an error of our own would be taken for damage.
    """
    try:
        yield
    except (ConfigError, FileError):
        raise
    except (Exception, RecursionError, MemoryError) as problem:
        reason = str(problem) or type(problem).__name__
        raise error(f"{source_name}: is not a readable {what}: {reason[:200]}") from None


def most_expansion(packed):
    """Most bytes that a file of `packed` bytes may unpack to."""
    return max(most_bytes(), MOST_EXPANSION * packed)


def expansion(source_name, expanded, packed):
    """FileError if `packed` bytes would become `expanded` bytes beyond what is allowed."""
    limit = most_expansion(packed)
    if expanded > limit:
        raise FileError(f"{source_name}: {expanded} bytes unpacked are more than the limit of {limit} (GYRO_INPUT_MB)")


@functools.cache
def _adapter(kind):
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def validate_data(data, kind, source_name, error=FileError):
    """A value of the type `kind` (anything that pydantic takes) from plain data; the first mismatch is the error."""
    from pydantic import ValidationError

    try:
        return _adapter(kind).validate_python(data)
    except ValidationError as problem:
        first = problem.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "content"
        raise error(f"{source_name}: {key}: {first['msg']}") from None
    except RecursionError:
        raise error(f"{source_name}: is nested too deep") from None


def parse_json(text, source_name, kind=dict, error=FileError):
    """JSON text (or bytes) as a value of the type `kind`."""
    with explain_damage(source_name, "JSON text", error):
        data = json.loads(text)
    return validate_data(data, kind, source_name, error)


def read_json(path, kind=dict, limit=MOST_TEXT_BYTES, error=FileError):
    """JSON file as a value of the type `kind`."""
    return parse_json(read_text(path, limit, error=error), path, kind, error)


def parse_toml(text, source_name, error=ConfigError):
    """TOML text as a dictionary."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise error(f"{source_name}: is not TOML: {str(problem)[:200]}") from None


def read_toml(path, limit=MOST_TEXT_BYTES, error=ConfigError):
    """TOML file as a dictionary."""
    path = Path(path)
    return parse_toml(read_text(path, limit, error=error), path, error)
