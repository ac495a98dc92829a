"""Quick reference and troubleshooting: commands, options and keys exist; messages are those that the sources print."""

import ast
import re
from pathlib import Path

import typer.main

from testbench.commands.main import app
from testbench.config import Config

ROOT = Path(__file__).resolve().parents[1]
QUICK = (ROOT / "docs" / "quick_reference.md").read_text()
TROUBLE = (ROOT / "docs" / "troubleshooting.md").read_text()
PACKAGES = ("fpga_model", "analog_frontend", "testbench")


def leaves(command, path=()):
    """{words of a command: command} of all that do something."""
    if not hasattr(command, "commands"):
        return {path: command}
    return {k: v for name, part in command.commands.items() for k, v in leaves(part, (*path, name)).items()}


COMMANDS = leaves(typer.main.get_command(app))


def test_every_command_is_there_and_every_option_exists():
    lines = re.findall(r"^    gyro (.*?)(?: {2,}.*)?$", QUICK, re.M)
    assert len(lines) > 25
    for line in lines:
        words = line.replace(",", "").split()
        path = next(p for p in COMMANDS if p == tuple(words[: len(p)]))
        known = {option for parameter in COMMANDS[path].params for option in parameter.opts}
        assert {word for word in words if word.startswith("-")} <= known, line
    for path in COMMANDS:
        assert re.search(rf"\b{re.escape(path[-1])}\b", QUICK), path


def test_every_key_exists():
    keys = re.findall(r"`((?:plant|nominal|firmware|scenario|output|effects)\.\w+)`", QUICK + TROUBLE)
    assert len(keys) > 12
    for key in keys:
        section, name = key.split(".")
        assert name in Config.model_fields[section].annotation.model_fields, key


def texts():
    """Texts of the sources, a value in them as a line break."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.JoinedStr):
                    yield "".join(str(v.value) if isinstance(v, ast.Constant) else "\n" for v in node.values)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def test_messages_are_printed_by_the_sources():
    entries = re.findall(r"^- (.*?):(?= |$)", TROUBLE, re.M)
    quoted = [phrase for entry in entries for phrase in re.findall(r"\*\*`([^`]* [^`]*)`", entry)]
    assert len(quoted) > 50
    printed = "\0".join(texts())
    for phrase in quoted:
        for part in re.split(r" ?\.\.\. ?|NAME", phrase):
            assert part.strip() in printed, phrase
