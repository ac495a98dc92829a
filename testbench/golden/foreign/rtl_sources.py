"""Source files of a design: those of a block in a folder, or those of a list (`.f`), with folders, macros, libraries.

    a/b.sv, b.vhd           a file                    +incdir+DIR, -IDIR         a folder of included files
    +define+N[=V], -DN[=V]  a macro                   -work LIB, --work=LIB      library of the VHDL files behind it
    -f FILE, -F FILE        another list              // # --                    a comment to the end of the line

Every path of a list is seen from the folder of the list. Its order is that of the compilation.
Source  docs/foreign_designs.md
"""

import os
import re
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError
from testbench.golden.bundles.benches import PARTS
from testbench.storage.inputs import read_lines

VERILOG, VHDL = (".v", ".sv"), (".vhd", ".vhdl")
HEADERS = (".vh", ".svh", ".h")
MOST_LISTS = 16  # one within the other
NAME = re.compile(r"[A-Za-z]\w*")


class Sources(NamedTuple):
    """Files in the order of compilation, with the library of each ('' if none is named), include folders, macros."""

    files: tuple
    libraries: tuple
    includes: tuple = ()
    defines: tuple = ()

    @property
    def language(self):
        """verilog or vhdl: that of the last file."""
        return "vhdl" if self.files[-1].suffix in VHDL else "verilog"


def folder_sources(rtl, stem):
    """Sources of a block in a folder, the blocks within it first; FileError where there is none."""
    rtl = Path(rtl)
    if not rtl.is_dir():
        raise FileError(f"{rtl}: not a folder")
    existing_suffixes = [suffix for suffix in (*VERILOG, *VHDL) if (rtl / f"{stem}{suffix}").is_file()]
    return [_suffix_sources(rtl, stem, suffix) for suffix in existing_suffixes]


def _suffix_sources(rtl, stem, suffix):
    language_suffixes = VHDL if suffix in VHDL else VERILOG
    parts = [rtl / f"{part}{part_suffix}" for part in PARTS.get(stem, ()) for part_suffix in language_suffixes]
    files = tuple(path.resolve() for path in (*parts, rtl / f"{stem}{suffix}") if path.is_file())
    return Sources(files, ("",) * len(files), tuple(dict.fromkeys(path.parent for path in files)))


class _Lists:
    """What the lists have given so far."""

    def __init__(self):
        self.files, self.includes, self.defines, self.library = [], [], [], ""

    def read(self, path, enclosing_lists=()):
        path = Path(path)
        if path.resolve() in enclosing_lists:
            raise FileError(f"{path}: the list names itself")
        if len(enclosing_lists) == MOST_LISTS:
            raise FileError(f"{path}: lists are nested more than {MOST_LISTS} deep")
        for number, line in read_lines(path):
            words = re.sub(r"(^|\s)(//|#|--\s|--$).*", "", line).split()
            while words:
                self.word(words, path, f"{path}: line {number}", (*enclosing_lists, path.resolve()))

    def word(self, words, path, where, enclosing_lists):
        word = words.pop(0)
        if word in ("-f", "-F", "-work", "-I", "-D") and not words:
            raise FileError(f"{where}: {word} needs a value")
        if word in ("-f", "-F"):
            self.read(self.resolve_path(words.pop(0), path, where), enclosing_lists)
        elif word == "-work" or word.startswith("--work="):
            self.library = words.pop(0) if word == "-work" else word.partition("=")[2]
            if not NAME.fullmatch(self.library):
                raise FileError(f"{where}: {self.library!r} is not a valid library name")
        elif word.startswith(("+incdir+", "-I")):
            include_folders = word.split("+")[2:] if word[0] == "+" else [word[2:] or words.pop(0)]
            self.includes += [self.resolve_path(name, path, where, folder=True) for name in include_folders]
        elif word.startswith(("+define+", "-D")):
            self.defines += word.split("+")[2:] if word[0] == "+" else [word[2:] or words.pop(0)]
        elif word[0] in "+-":
            raise FileError(f"{where}: {word} is none of +incdir+, +define+, -I, -D, -work, -f")
        else:
            source_path = self.resolve_path(word, path, where)
            if source_path.suffix in HEADERS:
                self.includes.append(source_path.parent)
            elif source_path.suffix in (*VERILOG, *VHDL):
                self.files.append((source_path, self.library))
            else:
                raise FileError(f"{where}: {word} does not end in {', '.join((*VERILOG, *VHDL, *HEADERS))}")

    def resolve_path(self, name, path, where, folder=False):
        expanded_path = path.parent / os.path.expandvars(name)
        if not (expanded_path.is_dir() if folder else expanded_path.is_file()):
            raise FileError(f"{where}: no {'folder' if folder else 'file'} {expanded_path}")
        return expanded_path.resolve()


def read_source_list(path):
    """Sources of a list; FileError names the list, the line and what is wrong with it."""
    lists = _Lists()
    lists.read(path)
    if not lists.files:
        raise FileError(f"{path}: names no source file")
    files, libraries = zip(*dict.fromkeys(lists.files))
    kinds = {path.suffix in VHDL for path in files}
    if len(kinds) > 1:
        raise FileError(f"{path}: Verilog and VHDL in one list: no simulator here reads both")
    includes = dict.fromkeys([*lists.includes, *(file.parent for file in files)])
    return Sources(files, libraries, tuple(includes), tuple(dict.fromkeys(lists.defines)))
