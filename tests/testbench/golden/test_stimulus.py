"""Stimulus: the generator's published numbers, families that reach what they are named for, the same every time.

What a family has to reach is computed from the rows and from the registers of the model, never from the generator.
"""

import functools
import itertools

import numpy as np
import pytest

from fpga_model import fault_monitor, modulator, notch, rate_output, rates, sequencer, sine, spi_adc, spi_dac
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits
from testbench.golden.coverage import unreachable
from testbench.golden.stimulus import blocks, stimulus
from tests.testbench.golden.benching import but_counting, made, one_case

CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]
LONGEST = 22_000
# what a reset or a new operation can interrupt: the registers that count through an operation, or name its state
PHASES = {
    "cordic": ("i", "busy", "done"),
    "isqrt": ("i", "busy", "done"),
    "quadrature_loop": ("root_i", "root_busy", "root_done"),
    "spi_dac": ("left", "lead", "sync_n", "sclk_en", "ldac_wait"),
    "spi_adc": ("word", "busy", "sclk", "valid", "meta", "sync", "seen"),
    "digital_sid": ("stage",),
    "rate_output": ("stage",),
    "rates": ("slot", "tick"),
    "watchdog": ("stale",),
    "spi_slave": ("phase", "bit", "second", "write", "done", "active"),
    "axi_slave": ("awready", "wready", "bvalid", "arready", "rvalid"),
    "host_bus": ("pending", "fresh", "unread", "unread_after", "reading"),
}
# blocks with a script; where a register rounds or overflows, the script takes the place of the edges
SCRIPTED = ("spi_adc", "spi_slave", "axi_slave", "host_bus", "watchdog", "rates")


@functools.cache
def record(stem, case):
    """(stimulus, registers, pins) by port name, for a case."""
    block = blocks.BLOCKS[stem]
    rows, _ = made(stem, case)
    regs, pins = blocks.run(block, case, rows)
    named = [(block.columns, rows), (block.registers, regs), (block.pins, pins)]
    return [{port.name: array[:, k] for k, port in enumerate(ports)} for ports, array in named]


def family(block, case, name):
    """Rows of one family by input, or None where the block has none."""
    rows, families = made(block.stem, case)
    for found, first, count in families:
        if found == name:
            part = rows[first : first + count]
            return {port.name: part[:, k] for k, port in enumerate(block.columns)}
    return None


def test_splitmix64_gives_the_published_numbers():
    random = stimulus.Random(0)
    assert [random.next() for _ in range(3)] == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]


def test_raw_values_stay_in_the_format_and_reach_its_ends():
    random, fmt = stimulus.Random(1), Fmt(1, 2, 0)
    assert {random.raw(fmt) for _ in range(400)} == set(range(-4, 4))


def test_corners_hold_the_ends():
    for fmt in (bits(1), bits(2), bits(48), Fmt(1, 0, 17), Fmt(1, -1, 24), Fmt(1, 35, 24)):
        found = stimulus.corners(fmt)
        assert {fmt.lo, fmt.hi} <= set(found)
        assert found == sorted(set(found))
        assert all(fmt.holds(v) for v in found)


# both monitors count frames to 65 535 by default: their quick cases say the same in CI
LONG = {("lock_monitor", "default"), ("fault_monitor", "default")}


@pytest.mark.parametrize(("stem", "case"), one_case(sorted(CASES, key=LONG.__contains__)))
def test_families_follow_one_another_and_repeat_exactly(stem, case):
    block = blocks.BLOCKS[stem]
    rows, families = made(stem, case)
    again, same = stimulus.make(block, case)
    assert np.array_equal(rows, again)
    assert families == same
    at = 0
    for name, first, count in families:
        assert (first, count > 0) == (at, True), name
        at += count
    assert at == len(rows) < LONGEST
    assert rows[:, 0].sum() >= 3, "resets in the middle"
    blocks.check(block.columns, rows, stem)


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_every_family_that_makes_sense_is_there(stem, case):
    block = blocks.BLOCKS[stem]
    names = [name for name, _, _ in made(stem, case)[1]]
    assert len(set(names)) == len(names)
    expected = {"idle", "reset_at", "random_sparse"}
    if any(port.width > 1 for port in block.inputs):
        expected |= {"corners", "signs", "walking_ones"}
    if block.strobes:
        expected.add("enable_at")
    if block.dense:
        expected |= {"controls", "held", "random_dense", "random_corners"}
    if any(port.rounding or port.overflow for port in block.registers) and stem not in SCRIPTED:
        expected.add("script" if stem in ("fault_monitor", "sequencer") else "edges")
    if stem in (*SCRIPTED, "lock_monitor"):
        expected.add("script")
    assert expected <= set(names)


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_corners_put_every_input_at_0_1_its_msb_and_all_ones(stem, case):
    block = blocks.BLOCKS[stem]
    rows = family(block, case, "corners")
    for port in block.inputs:
        if port.width > 1:
            msb = port.fmt.lo if port.signed else 1 << (port.width - 1)
            ones = -1 if port.signed else port.fmt.hi
            wanted = {0, 1, msb, ones, port.fmt.lo, port.fmt.lo + 1, port.fmt.hi - 1, port.fmt.hi}
            assert wanted <= set(rows[port.name].tolist()), port.name


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_signs_put_the_inputs_at_the_worst_ends_together(stem, case):
    block = blocks.BLOCKS[stem]
    wide = [port for port in block.inputs if port.width > 1]
    rows = family(block, case, "signs")
    for a, b in itertools.combinations(wide, 2):
        pairs = set(zip(rows[a.name].tolist(), rows[b.name].tolist(), strict=True))
        assert set(itertools.product((a.fmt.lo, a.fmt.hi), (b.fmt.lo, b.fmt.hi))) <= pairs, (a.name, b.name)
    for port in wide:
        assert {port.fmt.lo, port.fmt.hi} <= set(rows[port.name].tolist())


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_walking_ones_walk_through_every_bit_or_every_few(stem, case):
    block = blocks.BLOCKS[stem]
    rows = family(block, case, "walking_ones")
    alone = sum(
        (1 << k) in set((rows[port.name] & ((1 << port.width) - 1)).tolist())
        for port in block.inputs
        if port.width > 1
        for k in range(port.width)
    ) if rows else 0  # fmt: skip
    total = sum(port.width for port in block.inputs if port.width > 1)
    assert alone >= total / max(1, -(-total * (1 + block.wait) // 2600))


@pytest.mark.parametrize(("stem", "case"), [(s, c) for s, c in CASES if s in PHASES])
def test_reset_and_enable_come_at_every_state_of_the_pipeline(stem, case):
    block = blocks.BLOCKS[stem]
    rows, regs, _ = record(stem, case)
    reset = rows["rst"] == 1
    for name in PHASES[stem]:
        every = set(regs[name].tolist())
        assert set(regs[name][reset].tolist()) == every, name
        if block.dense:
            for strobe in block.strobes:
                assert set(regs[name][~reset & (rows[strobe] == 1)].tolist()) == every, (name, strobe)


def test_reset_comes_at_every_count_of_a_word_and_in_the_tail():
    _, regs, _ = record("spi_adc", "default")
    reset = record("spi_adc", "default")[0]["rst"] == 1
    first = set(regs["count"][reset & (regs["word"] == 0)].tolist())
    assert first == set(range(spi_adc.WORD_BITS))
    tail = set(regs["count"][reset & (regs["word"] == 1 + spi_adc.CHANNELS)].tolist())
    assert {0, DEFAULT.adc_tail_clocks - 1} <= tail


def test_sequencer_is_reset_in_every_state():
    rows, regs, _ = record("sequencer", "quick")
    assert set(regs["state"][rows["rst"] == 1].tolist()) == set(range(len(sequencer.STATES)))


def test_monitors_are_reset_while_everything_is_up():
    for stem, case, name, value in (
        ("lock_monitor", "default", "locked", 15),
        ("fault_monitor", "default", "latch", fault_monitor.ALL),
    ):
        rows, regs, _ = record(stem, case)
        assert value in set(regs[name][rows["rst"] == 1].tolist()), stem
    rows, regs, _ = record("rates", "default")
    last = (regs["tick"] == rates.TICK_CYCLES - 1) & (regs["frame"] == rates.FRAME_TICKS - 1)
    assert (last & (rows["rst"] == 1)).any()


@pytest.mark.parametrize(("stem", "case"), [(s, c) for s, c in CASES if blocks.BLOCKS[s].dense])
def test_held_rests_long_enough_for_a_limit_cycle(stem, case):
    block = blocks.BLOCKS[stem]
    rows = family(block, case, "held")
    table = np.column_stack([rows[port.name] for port in block.columns])
    same = np.r_[False, (table[1:] == table[:-1]).all(axis=1)]
    longest = max(len(list(group)) for value, group in itertools.groupby(same.tolist()) if value)
    assert longest >= 30
    for strobe in block.strobes:
        assert rows[strobe].all()


# limits that another case of the block has in reach
ELSEWHERE = {
    ("frequency_tracker", "default"): ("loop_acc", "loop_y"),  # 22,000 frames away; narrow
    ("digital_sid", "default"): tuple(f"codes_{k}" for k in range(4)),  # slow poles; delay0
    ("sequencer", "quick"): ("attempts",),  # 255 attempts of 31 frames; fastest
    ("sequencer", "fastest"): ("faults_drive", "faults_rail"),  # SETTLE and BALANCE do not last; quick
}
SATURATING = [
    (stem, case, port.name)
    for stem, case in CASES
    for port in blocks.BLOCKS[stem].registers
    if port.overflow == "saturate"
    and not port.name.endswith(("_frames", "timer"))
    and port.name not in ELSEWHERE.get((stem, case), ())
]


def limits_of(block, case, name):
    """Limits of a saturating register and the least step it can have there, from parameters and formats alone."""
    p, port = block.cases[case], next(port for port in block.registers if port.name == name)
    if block.stem == "pi" or name.startswith("loop_"):
        p = p if block.stem == "pi" else p.loop
        shift = 24 if name.endswith("acc") else 0
        return p.lo << shift, p.hi << shift, shift
    if block.stem == "modulator":
        return p.lo, p.hi, 0
    if block.stem in ("fault_monitor", "sequencer"):
        faults = p.faults if block.stem == "sequencer" else p
        if name == "attempts":
            return 0, sequencer.ATTEMPTS_TOP, 0
        return 0, getattr(faults, name.removeprefix("faults_")), 0
    if block.stem == "notch":
        return notch.Y_LO, notch.Y_HI, 0
    if block.stem == "digital_sid" and name == "still":
        return 0, p.still, 0
    return port.fmt.lo, port.fmt.hi, 0


@pytest.mark.parametrize(("stem", "case", "name"), SATURATING)
def test_a_saturating_register_stands_at_its_limits_and_one_lsb_inside(stem, case, name):
    """Every one stands at lo and at hi; those that move by one LSB at lo + 1 and hi - 1 as well."""
    block = blocks.BLOCKS[stem]
    found = set(record(stem, case)[1][name].tolist())
    lo, hi, shift = limits_of(block, case, name)
    if stem == "modulator" and case != "narrow":
        assert {hi, hi - 1, lo + 1, lo} <= found
        return
    assert {lo, hi} <= found
    if shift == 0 and hi - lo > 1:
        assert {lo + 1, hi - 1} <= found


def test_ties_of_the_sine_come_in_all_quadrants():
    """Every class of dropped bits, in either sign, of the value that y rounds."""
    _, regs, _ = record("sine", "default")
    total = (regs["base2"] << sine.ALIGN) + regs["product"]
    low, half = total & ((1 << sine.PRODUCT.f) - 1), 1 << (sine.PRODUCT.f - 1)
    for wanted in (0, 1, half - 1, half, half + 1, 2 * half - 1):
        for sign in (0, 1):
            assert ((low == wanted) & (regs["sign2"] == sign)).any(), (wanted, sign)
    kept = total >> sine.PRODUCT.f
    assert {0, 1} == set((kept[low == half] & 1).tolist())


def test_every_word_of_the_sine_table_is_read():
    """At the phase 0 of each step of the table the register holds the word itself."""
    _, regs, _ = record("sine", "default")
    read = set(zip(regs["base"].tolist(), regs["slope"].tolist(), strict=True))
    assert set(zip(*map(np.ndarray.tolist, map(np.asarray, sine.tables(DEFAULT))), strict=True)) <= read


@pytest.mark.parametrize("case", blocks.BLOCKS["modulator"].cases)
def test_modulator_meets_both_limits_every_tie_and_one_beyond(case):
    p = blocks.BLOCKS["modulator"].cases[case]
    _, regs, _ = record("modulator", case)
    assert {p.lo, p.hi} <= set(regs["code"].tolist())
    product = regs["product"]
    low = set((product & ((1 << p.shift) - 1)).tolist())
    half = 1 << (p.shift - 1)
    assert {0, 1, half, (1 << p.shift) - 1} <= low
    # a tie +-1 of 39 dropped bits has no factors of 24 and 18 bits
    assert ({half - 1, half + 1} <= low) == (case != "dac2")
    rounded = set(((product + half) >> p.shift).tolist())
    assert {p.lo, p.lo + 1, p.hi - 1, p.hi, p.hi + 1} <= rounded
    assert (p.lo - 1 in rounded) == (case == "narrow")
    assert product.max() == modulator.AMPLITUDE.lo * modulator.SINE.lo


PI_LIKE = [("pi", case) for case in blocks.BLOCKS["pi"].cases]
PI_LIKE += [
    ("agc", "default"),
    ("rate_loop", "default"),
    ("quadrature_loop", "default"),
    ("frequency_tracker", "narrow"),
]


@pytest.mark.parametrize(("stem", "case"), PI_LIKE)
def test_a_pi_is_asked_for_one_step_beyond_each_limit(stem, case):
    """The sum behind y, from prop and acc: at both limits +-1 LSB, and beyond, unless the gains cannot."""
    block = blocks.BLOCKS[stem]
    p = block.cases[case] if stem == "pi" else block.cases[case].loop
    prefix = "" if stem == "pi" else "loop_"
    _, regs, _ = record(stem, case)
    rounded = set(((regs[f"{prefix}prop"] + regs[f"{prefix}acc"] + (1 << 23)) >> 24).tolist())
    assert {p.lo, p.lo + 1, p.hi - 1, p.hi} <= rounded
    assert ({p.lo - 1, p.hi + 1} <= rounded) == (p.kp != 0)


@pytest.mark.parametrize(("stem", "case"), PI_LIKE)
def test_a_pi_meets_every_edge_of_its_rounding_that_its_gains_allow(stem, case):
    block = blocks.BLOCKS[stem]
    p = block.cases[case] if stem == "pi" else block.cases[case].loop
    prefix = "" if stem == "pi" else "loop_"
    _, regs, _ = record(stem, case)
    total = regs[f"{prefix}prop"] + regs[f"{prefix}acc"]
    low, half = total & ((1 << 24) - 1), 1 << 23
    gains = abs(p.kp) | abs(p.ki) | 1 << 24
    step = gains & -gains
    assert {0, step, half - step, half, half + step, (1 << 24) - step} <= set(low.tolist())
    ties = total[low == half]
    signs = {(bool(t < 0), (t >> 24) & 1) for t in ties.tolist()}
    assert len(signs) == (4 if p.kp else 2)


def test_spi_dac_sends_frames_as_the_modulator_makes_them():
    for case, p in blocks.BLOCKS["spi_dac"].cases.items():
        rows, _, _ = record("spi_dac", case)
        words = set(rows["word"][rows["load"] == 1].tolist())
        make = getattr(spi_dac.frame, "py_func", spi_dac.frame)
        assert {make(p, 0, 0), make(p, -1, 0), make(p, 0, 1)} <= words, case


def test_sequencer_sees_every_state_and_every_fault():
    _, regs, pins = record("sequencer", "quick")
    assert set(regs["state"].tolist()) == set(range(len(sequencer.STATES)))
    assert int(np.bitwise_or.reduce(regs["faults_flags"])) == fault_monitor.ALL
    assert int(np.bitwise_or.reduce(regs["lock_locked"])) == 15
    for name, column in pins.items():
        assert len(set(column.tolist())) > 1, name
    _, regs, _ = record("sequencer", "fastest")
    attempts = regs["attempts"]
    assert (attempts == sequencer.ATTEMPTS_TOP).sum() > 4, "asked for one attempt more than the counter holds"


def test_spi_adc_completes_good_and_bad_frames():
    _, regs, _ = record("spi_adc", "default")
    assert regs["valid"].sum() > 10
    assert {0, 1} == set(regs["ok"][1:][regs["valid"][1:] == 1].tolist())
    assert set(regs["count"].tolist()) == set(range(DEFAULT.adc_tail_clocks))


def test_counters_wrap_or_saturate():
    _, regs, _ = record("rates", "default")
    assert regs["frame"].max() == rates.FRAME_TICKS - 1
    assert ((regs["frame"][:-1] == rates.FRAME_TICKS - 1) & (regs["frame"][1:] == 0)).any()
    assert regs["slot"].max() == rates.SLOTS
    _, regs, _ = record("watchdog", "default")
    assert regs["age"].max() == 1023
    _, regs, _ = record("lock_monitor", "default")
    assert int(np.bitwise_or.reduce(regs["locked"])) == 15


@pytest.mark.parametrize("stem", but_counting(blocks.BLOCKS))
def test_every_bit_of_every_register_rises_and_falls_in_some_case(stem):
    """But those that are proved not to, and the upper bits of the counters of 65535 frames."""
    block, rose, fell = blocks.BLOCKS[stem], {}, {}
    for case in block.cases:
        _, regs, _ = record(stem, case)
        for port in block.registers:
            column = regs[port.name]
            rose[port.name] = rose.get(port.name, 0) | int(np.bitwise_or.reduce(column[1:] & ~column[:-1]))
            fell[port.name] = fell.get(port.name, 0) | int(np.bitwise_or.reduce(column[:-1] & ~column[1:]))
    dead = [unreachable.reasons(block, case) for case in block.cases]
    places = [(port, k) for port in block.registers for k in range(port.width)]
    for port, k in places:
        if unreachable.waiver_reason(block, ("toggle", port.name, f"rise {k}")):
            continue
        for way, seen in (("rise", rose), ("fall", fell)):
            proved = all(("toggle", port.name, f"{way} {k}") in reasons for reasons in dead)
            assert bool(seen[port.name] >> k & 1) != proved, f"{port.name} {way} {k}"


@pytest.mark.parametrize("stem", but_counting(blocks.BLOCKS))
def test_every_register_is_reset_from_another_value_in_some_case(stem):
    """So that an initial value in the place of a reset shows."""
    moving, seen = set(), set()
    for case in blocks.BLOCKS[stem].cases:
        rows, regs, _ = record(stem, case)
        moving |= {name for name, column in regs.items() if (column != column[0]).any()}
        seen |= {name for name, column in regs.items() if (column[rows["rst"] == 1] != column[0]).any()}
    assert moving == seen


def test_searches_end_where_each_bit_of_the_correction_decides():
    p = blocks.BLOCKS["sequencer"].cases["quick"]
    _, regs, _ = record("sequencer", "quick")
    ends = np.flatnonzero((regs["state"][:-1] == sequencer.SEARCH) & (regs["timer"][:-1] == p.search - 1))
    found = regs["correction"][ends + 1].astype(object)
    step = p.gain >> sequencer.GAIN.f  # a rotation more moves the correction by this much
    for bit in (1 << k for k in range(step.bit_length() + 1, p.search_limit.bit_length())):
        for set_ in (0, bit):
            decided = [(abs(c) <= p.search_limit) != (abs(c ^ bit) <= p.search_limit) for c in found if c & bit == set_]
            assert any(decided), (bit, set_)


def test_word_and_temperature_in_the_place_of_their_registers_show():
    """A design that reads an input of the rate output in a clock after `en` loads another value."""
    p, shown = rate_output, dict.fromkeys(("t2", "bias", "scale", "corrected"), 0)
    rows, regs, _ = ({k: v.tolist() for k, v in part.items()} for part in record("rate_output", "default"))
    for n, stage in enumerate(regs["stage"][:-1]):
        now = {name: column[n] for name, column in (*rows.items(), ("r_bias", regs["bias"]), ("t2", regs["t2"]))}
        t, loads = now["temperature"] >> p.CODE_CUT, {}
        if stage & 1:
            loads["t2"] = (t * t + (1 << 14)) >> 15
        if stage & 2:
            loads["bias"] = (now["bias"] << 16) + now["bias_t1"] * t + now["bias_t2"] * now["t2"]
            scale = (now["scale"] << 12) + now["scale_t1"] * t + now["scale_t2"] * now["t2"]
            loads["scale"] = min(max((scale + (1 << 11)) >> 12, p.SCALE.lo), p.SCALE.hi)
        if stage & 4:
            difference = ((now["word"] << 24) - now["r_bias"] + (1 << 15)) >> 16
            loads["corrected"] = min(max(difference, p.CORRECTED.lo), p.CORRECTED.hi)
        for name, value in loads.items() if not now["rst"] else ():
            shown[name] += value != regs[name][n + 1]
    assert min(shown.values()) >= 2, shown


@pytest.mark.parametrize("name", ["word", "t", "corrected", "scaled", "acc", "y"])
def test_the_rate_output_takes_every_value_of_its_low_bits(name):
    """A glitch at one value of seven bits shows, whichever it is."""
    _, regs, _ = record("rate_output", "default")
    assert set((regs[name] & 127).tolist()) == set(range(128))


@pytest.mark.parametrize("case", ["default", "quick"])
@pytest.mark.parametrize("was_locked", [0, 1])
def test_a_count_that_goes_on_between_both_limits_shows_in_locked(was_locked, case):
    """A design whose counts start again at the other limit alone has another word `locked`, each of its four bits."""
    p = blocks.BLOCKS["lock_monitor"].cases[case]
    rows, regs, _ = record("lock_monitor", case)
    names, bit, count, differs = ("agc_error", "phase", "sense_sin", "sense_cos"), [0] * 4, [0] * 4, 0
    for n in range(len(regs["locked"])):
        now = {name: int(rows[name][n]) for name in (*names, "rst", "en", "enable", "judged", "setpoint", "rail")}
        differs |= sum(b << k for k, b in enumerate(bit)) ^ int(regs["locked"][n])
        if now["rst"]:
            bit, count = [0] * 4, [0] * 4
        for k in range(4) if now["en"] and not now["rst"] else ():
            if not now["enable"] >> k & 1:
                bit[k] = count[k] = 0
            elif now["judged"] >> k & 1:
                scale = now["setpoint"] if k == 0 else 1 << 16
                inner, outer = (scale * table[k] >> 16 for table in (p.limit_in, p.limit_out))
                error, rail = abs(now[names[k]]), k == 3 and now["rail"]
                good, lost = rail or error <= inner, error > outer and not rail
                goes_on = bit[k] == was_locked and count[k] > 0 and not (good if bit[k] else lost)
                count[k] = count[k] + 1 if (lost if bit[k] else good) or goes_on else 0
                if count[k] >= (p.frames_out if bit[k] else p.frames_in)[k]:
                    bit[k], count[k] = 1 - bit[k], 0
    assert differs == 15


@pytest.mark.parametrize(
    ("name", "loop"),
    [("HOLD_AGC", 0), ("HOLD_PLL", 1), ("HOLD_FTR", 2), ("HOLD_QSC", 3), ("FIX_FTR", 2), ("FIX_QSC", 3)],
)
def test_each_bit_that_takes_a_loop_out_of_judgement_does_so_alone(name, loop):
    """In a frame with this bit alone the counts of the three other loops move, and that of its own loop rests."""
    rows, regs, _ = record("sequencer", "quick")
    bits_of_loops = sum(getattr(sequencer, other) for other in sequencer.CONTROL_BITS if other[:4] in ("HOLD", "FIX_"))
    alone = rows["i_control"][:-1] & bits_of_loops == getattr(sequencer, name)
    moved = [np.diff(regs[f"lock_count_{k}"]) != 0 for k in range(4)]
    others = np.logical_and.reduce([moved[k] for k in range(4) if k != loop])
    assert (alone & others & (regs["state"][:-1] == sequencer.LOCKED) & ~moved[loop]).any()


def test_the_amplitude_is_judged_at_the_limits_of_many_setpoints():
    p = blocks.BLOCKS["sequencer"].cases["quick"].lock
    rows, regs, _ = record("sequencer", "quick")
    error, state = rows["i_setpoint"] - rows["i_magnitude"], regs["state"]
    for table, where in ((p.limit_in, sequencer.SETTLE), (p.limit_out, sequencer.LOCKED)):
        limit = rows["i_setpoint"] * table[0] >> 16
        for beyond in (0, 1):
            for sign in (1, -1):
                hit = (state == where) & (error == sign * (limit + beyond))
                assert len(set(rows["i_setpoint"][hit].tolist())) >= 12, (where, beyond, sign)
