"""How-to guides: numbered steps without a gap, commands that exist, files that exist."""

import re
import shlex
from pathlib import Path

import pytest
import typer.main

from testbench.commands.main import app

ROOT = Path(__file__).resolve().parents[1]
GUIDES = sorted((ROOT / "docs" / "how_to").glob("*.md"))
by_guide = pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)


def commands(guide):
    """Lines of the indented blocks."""
    return re.findall(r"^ {8}(\S.*)$", guide.read_text(), re.M)


def test_there_is_a_guide_for_everything_that_plugs_in():
    assert [path.stem for path in GUIDES] == [
        "add_a_block",
        "add_a_part",
        "add_an_effect",
        "add_an_engine",
        "release",
        "use_it_elsewhere",
        "write_a_plan",
    ]
    index = (ROOT / "docs" / "README.md").read_text()
    assert all(f"](how_to/{path.name})" in index for path in GUIDES)


@by_guide
def test_steps_are_numbered_without_a_gap(guide):
    for part in guide.read_text().split("\n## "):
        numbers = [int(number) for number in re.findall(r"^(\d+)\. ", part, re.M)]
        assert numbers == list(range(1, len(numbers) + 1))
    assert commands(guide)


@by_guide
def test_commands_exist_with_their_options(guide):
    for line in commands(guide):
        words = shlex.split(line)
        if words[0] == "gyro":
            command, rest = typer.main.get_command(app), words[1:]
            while hasattr(command, "commands"):
                assert rest[0] in command.commands, line
                command, rest = command.commands[rest[0]], rest[1:]
            known = {option for parameter in command.params for option in parameter.opts}
            assert {word for word in rest if word.startswith("-")} <= known, line
        elif words[0] == "pytest":
            files = [word for word in words if word.startswith("tests/") and "NAME" not in word]
            assert all((ROOT / name).is_file() for name in files), line
        elif words[:3] == ["python", "-m", "build"]:
            continue
        elif words[:2] == ["python", "-m"]:
            assert (ROOT / (words[2].replace(".", "/") + ".py")).is_file(), line
        elif words[0] == "python":
            assert (ROOT / words[1]).is_file(), line
        else:
            assert words[0] in ("make", "towncrier"), line


@by_guide
def test_a_file_of_a_name_goes_into_a_folder_that_exists(guide):
    for folder in re.findall(r"`([\w/]+)/[\w]*<NAME>[\w.]*`", guide.read_text()):
        assert (ROOT / folder).is_dir(), folder
