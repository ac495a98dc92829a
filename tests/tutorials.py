"""Tutorials as a reader does them: files are written, commands are run in one folder, and outputs are compared.

    <!-- file: NAME -->     the code block behind it is the file NAME
    ```console              lines that begin with "$ " are commands, the others what they print, errors included
    ...                     in an output: any text within a line, or any lines if it stands alone

`python -m tests.tutorials PAGE` prints what the commands print now.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
STEP = re.compile(
    r"<!-- file: (?P<name>\S+) -->\s*```\w*\n(?P<text>.*?)```$|```console\n(?P<session>.*?)```$", re.M | re.S
)
COLUMNS = 120
TIMEOUT_S = 300


class Command(NamedTuple):
    """A command of a page, the line on which it stands, and what the page says that it prints."""

    line: int
    text: str
    expected: str


class Different(AssertionError):
    """A command prints something else than its page says."""


def steps(page):
    """(name, text) of files and `Command`s of a page, in order."""
    source = Path(page).read_text()
    for found in STEP.finditer(source):
        if found["name"]:
            yield found["name"], found["text"]
            continue
        line = source.count("\n", 0, found.start("session")) + 1
        command, output = None, []
        for text in [*found["session"].splitlines(), "$ "]:
            if text.startswith("$ "):
                if command:
                    yield Command(*command, "\n".join(output))
                command, output = (line, text[2:]), []
            else:
                output.append(text)
            line += 1


def environment():
    """Of a reader whose window has COLUMNS characters: the commands of this Python are found first."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    kept = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    return {**kept, "PATH": path, "COLUMNS": str(COLUMNS), "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}


def printed(command, folder):
    """What a command prints, without spaces at the ends of lines."""
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, env=environment(), timeout=TIMEOUT_S, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip("\n")


def agrees(expected, output):
    """Whether an output is the expected one, `...` being any text within a line, or any lines."""
    lines = []
    for line in expected.strip("\n").splitlines():
        if line.strip() == "...":
            lines.append(r"(?:.*\n)*?")
        else:
            lines.append(r"[^\n]*?".join(re.escape(part) for part in line.rstrip().split("...")) + r"\n")
    return re.fullmatch("".join(lines), output + "\n" if output else "") is not None


def follow(page, folder):
    """Do all that a page says in a folder; raises `Different` at the first output that is another one."""
    for step in steps(page):
        if not isinstance(step, Command):
            name, text = step
            (Path(folder) / name).write_text(text)
            continue
        output = printed(step.text, folder)
        if not agrees(step.expected, output):
            raise Different(f"{page}:{step.line}: $ {step.text}\nthe page says\n{step.expected}\nit prints\n{output}")


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        for one in steps(sys.argv[1]):
            if isinstance(one, Command):
                print(f"$ {one.text}\n{printed(one.text, place)}", flush=True)
            else:
                (Path(place) / one[0]).write_text(one[1])
