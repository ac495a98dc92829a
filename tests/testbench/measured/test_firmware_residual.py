"""R0: no blame for a sound firmware, and every planted change of the firmware found, with tick and register."""

import copy
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fpga_model.rates import FRAME_CYCLES
from testbench.config import Config
from testbench.measured.record import checks, firmware_residual, load_record, produce, recording_plan, replay, schema
from testbench.measured.record.sessions import sessions, stimulus
from testbench.run import build
from testbench.storage.record import Column, TableColumn, write_record
from tests.testbench.measured import planted

ROOT = Path(__file__).resolve().parents[3]
FRAMES = 160


def test_a_sound_firmware_is_not_blamed(small):
    residual = firmware_residual.residual(small)
    assert residual.verdict == f"R0 is 0 LSB in {residual.frames} frames of 14 streams"
    assert len(sessions(small)) == 4
    assert not residual.left_out


@pytest.mark.slow
def test_a_hundred_records_without_blame(tree):
    """Random boards, rates, amplitudes and bitstreams."""
    rng = np.random.default_rng(17)
    for k in range(100):
        conditions = [{"id": "a", "rate_dps": float(rng.uniform(-300, 300)), "a_um": float(rng.uniform(2, 6))}]
        conditions[0] |= {"seconds": 0.02, "settle_s": 0.0, "detune_deg": float(rng.uniform(-10, 10))}
        values = {
            "plant.fx_hz": 11002.3 + float(rng.uniform(-20, 20)),
            "firmware.pipeline_registers": int(rng.integers(0, 9)),
            "firmware.frame_latency_sense": int(rng.integers(0, 3)),
            "firmware.ftr_crossover_hz": float(rng.uniform(8, 20)),
            "effects.duffing_k3_per_um2": float(rng.uniform(-1e-6, 1e-6)),
        }
        record = produce.record(
            recording_plan.from_dict({**tree, "repeats": 1, "seed": k, "set": values, "condition": conditions})
        )
        residual = firmware_residual.residual(record)
        assert residual.decidable
        assert residual.first is None, (k, residual.verdict)


# ---- a record that begins in the middle ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def middle(small):
    """FRAMES locked frames of a record, with the registers that they begin with."""
    session, p = sessions(small)[0], build.firmware(Config())
    begin = session.frames - FRAMES
    x = stimulus(small, session)
    s = replay.run(p, replay.power_on(), x, replay.rows(begin), replay.order(p), True)
    record = copy.deepcopy(small)
    for name, column in record.streams.items():
        record.streams[name] = column._replace(data=column.data[begin : begin + FRAMES])
    for name in ("power_on", "registers", "gaps"):
        record.tables[name] = {k: TableColumn(c.data[:0], c.unit) for k, c in record.tables[name].items()}
    values = firmware_residual.initial_values(s)
    record.tables["initial"] = {
        "name": TableColumn(np.array(firmware_residual.initial_names()), ""),
        "raw": TableColumn(np.array(values, np.int64), "word"),
    }
    return record


def test_a_record_that_begins_in_the_middle_can_be_decided_from_its_registers(middle):
    residual = firmware_residual.residual(middle)
    assert residual.verdict == f"R0 is 0 LSB in {FRAMES} frames of 14 streams"


def test_without_them_it_cannot(middle):
    record = copy.deepcopy(middle)
    table = record.tables["initial"]
    record.tables["initial"] = {k: TableColumn(c.data[1:], c.unit) for k, c in table.items()}
    residual = firmware_residual.residual(record)
    why = "frame 0 is not a power-on, and /initial does not contain every register"
    assert residual.verdict == f"R0 not decidable: {why}"
    assert residual.first is None


def test_what_was_not_recorded_is_left_out_and_said(small):
    record = copy.deepcopy(small)
    record.streams.pop("adc_temperature")
    residual = firmware_residual.residual(record)
    assert residual.left_out == {"rate_output": "adc_temperature is not recorded"}
    assert residual.first is None
    record.streams.pop("adc_ok")
    assert firmware_residual.residual(record).verdict == "R0 not decidable: adc_ok is not recorded"


# ---- planted changes -------------------------------------------------------------------------------------------------


def worded(record, words):
    """The record with the words and codes of another firmware."""
    record = copy.deepcopy(record)
    for name, source in schema.REPLAYED.items():
        if name in record.streams:
            column = record.streams[name]
            data = words[: len(column.data), replay.WORDS.index(source)].astype(column.data.dtype)
            if name in schema.DAC:
                data[0] = column.data[0]
            record.streams[name] = column._replace(data=data)
    return record


def first_difference(clean, words):
    """Frame at which any recorded stream differs, computed apart from the residual."""
    other = worded(clean, words)
    rows = [
        int(np.flatnonzero(clean.streams[name].data != other.streams[name].data)[0])
        for name in schema.REPLAYED
        if name in clean.streams and (clean.streams[name].data != other.streams[name].data).any()
    ]
    return min(rows)


@pytest.fixture(scope="module")
def words(middle, tmp_path_factory):
    """Words of every firmware whose steps are changed, from an interpreted process."""
    folder = tmp_path_factory.mktemp("planted")
    x = stimulus(middle, sessions(middle)[0])
    initial = middle.tables["initial"]["raw"].data
    np.savez(folder / "in.npz", codes=x.codes, ok=x.ok, valid=x.valid, initial=initial)
    code = "import sys; from tests.testbench.measured import planted; planted.main(*sys.argv[1:])"
    subprocess.run(
        [sys.executable, "-c", code, folder / "in.npz", folder / "out.npz"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        check=True,
        timeout=300,
    )
    return dict(np.load(folder / "out.npz"))


@pytest.mark.slow
def test_interpreted_and_compiled_firmware_agree(middle, words):
    assert firmware_residual.residual(worded(middle, words["none"])).first is None


def blamed(clean, words, wanted):
    first = firmware_residual.residual(worded(clean, words)).first
    assert first is not None, "the change is not seen"
    assert first.edge == FRAME_CYCLES * first_difference(clean, words)
    assert first.tick * 26 == first.edge
    assert first.recorded != first.replayed
    named = (first.register, *first.also)
    assert any(part in register for register in named[:1] for part in wanted.split()), (named, wanted)
    assert str(first.tick) in str(first)
    assert first.register in str(first)


@pytest.mark.parametrize("name", planted.PLANTS)
def test_a_changed_step_is_found_and_named(middle, words, name):
    blamed(middle, words[name], planted.PLANTS[name][3])


def _control(p, **loops):
    return p._replace(control=p.control._replace(**loops))


def _loop(p, name, **values):
    block = getattr(p.control, name)
    return _control(p, **{name: block._replace(loop=block.loop._replace(**values))})


def _higher(p, name, gain):
    """A gain of a loop higher by a thousandth: a rounding of its design that went wrong."""
    value = getattr(getattr(p.control, name).loop, gain)
    return _loop(p, name, **{gain: value + max(1, value // 1000)})


def _lsb(p, name):
    """The integral gain of a loop an LSB higher."""
    return _loop(p, name, ki=getattr(p.control, name).loop.ki + 1)


def _lock(p):
    lock = p.control.sequencer.lock._replace(limit_out=(1, 1, 1, 1), frames_out=(4, 4, 4, 4))
    return _control(p, sequencer=p.control.sequencer._replace(lock=lock))


# name: (changed parameters, registers of which one must be named first)
CHANGED = {
    "kp of the AGC a thousandth higher": (lambda p: _higher(p, "agc", "kp"), "agc.loop"),
    "kp of the PLL a thousandth higher": (lambda p: _higher(p, "frequency_tracker", "kp"), "frequency_tracker"),
    "kp of the FTR a thousandth higher": (lambda p: _higher(p, "rate_loop", "kp"), "rate_loop"),
    "ceiling of the AGC too low": (lambda p: _loop(p, "agc", hi=80_000), "agc.loop"),
    "limit of the FTR too low": (lambda p: _loop(p, "rate_loop", hi=500_000), "rate_loop flags"),
    "lock monitor too strict": (_lock, "lock.locked"),
    "a register more before the modulators": (
        lambda p: p._replace(pipe=p.pipe._replace(depth=p.pipe.depth + 1)),
        "drive_modulator sense_modulator",
    ),
    "sense frame sent at once": (
        lambda p: p._replace(sense_modulator=p.sense_modulator._replace(frames=0)),
        "sense_modulator",
    ),
    "drive code a frame late": (
        lambda p: p._replace(drive_modulator=p.drive_modulator._replace(frames=1)),
        "drive_modulator",
    ),
}
assert len(planted.PLANTS) + len(CHANGED) >= 20


@pytest.mark.parametrize("name", CHANGED)
def test_a_changed_parameter_is_found_and_named(middle, name):
    change, wanted = CHANGED[name]
    p = change(build.firmware(Config()))
    x, o = stimulus(middle, sessions(middle)[0]), replay.rows(FRAMES)
    initial = firmware_residual.initial_side(middle.tables["initial"]["raw"].data.tolist())
    replay.run(p, initial, x, o, replay.order(p), True)
    blamed(middle, o.words, wanted)


@pytest.mark.parametrize("name", ["agc", "frequency_tracker", "rate_loop", "quadrature_loop"])
def test_a_gain_one_lsb_off_is_found_where_integrators_are_recorded(middle, words, name):
    """6e-8 of a word LSB per LSB of error: the integrator shows it at once."""
    p = _lsb(build.firmware(Config()), name)
    x, o = stimulus(middle, sessions(middle)[0]), replay.rows(FRAMES)
    initial = firmware_residual.initial_side(middle.tables["initial"]["raw"].data.tolist())
    replay.run(p, initial, x, o, replay.order(p), True)
    late = firmware_residual.residual(worded(middle, o.words)).first
    assert late is None or late.tick > 10 * 125, "only the wide frequency word shows it within 20 ms, after a while"
    clean = copy.deepcopy(middle)
    for key in ("agc_acc", "pll_acc", "ftr_acc", "qsc_acc"):
        data = words["none"][:FRAMES, replay.WORDS.index(key)]
        clean.streams[key] = Column(data, "word", 1, FRAME_CYCLES, 0, {})
    first = firmware_residual.residual(worded(clean, o.words)).first
    assert first.register == f"control.{name}.loop.acc"
    assert first.tick == 125, "the first window"


def test_a_write_that_the_log_does_not_hold_is_found(middle):
    record = copy.deepcopy(middle)
    table = record.tables["initial"]
    row = table["name"].data.tolist().index("registers.amplitude_setpoint")
    raw = table["raw"].data.copy()
    raw[row] += 1
    table["raw"] = TableColumn(raw, "word")
    assert "control.agc" in firmware_residual.residual(record).first.register


def test_a_board_with_another_firmware_in_the_closed_loop(tree, monkeypatch):
    """The whole way: a simulated board whose rate loop is an LSB off, its record, the finding, the override."""
    sound = build.firmware

    def unsound(config):
        return _higher(sound(config), "rate_loop", "kp")

    condition = [{"id": "a", "rate_dps": 50.0, "seconds": 0.02, "settle_s": 0.0}]
    wanted = recording_plan.from_dict({**tree, "repeats": 1, "condition": condition})
    monkeypatch.setattr("testbench.run.build.firmware", unsound)
    record = produce.record(wanted)
    monkeypatch.undo()
    record.attrs["bitstream_sha256"] = schema.bitstream_sha256(build.firmware(Config()))
    assert [f.rule for f in checks.check(record)] == ["R14"]
    first = firmware_residual.residual(record).first
    assert first.register == "control.rate_loop.loop.y"
    words = record.streams["rate_word"].data
    assert first.recorded == words[first.edge // FRAME_CYCLES]


def test_physics_is_blocked_until_overridden_in_writing(middle, tmp_path, own):
    codes = own.streams["adc_xQ"].data.copy()
    codes[6000] += 100
    own.streams["adc_xQ"] = own.streams["adc_xQ"]._replace(data=codes)
    write_record(tmp_path / "a.h5", own)
    loaded = load_record.load(tmp_path / "a.h5")
    assert loaded.is_blocked
    (finding,) = loaded.findings
    assert str(finding).startswith("R16 /streams/magnitude expected 0 LSB, found control.cordic.magnitude at tick 750")
    own.attrs[load_record.OVERRIDE] = "probe touched the pin; J. Doe"
    write_record(tmp_path / "a.h5", own)
    loaded = load_record.load(tmp_path / "a.h5")
    assert not loaded.is_blocked
    assert "overridden: probe touched the pin; J. Doe" in str(loaded.findings[0])
