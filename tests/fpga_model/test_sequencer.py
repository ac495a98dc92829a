"""The sequencer: every register at every clock against a told story, each transition, and what each state does."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpga_model import agc, fault_monitor, lock_monitor, pi, sequencer
from tests import naive
from tests.fpga_model.records import assert_rows, rows

LOCKS = lock_monitor.Params((3000, 500_000, 200, 300), (6000, 900_000, 800, 900), (2, 2, 3, 3), (3, 2, 4, 5))
FAULTS = fault_monitor.Params(over_range=2, stuck=3, drive=2, rate=2, rail=2, top=9)
SHORT = sequencer.Params(
    power_up=3,
    init=2,
    kick=2,
    decay=3,
    search=5,
    retune=2,
    timeout=8,
    offline=6,
    recover=2,
    reached=62259,
    min_magnitude=100,
    gain=704815,
    search_limit=10_000_000,
    lock=LOCKS,
    faults=FAULTS,
)
SETPOINT = 10_000
HEALTHY = sequencer.Inputs(control=sequencer.RUN, adc_ok=1, magnitude=SETPOINT, setpoint=SETPOINT)
STAYS = [3, 2, 1, 2, 2, 3, 5, 2, 1, 3, 4]  # in PATH; the two good frames that end STANDBY start in IDLE
LOCK_TIME = sum(STAYS)


def _away(code, step):
    """A code one step further from zero in every second frame; a clipped one stays."""
    return code if abs(code) >= fault_monitor.RANGE_LIMIT else code + (-step if code < 0 else step)


def frames(n, first=0, moving=True, turn=0, **what):
    """n frames of HEALTHY with changes; codes move, and the phase by `turn` a frame."""
    for k in range(n):
        i = HEALTHY._replace(**what)
        if moving:
            n = (first + k) % 50 + 1
            away = {name: _away(getattr(i, name), k % 2) for name in ("sense_sin", "sense_cos")}
            i = i._replace(drive_sin=n, drive_cos=-n, **away)
        if turn:
            i = i._replace(phase=((first + k) * turn + 2**23) % 2**24 - 2**23)
        yield i


def run(inputs, p=SHORT, s=None):
    return rows(lambda s, i: sequencer.step(p, s, 1, i), s or sequencer.State(), [(i,) for i in inputs])


def names(found):
    """The states passed, without repetition."""
    states = [sequencer.STATES[s.state] for s in found]
    return [b for a, b in zip([None, *states], states, strict=False) if a != b]


def stay(found):
    """Frames spent in each state, in order."""
    counts = []
    for s in found:
        name = sequencer.STATES[s.state]
        if counts and counts[-1][0] == name:
            counts[-1][1] += 1
        else:
            counts.append([name, 1])
    return dict(counts)


LOCKED = run(frames(LOCK_TIME))[-1]
PATH = "POWER_UP INIT IDLE STANDBY KICK DECAY SEARCH RETUNE ACQUIRE SETTLE BALANCE LOCKED".split()

change = st.one_of(
    st.just({}),
    st.just({}),
    st.sampled_from([{"adc_ok": 0}, {"stale": 1}, {"moving": False}, {"turn": 1000}, {"turn": 300_000}]),
    st.builds(
        lambda v: {"magnitude": v}, st.sampled_from([0, 99, 100, 9400, 9499, 9500, 9542, 9543, 11_000, 2**25 - 1])
    ),
    st.builds(lambda v: {"phase": v}, st.sampled_from([500_000, 500_001, -900_001, 900_001, -(2**23), 2**23 - 1])),
    st.builds(lambda v: {"sense_sin": v}, st.sampled_from([200, 201, -801, 801, -(2**23)])),
    st.builds(lambda v, r: {"sense_cos": v, "qsc_rail": r}, st.sampled_from([301, -901, 2**23 - 1]), st.integers(0, 1)),
    st.builds(lambda v: {"setpoint": v}, st.sampled_from([0, 5000, 2**24 - 1])),
    st.sampled_from([{"drive_saturated": 1}, {"rate_saturated": 1}, {"qsc_rail": 1}, {"sense_sin": 0x7FFF00}]),
    st.builds(lambda v: {"control": v | 1}, st.integers(0, 511)),
    st.builds(lambda v: {"control": v & ~128 | 1}, st.integers(0, 511)),
    st.sampled_from([{"control": 0}, {"control": 0x81}, {"control": 0x101}, {"clear": 255}, {"clear": 2}]),
)
segment = st.tuples(change, change, st.sampled_from([1, 1, 2, 3, 4, 6, 9, 14]))
start = st.sampled_from([0, 8, 12, 19, 23, 26, LOCK_TIME, LOCK_TIME + 3])


@settings(max_examples=300)
@given(st.sampled_from([SHORT, SHORT._replace(faults=FAULTS._replace(stuck=0))]), start, st.lists(segment, max_size=12))
def test_step_is_the_documented_equation(p, healthy, segments):
    inputs = list(frames(healthy))
    for a, b, n in segments:
        inputs += frames(n, len(inputs), **{**a, **b})
    assert_rows(run(inputs, p), naive.sequencer(p, inputs), sequencer.STATE_FMT)


def test_nothing_moves_without_enable():
    assert sequencer.step(SHORT, LOCKED, 0, HEALTHY._replace(control=0, adc_ok=0)) == LOCKED


def test_start_up_takes_the_times_of_its_parameters():
    found = run(frames(LOCK_TIME))
    assert names(found) == PATH
    stays = stay(found)
    assert [stays[n] for n in PATH[:-1]] == STAYS
    outputs = sequencer.outputs(found[-1])
    assert (outputs.drive_locked, outputs.locked, outputs.rate_good) == (1, 1, 1)


def test_default_times():
    p = sequencer.design()
    assert p[:9] == (2400, 16, 48, 280, 480, 240, 16000, 800, 80)
    assert p.reached / 2**16 == pytest.approx(0.95, abs=2**-17)
    assert p.search_limit * 26e6 / 2**48 == pytest.approx(80, abs=1e-6)


@pytest.mark.parametrize("hz", [-70.0, -33.3, 0.01, 55.5, 79.9])
def test_search_finds_the_frequency(hz):
    """A phase that turns at `hz` for 60 ms: the correction is `hz`, to the LSB of the phase and of the gain."""
    p = sequencer.design()
    s = sequencer.State(state=sequencer.SEARCH, control=sequencer.RUN, last_phase=0)
    phases = [round((k + 1) * hz / 8000 * 2**24) for k in range(p.search)]
    magnitude = p.min_magnitude
    inputs = [
        i._replace(phase=(v + 2**23) % 2**24 - 2**23, magnitude=magnitude)
        for i, v in zip(frames(p.search), phases, strict=True)
    ]
    last = run(inputs, p, s)[-1]
    assert last.state == sequencer.RETUNE
    lsb = 8000 / p.search / 2**24
    assert last.correction * 26e6 / 2**48 == pytest.approx(hz, rel=0.5 / p.gain, abs=0.5 * lsb + 26e6 / 2**48)
    assert sequencer.outputs(last).adjust == 1
    assert sequencer.outputs(run([HEALTHY], p, last)[-1]).adjust == 0, "once, or the centre would run away"


def test_limits_of_search_and_acquire_are_inclusive():
    s = sequencer.State(state=sequencer.SEARCH, timer=SHORT.search - 1, rotation=100_000)
    exact = SHORT._replace(search_limit=(100_000 * SHORT.gain + 2**15) >> 16)
    i = HEALTHY._replace(magnitude=SHORT.min_magnitude)
    assert sequencer.step(exact, s, 1, i).state == sequencer.RETUNE
    assert sequencer.step(exact._replace(search_limit=exact.search_limit - 1), s, 1, i).state == sequencer.KICK
    half = SHORT._replace(reached=2**15)
    s = sequencer.State(state=sequencer.ACQUIRE)
    assert sequencer.step(half, s, 1, HEALTHY._replace(magnitude=SETPOINT // 2)).state == sequencer.SETTLE
    assert sequencer.step(half, s, 1, HEALTHY._replace(magnitude=SETPOINT // 2 - 1)).state == sequencer.ACQUIRE


@pytest.mark.parametrize("what", [{"turn": 200_000}, {"turn": -200_000}, {"magnitude": 99}])
def test_failed_search_kicks_again_and_counts(what):
    found = run(frames(60, **what))
    assert "RETUNE" not in names(found)
    assert names(found).count("KICK") >= 3
    assert found[-1].attempts == names(found).count("KICK") - 1
    assert found[-1].faults.flags & fault_monitor.SEARCH_FAILED
    again = run(frames(40, 60), s=found[-1])
    assert again[-1].state == sequencer.LOCKED
    assert again[-1].faults.flags == 0
    assert again[-1].faults.latch == fault_monitor.SEARCH_FAILED


def test_attempts_saturate():
    s = sequencer.State(state=sequencer.SEARCH, timer=4, attempts=255)
    after = sequencer.step(SHORT, s, 1, HEALTHY._replace(magnitude=0))
    assert (after.state, after.attempts) == (sequencer.KICK, 255)


@pytest.mark.parametrize("what", [{"magnitude": 9499}, {"phase": 2**22}])
def test_acquire_and_settle_give_up(what):
    """95 % is never reached; or it is, but the phase does not lock."""
    found = run(frames(sum(STAYS[: 9 if "phase" in what else 8]) + SHORT.timeout, **what))
    assert names(found)[-2:] == ["SETTLE" if "phase" in what else "ACQUIRE", "KICK"]
    assert stay(found)["ACQUIRE" if "magnitude" in what else "SETTLE"] == SHORT.timeout
    assert found[-1].failed == 1


@pytest.mark.parametrize("what", [{"magnitude": 10_916}, {"magnitude": 9_084}, {"phase": 900_001}, {"phase": -900_001}])
def test_lost_drive_lock_switches_all_off_and_starts_again(what):
    found = run(frames(3, 50, **what), s=LOCKED)
    found += run(frames(1, 53, **what), s=found[-1])[1:]
    kick = next(s for s in found if s.state == sequencer.KICK)
    o = sequencer.outputs(kick)
    assert (o.agc_mode, o.pll_mode, o.ftr_mode, o.qsc_mode) == (agc.KICK, pi.OFF, pi.OFF, pi.OFF)
    assert (o.locked, o.drive_locked, o.rate_good, o.load) == (0, 0, 0, 1)
    again = run(frames(60, 54), s=found[-1])
    assert again[-1].state == sequencer.LOCKED
    assert again[-1].faults.latch == fault_monitor.LOST_LOCK
    assert again[-1].lost == 0


@pytest.mark.parametrize("what", [{"sense_sin": 801}, {"sense_cos": -901}])
def test_sense_errors_never_unlock_the_drive(what):
    found = run(frames(40, 50, **what), s=LOCKED)
    assert names(found) == ["LOCKED", "BALANCE"]
    o = sequencer.outputs(found[-1])
    assert (o.drive_locked, o.locked, o.ftr_mode, o.qsc_mode) == (1, 0, pi.RUN, pi.RUN)
    assert names(run(frames(9, 90), s=found[-1])) == ["BALANCE", "LOCKED"]


def test_a_railed_quadrature_loop_only_sets_its_flag():
    found = run(frames(40, 50, sense_cos=2**20, qsc_rail=1), s=LOCKED)
    assert names(found) == ["LOCKED"]
    assert found[-1].faults.flags == fault_monitor.QSC_RAIL
    assert sequencer.outputs(found[-1]).rate_good == 1


@pytest.mark.parametrize("what", [{"rate_saturated": 1}, {"drive_saturated": 1}, {"sense_sin": 0x7FFF00}])
def test_flags_that_only_tell(what):
    found = run(frames(3, 50, **what), s=LOCKED)
    assert names(found) == ["LOCKED"]
    assert found[-1].faults.flags
    assert sequencer.outputs(found[-1]).rate_good == (1 if "drive_saturated" in what else 0)


@pytest.mark.parametrize("what", [{"adc_ok": 0}, {"stale": 1}, {"moving": False}])
def test_bad_adc_holds_then_stops_then_starts_again(what):
    debounce = SHORT.faults.stuck if "moving" in what else 0
    found = run(frames(debounce + SHORT.offline + 2, 50, **what), s=LOCKED)
    modes = [sequencer.outputs(s) for s in found]
    holds = [o for o in modes if (o.agc_mode, o.pll_mode, o.ftr_mode, o.qsc_mode) == (pi.HOLD,) * 4]
    assert len(holds) == SHORT.offline, "held from the first bad frame until the drive stops"
    assert found[-1].state == sequencer.STANDBY
    assert (modes[-1].agc_mode, modes[-1].ftr_mode) == (pi.OFF, pi.OFF)
    waits = run(frames(20, 50, **what), s=found[-1])
    assert names(waits) == ["STANDBY"]
    assert run(frames(60, 50), s=waits[-1])[-1].state == sequencer.LOCKED


def test_short_dropout_holds_and_goes_on():
    found = run([*frames(SHORT.offline - 1, 50, adc_ok=0), *frames(3, 70)], s=LOCKED)
    assert names(found) == ["LOCKED"]
    assert sequencer.outputs(found[-1]).agc_mode == pi.RUN


def test_dropout_in_acquire_switches_the_drive_off():
    s = next(s for s in run(frames(40, magnitude=500)) if s.state == sequencer.ACQUIRE)
    assert sequencer.outputs(s).agc_mode == pi.P_ONLY
    s = sequencer.step(SHORT, s, 1, HEALTHY._replace(adc_ok=0))
    assert sequencer.outputs(s).agc_mode == pi.OFF
    assert sequencer.outputs(s).pll_mode == pi.HOLD


@pytest.mark.parametrize("where", ["DECAY", "SEARCH"])
def test_dropout_in_the_search_starts_the_decay_again(where):
    s = [s for s in run(frames(40, magnitude=500)) if sequencer.STATES[s.state] == where][1]
    found = run([HEALTHY._replace(adc_ok=0), *frames(30, 3, magnitude=500)], s=s)
    assert stay(found[1:])["DECAY"] == SHORT.decay
    assert stay(found[1:])["SEARCH"] == SHORT.search


def test_stop_and_start():
    found = run([*frames(3, 50, control=0), *frames(60, 53)], s=LOCKED)
    assert names(found) == ["LOCKED", "IDLE", *PATH[3:]]


def test_open_drive():
    control = sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR
    found = run(frames(5, 50, control=control), s=LOCKED)
    assert names(found) == ["LOCKED", "OPEN"]
    o = sequencer.outputs(found[-1])
    assert (o.agc_mode, o.pll_mode, o.fix_drive, o.load, o.fix_ftr, o.fix_qsc) == (pi.OFF, pi.OFF, 1, 1, 1, 0)
    assert names(run(frames(60, 55), s=found[-1]))[:3] == ["OPEN", "STANDBY", "KICK"]


@pytest.mark.parametrize(
    ("bit", "field"),
    [
        (sequencer.HOLD_AGC, "agc_mode"),
        (sequencer.HOLD_PLL, "pll_mode"),
        (sequencer.HOLD_FTR, "ftr_mode"),
        (sequencer.HOLD_QSC, "qsc_mode"),
    ],
)
def test_hold_bits_hold_one_loop_and_its_lock_is_not_judged(bit, field):
    wild = {"agc_mode": {"magnitude": 1}, "pll_mode": {"phase": 2**22}, "ftr_mode": {"sense_sin": 9999}}
    what = wild.get(field, {"sense_cos": 9999})
    found = run(frames(40, 50, control=sequencer.RUN | bit, **what), s=LOCKED)
    assert names(found) == ["LOCKED"]
    o = sequencer.outputs(found[-1])
    for name in ("agc_mode", "pll_mode", "ftr_mode", "qsc_mode"):
        assert getattr(o, name) == (pi.HOLD if name == field else pi.RUN)


@pytest.mark.parametrize(("bit", "field"), [(sequencer.FIX_FTR, "ftr"), (sequencer.FIX_QSC, "qsc")])
def test_fixed_words(bit, field):
    found = run(frames(5, 50, control=sequencer.RUN | bit, adc_ok=0, qsc_rail=1), s=LOCKED)
    o = sequencer.outputs(found[-1])
    assert (getattr(o, f"{field}_mode"), getattr(o, f"fix_{field}")) == (pi.OFF, 1)
    assert bool(found[-1].faults.flags & fault_monitor.QSC_RAIL) == (field == "ftr")
    off = sequencer.outputs(sequencer.State(state=sequencer.ACQUIRE, control=sequencer.RUN | bit))
    assert getattr(off, f"fix_{field}") == 0, "no fixed word before the drive is locked"


def test_clear_bit_clears_the_whole_latch():
    s = LOCKED._replace(faults=LOCKED.faults._replace(latch=255))
    s = sequencer.step(SHORT, s, 1, HEALTHY._replace(control=sequencer.RUN | sequencer.CLEAR_FAULTS, drive_sin=99))
    assert s.faults.latch == 0


def modes(state, **what):
    o = sequencer.outputs(sequencer.State(state=state, control=sequencer.RUN, **what))
    label = {pi.OFF: "OFF", pi.P_ONLY: "P_ONLY", pi.RUN: "RUN", pi.HOLD: "HOLD", agc.KICK: "KICK"}
    return [label[m] for m in (o.agc_mode, o.pll_mode, o.ftr_mode, o.qsc_mode)]


def test_table_of_states_of_the_header():
    """Time, modes and DAC initialisation of every state, as the header of the block prints them."""
    lines = [" ".join(line.split()) for line in sequencer.__doc__.splitlines()]
    d = sequencer.Design._field_defaults
    for k, name in enumerate(sequencer.STATES):
        time = d.get(f"{name.lower()}_s")
        shown = f"{1e3 * time:g} ms" if time else "-"
        wanted = f"{k} {name} {shown} {'/'.join(modes(k))} "
        assert any(line.startswith(wanted) for line in lines), name
    assert [sequencer.outputs(sequencer.State(state=k)).dac_init for k in range(13)] == [0, 1] + [0] * 11
    assert [sequencer.outputs(sequencer.State(state=k)).load for k in range(13)] == [1] * 6 + [0] * 7


@pytest.mark.parametrize(
    "wrong", [{"search_s": 0.6}, {"kick_s": 0}, {"timeout_s": 9.0}, {"reached": 1.1}, {"search_s": 1 / 8000}]
)
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"search_s|kick_s|timeout_s|reached|gain"):
        sequencer.design(**wrong)


@pytest.mark.parametrize("wait", ["offline_s", "recover_s"])
def test_design_refuses_a_wait_beyond_the_count_of_frames(wait):
    waits = {"offline_s": 4 / 8000, "recover_s": 4 / 8000, wait: 9 / 8000}
    assert sequencer.design(**waits, faults=fault_monitor.design(top=9)).faults.top == 9
    with pytest.raises(ValueError, match="offline_s and recover_s need 9 frames; the frame counters end at 8"):
        sequencer.design(**waits, faults=fault_monitor.design(top=8))
