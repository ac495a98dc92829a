"""The VHDL is the Verilog: proven by yosys for all inputs and any number of clocks, from reset on.

GHDL's synthesis makes Verilog of the VHDL. Both have all registers as ports, so one clock from equal registers is
enough: they are equal behind a reset, and equal registers stay equal.
"""

import re
import shutil

import pytest

from testbench.golden.foreign.rtl_sources import Sources
from testbench.golden.loop import from_vhdl
from tests.testbench.rtl.test_rtl import BLOCKS, OF_HOST, RTL, TIMEOUT_S, VHDL, parameters, ran

pytestmark = pytest.mark.skipif(
    not (shutil.which("yosys") and shutil.which("ghdl")),
    reason="no yosys, or no ghdl: VHDL and Verilog are not compared",
)
SCRIPT = """read_verilog {vhdl}
hierarchy -check -top gyro_{stem}
proc; setundef -undriven -anyseq; flatten; opt -full
rename gyro_{stem} gate; design -stash gate
read_verilog -defer {verilog}
hierarchy -check -top gyro_{stem} {given}
rename -top gold
proc; flatten; opt -full; design -stash gold
design -copy-from gold -as gold gold
design -copy-from gate -as gate gate
miter -equiv -flatten -make_outputs gold gate miter
hierarchy -top miter
opt -full
sat -verify -timeout {limit} -prove trigger 0 {induction} miter
"""
INDUCTION = "-tempinduct -set-at 1 in_rst 1 -seq 1 -maxsteps 1"


def compare(stem, folder, given=(), edits=()):
    """Prove that both are equal; `given` are (parameter, raw, width), edits (right, wrong) of the VHDL's text."""
    names = (*OF_HOST.get(stem, ()), stem)
    for name in names:
        shutil.copy(RTL / f"{name}.vhd", folder)
    path = folder / f"{stem}.vhd"
    text = path.read_text()
    for name, raw, width in given:  # GHDL takes no std_logic from outside
        value = f"{raw}" if width == 32 else f"'{raw}'" if width == 1 else f'"{raw:0{width}b}"'
        text, found = re.subn(
            rf"^( +{name} +: [^;:-]*?)( :=[^;\n-]*)?(?= *(;|--|$))", rf"\1 := {value}", text, flags=re.M
        )
        assert found == 1, name
    for right, wrong in edits:
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    path.write_text(text)
    found = Sources(tuple(folder / f"{name}.vhd" for name in names), ("",) * len(names))
    script = SCRIPT.format(
        vhdl=from_vhdl.synthesise_vhdl(found, f"gyro_{stem}", folder, stem),
        stem=stem,
        verilog=" ".join(str(RTL / f"{name}.v") for name in names),
        given="".join(f" -chparam {name} {width}'h{raw:x}" for name, raw, width in given),
        limit=TIMEOUT_S,
        induction=INDUCTION if "rising_edge" in text or stem in ("host", "host_axi") else "",
    )
    ran(["yosys", "-q", "-p", script.replace("\n", "; ")], folder)


# GHDL 2.0 ends with an internal error on the PI; its VHDL has vectors
CASES = [(stem, k) for stem in VHDL if stem != "pi" for k in range(len(BLOCKS[stem].params))]


@pytest.mark.slow
@pytest.mark.parametrize(("stem", "k"), CASES)
def test_the_vhdl_of_a_block_is_its_verilog(stem, k, tmp_path):
    compare(stem, tmp_path, parameters(BLOCKS[stem], BLOCKS[stem].params[k]))


@pytest.mark.parametrize(
    ("stem", "dds_bits"),
    [
        ("host_words", 48),
        ("host_axi", 48),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (("host", 48), *((stem, 32) for stem in OF_HOST))),
    ],
)
def test_the_vhdl_of_the_port_is_its_verilog(stem, dds_bits, tmp_path):
    compare(stem, tmp_path, [("DDS_BITS", dds_bits, 32)])


PLANTED = [
    ("host_words", 'when x"11"', 'when x"12"'),
    ("host_words", 'x"4759524F0002"', 'x"4759524F0001"'),
    ("host_words", "word(bus_held_number) ", "word(bus_held_status)"),
    ("host", "SLOTS : natural := 60", "SLOTS : natural := 59"),
    ("host", "r_errors   => r_slave_errors", "r_errors   => open"),
    ("host", "clear      => r_bus_clear", 'clear      => "000"'),
    ("host_axi", "start              => '0'", "start              => fetch"),
    ("host_axi", "pairs => pairs", "pairs => (others => '0')"),
    ("host_axi", "bus_held_status                => r_bus_held_status", 'bus_held_status => r_bus_status & "00"'),
]


@pytest.mark.parametrize(
    ("stem", "right", "wrong"),
    [pytest.param(*fault, marks=pytest.mark.slow) if n % 6 else fault for n, fault in enumerate(PLANTED)],
)
def test_a_difference_is_seen(stem, right, wrong, tmp_path):
    with pytest.raises(AssertionError, match="proof did fail"):
        compare(stem, tmp_path, edits=[(right, wrong)])
