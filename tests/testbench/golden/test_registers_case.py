"""The recording `registers`: a stuck or crossed wire between the bank and a block shows, in the model and in Icarus.

A wire that is stuck is a bank that holds other words: the recording is played with these words, written in every frame,
and any register of a block that then differs at the start of a frame shows the fault. The bank itself does not count.
"""

import random
import re

import numpy as np
import pytest

from fpga_model import fault_monitor, registers, sequencer, top
from fpga_model.fault_monitor import CODE
from fpga_model.rates import FRAME_CYCLES
from testbench.flatten import names
from testbench.golden.bundles import design_bundle as golden
from testbench.golden.recording import recording, registers_case, replay_recording
from tests.testbench.golden.benching import RTL, need
from tests.testbench.rtl.test_rtl import ran

NAMES = names(top.State())
BLOCKS = np.array([not name.startswith("registers.") for name in NAMES])
SEED = 24
EVERY = [(r, bit) for r in registers.WRITABLE for bit in range(r.fmt.width)]


def played(r, host):
    """Registers at the frame starts, with other host writes."""
    return replay_recording.run(
        r.params, r.stimulus._replace(host=host), r.frames, np.arange(r.frames) * FRAME_CYCLES
    ).registers


@pytest.fixture(scope="module")
def shows():
    """Function: whether a block differs when a register of the bank holds fault(word) in place of each word."""
    r = recording.load("registers")
    sound = played(r, r.stimulus.host)

    def differs(register, fault):
        held = sound[:, NAMES.index(f"registers.{register.name}")]
        host = {row[0]: tuple(row) for row in r.stimulus.host.tolist() if row[2] != register.address}
        for frame, word in enumerate(held.tolist()[1:], 1):
            clock = (frame - 1) * FRAME_CYCLES + 1500  # behind the 8 kHz work of the frame before
            clock = next(at for at in range(clock, clock + 20) if at not in host)
            host[clock] = (clock, 0, register.address, registers.to_bus(fault(word), register.fmt))
        found = played(r, np.array(sorted(host.values()), np.int64))
        return bool((found != sound)[:, BLOCKS].any())

    return differs


def stuck(bit):
    """Faults that hold a bit at 0 and at 1."""
    return (lambda word: word & ~(1 << bit)), (lambda word: word | 1 << bit)


def crossed(bit, other):
    """Faults that invert a bit where another is 1, and where it is 0: a bit told by another is one of them."""
    return (lambda word: word ^ (word >> other & 1) << bit), (lambda word: word ^ (~word >> other & 1) << bit)


# ---- the recording ---------------------------------------------------------------------------------------------------


def test_every_word_of_the_map_is_written_within_its_format():
    host = recording.load("registers").stimulus.host
    assert not host[:, 1].any()  # no reset takes a word back
    assert set(host[:, 2].tolist()) == {r.address for r in registers.WRITABLE}
    for r in registers.WRITABLE:
        words = host[host[:, 2] == r.address, 3].tolist()
        assert all(word < 1 << r.fmt.width for word in words), r.name


def test_no_two_wires_that_are_coded_carry_the_same():
    told = [{r.name: word for r, word in words.items()} for words in registers_case.codes()]
    coded = [(r, bit) for r, bit in EVERY if r.name not in registers_case.DECIDE]
    wires = {tuple(words[r.name] >> bit & 1 for words in told) for r, bit in coded}
    assert len(wires) == len(coded) == sum(registers.WIDTHS) - 9 - 8 - 3


def test_every_fault_is_in_the_latch_when_its_ones_come():
    r = recording.load("registers")
    columns = dict(zip(NAMES, played(r, r.stimulus.host).T))
    state, latch = columns["control.sequencer.state"], columns["control.sequencer.faults.latch"]
    first = r.frames - registers_case.STEP * len(registers_case.ones())
    assert set(state[registers_case.CODES_FROM + 1 : first + 1].tolist()) == {sequencer.OPEN}
    left = [fault_monitor.ALL & ~((1 << k) - 1) for k in range(10)]
    assert latch[first + 2 :: registers_case.STEP].tolist() == left[: len(latch[first + 2 :: 2])]
    assert latch[-1] == 0


def test_conversions_are_those_of_the_story_but_for_the_temperature():
    known = {tuple(row) for row in recording.load("story").stimulus.adc[:, 1:6].tolist()}
    adc = recording.load("registers").stimulus.adc
    assert {tuple(row) for row in adc[:, 1:6].tolist()} <= known
    assert set(adc[:, 6].tolist()) == {CODE.hi}


# ---- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "register",
    [pytest.param(r, id=r.name, marks=[pytest.mark.slow] * (k % 3 > 0)) for k, r in enumerate(registers.WRITABLE)],
)
def test_faults_of_drawn_wires_show(register, shows):
    draw = random.Random(f"{SEED} {register.name}")
    bit, other = draw.sample(range(register.fmt.width), 2)
    assert not shows(register, lambda word: word)  # written in every frame, the same words change nothing
    for fault in (*stuck(bit), draw.choice(crossed(bit, other))):
        assert shows(register, fault), (register.name, bit, other)


@pytest.mark.slow
@pytest.mark.parametrize("register", registers.WRITABLE, ids=lambda r: r.name)
def test_faults_of_every_wire_show(register, shows):
    draw = random.Random(f"{SEED + 1} {register.name}")
    for bit in range(register.fmt.width):
        other = draw.choice([k for k in range(register.fmt.width) if k != bit])
        told, untold = crossed(bit, other)
        for fault in (*stuck(bit), told, untold):
            # flags are cleared one by one, upwards: a bit that a higher one sets too clears what is clear
            clear = fault is told and register.name == "fault_clear" and bit < other
            assert shows(register, fault) != clear, (register.name, bit, other)


# Wires whose bit rests in the other recordings, held where it rests: seen when the codes come
RESTING = [("amplitude_setpoint", 1), ("frequency_fixed", 16)]
CODED = registers_case.CODES_FROM + 4  # frames to play


@pytest.fixture(scope="module")
def icarus(tmp_path_factory):
    """Function (plusargs): what the bench says of the RTL, whose wires behind the bank can be held at 0 and 1."""
    need("iverilog")
    folder = tmp_path_factory.mktemp("registers")
    golden.export_case("registers", folder / "top" / "registers")
    folder = folder / "top" / "registers"
    text, wires = (RTL / "top.v").read_text(), []
    for r in registers.WRITABLE:
        wire = f"r_registers_{r.name}"
        held = f"({wire} & ~low_{r.name} | high_{r.name})"
        text, found = re.subn(rf"(\.(?!r_)\w+\s*)\({wire}\)", rf"\1({held})", text)
        assert found == 1, r.name
        for level in (f"low_{r.name}", f"high_{r.name}"):
            wires.append(f"    reg [{r.fmt.width - 1}:0] {level};")
            wires.append(f'    initial if (!$value$plusargs("{level}=%h", {level})) {level} = 0;')
    ports_end = text.index(");\n", text.index("output wire")) + 3
    (folder / "top.v").write_text(text[:ports_end] + "\n".join(wires) + text[ports_end:])
    parts = sorted(path for path in RTL.glob("*.v") if path.name != "top.v")
    ran(["iverilog", "-g2005", "-I.", "-s", "tb_top", "-o", "tb.vvp", "tb_top.v", "top.v", *parts], folder)
    return lambda *given: ran(["vvp", "-n", "tb.vvp", *given], folder)


def drawn():
    """(register, bit, level) of a wire of every word."""
    draw = random.Random(SEED)
    return [(r.name, draw.randrange(r.fmt.width), draw.choice(("low", "high"))) for r in registers.WRITABLE]


@pytest.mark.slow
def test_the_reference_design_passes_in_icarus(icarus):
    assert "PASS top/registers" in icarus()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bit"), RESTING)
def test_a_wire_that_rests_elsewhere_is_found_in_icarus(icarus, name, bit):
    word = registers.BY_NAME[name].reset
    host = recording.load("reset").stimulus.host
    assert registers.BY_NAME[name].address not in host[host[:, 1] == 0, 2]
    level = "high" if word >> bit & 1 else "low"
    assert "FAIL top/registers" in icarus(f"+{level}_{name}={1 << bit:x}", f"+FRAMES={CODED}")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bit", "level"), drawn())
def test_a_stuck_wire_is_found_in_icarus(icarus, name, bit, level):
    assert "FAIL top/registers" in icarus(f"+{level}_{name}={1 << bit:x}")
