"""VCD dumps of simulators: changes of some signals, read in pieces; strict: anything unforeseen is an error.

    read(path, choose)   {identifier: (times, texts)} of the signals that `choose` takes from the header

Errors  FileError: not VCD, a time that falls, a value or a section that is none
Source  IEEE 1364-2005, section 18.2
"""

import re

from testbench.errors import FileError
from testbench.storage.inputs import open_input

BLOCK_BYTES = 1 << 20
MOST_HEADER = 1 << 26  # bytes
LONGEST_WORD = 1 << 16  # characters
MOST_TIME = 1 << 62
RANGE = re.compile(r"\s*\[\d+(?::\d+)?\]$")
VALUES = frozenset("01xXzZuUwWlLhH-")
LONG_VALUES = frozenset("bBrRsS")


def _split_words(path, file):
    """Words of the rest of a file."""
    partial_word = b""
    while block := file.read(BLOCK_BYTES):
        words = (partial_word + block).split()
        partial_word = words.pop() if words and not block[-1:].isspace() else b""
        if len(partial_word) > LONGEST_WORD:
            raise FileError(f"{path}: a word has more than {LONGEST_WORD} characters")
        yield from words
    if partial_word:
        yield partial_word


def _texts(path, file):
    """Words as text; `header` and `changes` share the generator."""
    for word in _split_words(path, file):
        try:
            yield word.decode("ascii")
        except UnicodeDecodeError:
            raise FileError(f"{path}: is not a VCD file: {word[:20]!r} is not ASCII") from None


def _section(path, token, words):
    """Words of a section up to its $end."""
    section_words = []
    for word in words:
        if word == "$end":
            return section_words
        section_words.append(word)
    raise FileError(f"{path}: header: section {token} has no $end")


def _parse_variable(words):
    """(name, identifier, width, kind) of a $var."""
    # one bit of an array is a signal of its own; a range is only how the signal was declared
    name = re.sub(r" (\[[^ ]*\])$", r"\1", " ".join(words[3:]))
    width = int(words[1])
    if width > 1 or ":" in name.rpartition("[")[2]:
        name = RANGE.sub("", name)
    return name, words[2], width, words[0]


def _header(path, words):
    """[(path of a signal, (identifier, width, kind))]."""
    scopes, header_signals, size = [], [], 0
    for token in words:
        if not token.startswith("$"):
            raise FileError(f"{path}: is not a VCD file: no $enddefinitions before {token[:40]!r}")
        section_words = _section(path, token, words)
        size += sum(map(len, section_words)) + len(token)
        if size > MOST_HEADER:
            raise FileError(f"{path}: the header is longer than {MOST_HEADER} characters")
        if token == "$enddefinitions":
            return header_signals
        if token == "$scope" and len(section_words) == 2:
            scopes.append(section_words[1])
        elif token == "$upscope" and scopes:
            scopes.pop()
        elif token == "$var" and len(section_words) >= 4 and re.fullmatch(r"\d{1,9}", section_words[1]):
            name, *variable_attributes = _parse_variable(section_words)
            header_signals.append((".".join([*scopes, name]), tuple(variable_attributes)))
        elif token in ("$scope", "$upscope", "$var"):
            raise FileError(f"{path}: header: malformed {token} {' '.join(section_words)[:40]}")
    raise FileError(f"{path}: is not a VCD file: no $enddefinitions")


def read(path, choose):
    """{identifier: (times, texts)} of the signals that are wanted.

    choose  function of [(path, (identifier, width, kind))] that gives the identifiers
    """
    with open_input(path) as file:
        words = _texts(path, file)
        identifiers = choose(_header(path, words))
        return _changes(path, words, {identifier: ([], []) for identifier in identifiers})


def _later(path, word, time):
    if not re.fullmatch(r"#\d{1,19}", word) or not time <= int(word[1:]) < MOST_TIME:
        raise FileError(f"{path}: time {word[:40]} after #{time} is malformed or earlier")
    return int(word[1:])


def _changes(path, words, changes_by_identifier):
    time = 0
    for word in words:
        first = word[0]
        if first == "#":
            time = _later(path, word, time)
        elif first in LONG_VALUES:
            name = next(words, None)
            if name is None:
                raise FileError(f"{path}: the file ends inside a value")
            if len(word) < 2:
                raise FileError(f"{path}: {word} {name[:40]} at #{time} is a value without bits")
            if name in changes_by_identifier and first in "bB":
                changes_by_identifier[name][0].append(time)
                changes_by_identifier[name][1].append(word[1:])
        elif first in VALUES:
            if word[1:] in changes_by_identifier:
                changes_by_identifier[word[1:]][0].append(time)
                changes_by_identifier[word[1:]][1].append(first)
        elif word == "$comment":
            for other in words:
                if other == "$end":
                    break
        elif first != "$":
            raise FileError(f"{path}: {word[:40]!r} at #{time} is not a VCD value")
    return changes_by_identifier
