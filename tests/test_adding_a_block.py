"""A block is added to a copy of the tree as docs/how_to/add_a_block.md says: seven files, and it is all there."""

import filecmp
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

ROOT = Path(__file__).resolve().parents[1]
TREE = ("fpga_model", "analog_frontend", "testbench", "tests", "docs")
MOST_FILES = 7
NEW = {
    "fpga_model/beat.py": '''"""Beat: a level that changes every `ticks` strobes, for a lamp.

    ce    left' = left - 1, or ticks - 1 and level' = 1 - level where left = 0

Formats   left, ticks [0,8,0]   level [0,1,0]
Latency   1 clock from ce to level
Rounding  none
Overflow  left cannot overflow
Cost      9 register bits
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, quantize
from fpga_model.jit import inlined

TICKS = bits(8)
LATENCY = 1


class Params(NamedTuple):
    """Machine units in their formats; build with `design`."""

    ticks: TICKS


class State(NamedTuple):
    """The registers: formats and reset values."""

    left: TICKS = 0
    level: BIT = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(ticks=100):
    """Strobes to a change of the level, 1 .. 255."""
    if not 1 <= ticks <= TICKS.hi:
        raise ValueError(f"ticks: {ticks} is outside 1 .. {TICKS.hi}")
    return Params(quantize(ticks, TICKS, "ticks"))


@inlined
def step(p, s, ce):
    """One clock edge: every right-hand side reads the old registers."""
    if not ce:
        return s
    if s.left != 0:
        return State(left=s.left - 1, level=s.level)
    return State(left=p.ticks - 1, level=1 - s.level)


BLOCK = Block(
    place=230,
    inputs={"ce": BIT},
    latency={"level": LATENCY},
    cases={"default": design(), "slowest": design(255)},
    strobes=("ce",),
)
''',
    "tests/fpga_model/test_beat.py": '''"""Beat: every register at every clock."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import beat
from tests import naive
from tests.fpga_model.records import assert_rows, rows


@given(st.integers(1, 9), st.lists(st.integers(0, 1), max_size=80))
def test_step_is_the_documented_equation(ticks, strobes):
    p = beat.design(ticks)
    found = rows(lambda s, *i: beat.step(p, s, *i), beat.State(), [(ce,) for ce in strobes])
    assert_rows(found, naive.beat(ticks, strobes), beat.STATE_FMT)


def test_design_refuses():
    with pytest.raises(ValueError, match="ticks: 256 is outside"):
        beat.design(256)
''',
    "testbench/rtl/beat.v": """// Beat: a level that changes every `ticks` strobes. Latency: 1 clock.
module gyro_beat #(
    parameter [7:0] ticks = 8'd0
) (
    input  wire       clk,
    input  wire       rst,
    input  wire       ce,
    output reg  [7:0] r_left,
    output reg        r_level
);
    always @(posedge clk) begin
        if (rst) begin
            r_left  <= 8'd0;
            r_level <= 1'b0;
        end else if (ce) begin
            r_left  <= (r_left == 8'd0) ? ticks - 8'd1 : r_left - 8'd1;
            r_level <= (r_left == 8'd0) ? ~r_level : r_level;
        end
    end
endmodule
""",
}
EDITED = {
    "tests/naive.py": [
        (
            "# the four loops: what their PI",
            '''def beat(ticks, strobes):
    """Rows (left, level) from the number of strobes alone."""
    counts = [sum(strobes[:n]) for n in range(len(strobes) + 1)]
    return [(-count % ticks, -(-count // ticks) % 2) for count in counts]


# the four loops: what their PI''',
        ),
    ],
    "fpga_model/top.py": [
        ("from fpga_model import (\n", "from fpga_model import (\n    beat,\n"),
        ("    control: control.Params\n", "    control: control.Params\n    beat: beat.Params | None = None\n"),
        (
            "    control: control.State = control.State()\n",
            "    control: control.State = control.State()\n    beat: beat.State | None = None\n",
        ),
        (
            "@inner\ndef codes(p, s):",
            '''@inner
def beaten(p, s, ce_1m):
    """The lamp after an edge; None where there is none."""
    if s is None:
        return s
    return beat.step(p, s, ce_1m)


@inner
def codes(p, s):''',
        ),
        ("        work,\n    )\n", "        work,\n        beaten(p.beat, s.beat, ce_1m),\n    )\n"),
    ],
    "testbench/config/load.py": [
        (
            "    notch_hz: float =",
            '    beat_ticks: int = number(0, "us", 0, 255, "lamp: 0 is no lamp")\n    notch_hz: float =',
        ),
    ],
    "testbench/run/build.py": [
        ("    agc,\n    control,", "    agc,\n    beat,\n    control,"),
        (
            "    fpga_params = fpga.Params(\n",
            "    fpga_params = fpga.Params(\n        beat=beat.design(f.beat_ticks) if f.beat_ticks else None,\n",
        ),
    ],
}
USED = """
from fpga_model import beat, block, top, wiring
from testbench.config import Config, changed
from testbench.run import build
wiring.check()
assert "beat" in wiring.trace(top, all_parts=True).instances and "beat" not in wiring.trace(top).instances
on = build.firmware(changed(Config(), {"firmware.beat_ticks": 50}))
assert block.reset(top.State(), on).beat == beat.State()
assert build.firmware(Config()).beat is None
assert len(list(block.leaves(block.reset(top.State(), on)))) == len(list(block.leaves(top.State()))) + 2
beat.BLOCK.inputs["ce"] = beat.TICKS
wiring.trace.cache_clear(); wiring.check.cache_clear()
try:
    build.firmware(Config())
except ValueError as error:
    assert "rates.ce_1m [0,1,0] -> beat.ce [0,8,0]" in str(error), error
else:
    raise AssertionError("no refusal")
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the tree with the block."""
    root = tmp_path_factory.mktemp("tree")
    for name in TREE:
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", root)
    for name, text in NEW.items():
        (root / name).write_text(text)
    for name, changes in EDITED.items():
        text = (root / name).read_text()
        for before, after in changes:
            assert text.count(before) == 1, (name, before)
            text = text.replace(before, after)
        (root / name).write_text(text)
    return root


def ran(root, *words):
    done = subprocess.run(
        [sys.executable, *words],
        cwd=root,
        env=os.environ | {"PYTHONPATH": str(root)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


def touched(one, other):
    """Paths of the files that differ."""
    found = set()
    for path in (p for name in TREE for p in (other / name).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            twin = one / path.relative_to(other)
            if not twin.is_file() or not filecmp.cmp(path, twin, shallow=False):
                found.add(str(path.relative_to(other)))
    return found


def test_a_block_is_at_most_seven_files(copy):
    assert touched(ROOT, copy) == {*NEW, *EDITED}
    assert len({*NEW, *EDITED}) <= MOST_FILES


def test_its_wires_are_known_and_checked_and_off_it_is_absent(copy):
    ran(copy, "-c", USED)


def test_its_ports_are_listed(copy):
    script = "from testbench.golden.port_table import port_table; print(port_table('beat').rows)"
    assert "('register', 'left', '[0,8,0]', '0', '-', '-')" in ran(copy, "-c", script)


@pytest.mark.slow
@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="runs compiled")
def test_its_vectors_proofs_and_rtl_are_there(copy):
    listed = [
        "tests/fpga_model/test_beat.py",
        "tests/testbench/golden/test_blocks.py",
        "tests/testbench/golden/test_ranges.py",
    ]
    listed += ["tests/testbench/golden/test_stimulus.py", "tests/testbench/golden/test_evidence.py"]
    options = ("-q", "-n", "0", "-p", "no:cacheprovider", "-k", "beat or every_block_of")
    assert " passed" in ran(copy, "-m", "pytest", *options, *listed)
    ran(copy, "-m", "testbench.commands.main", "golden", "export", "beat", "--out", "out")
    if shutil.which("iverilog") is None:
        pytest.skip("not installed, so the Verilog was NOT run: iverilog")
    done = subprocess.run(
        [
            "make",
            "-s",
            "-C",
            "out/beat",
            "check",
            f"RTL={copy}/testbench/rtl",
            "SIM=icarus",
            f"PYTHON={sys.executable}",
        ],
        cwd=copy,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout.count("PASS beat/") == 2, done.stdout + done.stderr
