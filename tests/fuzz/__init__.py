"""Fuzzers for everything that a user can hand over: files of every kind, and options of the command line.

    python -m tests.fuzz --minutes 20            all kinds, counts by kind; exit code 1 if there is a finding
    python -m tests.fuzz --kind vcd --seed 1234  one kind from one seed on: how a finding is repeated

    corpus    small valid files, made by the tests      hostile   values, and changes of bytes, texts and trees
    kinds     one function per kind of file             commands  options of every command
    worker    many inputs in one process                __main__  processes, limits, counts
A finding is an exception other than FileError, ConfigError and usage errors, another exit code than 0, 1, 2, more than
20 s, or more than 1 GB.
"""
