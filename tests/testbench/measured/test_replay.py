"""The replayed firmware: bit for bit that of the engines, whatever happened, and fast."""

import numpy as np
import pytest

from fpga_model import registers, sequencer
from testbench.config import Config, changed
from testbench.engines import engine
from testbench.errors import ConfigError
from testbench.measured.record import replay, timing
from testbench.run import build, simulate
from testbench.run.simulation import FRAME, Simulation

CODES = ("adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos", "adc_temperature")
OTHER = {"dac_drv": "drive_dac_code", "dac_ftr": "sense_dac_code", "dac_qsc": "quadrature_dac_code"}
NAMES = [OTHER.get(name, name) for name in replay.WORDS]
COMPARED = [k for k, name in enumerate(NAMES) if name in FRAME]
assert len(COMPARED) == 13


def lived(config, story, temp_degc=25.0):
    """(simulation, log) of a board that lives through `story(simulation, write)`."""
    sim, log = Simulation(config, temp_degc, temp_degc), []

    def write(name, raw):
        entry = registers.BY_NAME[name]
        log.append((26 * sim.tick, entry.address, registers.to_bus(int(raw), entry.fmt)))
        sim.write(name, raw)

    sim.now = (np.zeros(1), np.full(1, temp_degc))
    for name, raw in sim.first_writes:
        write(name, raw)
    story(sim, write)
    sim.advance(-sim.tick % 125 + 1, 0.0, temp_degc)
    return sim, np.array(log, np.int64).reshape(-1, 3)


def stimulus(config, columns, log, silent=(), bad=()):
    """`replay.Stimulus` of what a board's rows say; frames that are silent, and those with a bad status word."""
    frames = len(columns["state"]) - 2
    frame = np.arange(1, frames + 1)
    saw = ~np.isin(frame, np.array(silent, int))
    codes = np.stack([columns[name] for name in CODES], axis=1)[2:]
    ok = (~np.isin(frame, np.array(bad, int))).astype(np.int64)
    valid = timing.valid_clock(config) + 3250 * frame
    return replay.Stimulus(np.ascontiguousarray(codes[saw]), ok[saw], valid[saw].astype(np.int64), log)


def differing(config, columns, x, plain=True):
    """{column: frames} in which a replay from power-on differs from a board's rows."""
    p, frames = build.firmware(config), len(columns["state"])
    o = replay.rows(frames)
    replay.run(p, replay.power_on(), x, o, replay.order(p), plain)
    out = {}
    for k in COMPARED:
        begin = 1 if replay.WORDS[k] in OTHER else 0  # what the chips hold at power-on is not the firmware's
        wrong = np.flatnonzero(o.words[begin:frames, k] != columns[NAMES[k]][begin:]) + begin
        if len(wrong):
            out[NAMES[k]] = wrong.tolist()
    return out


def locked(sim, write):
    simulate.start(sim.config, sim, 1.0, 25.0)
    sim.advance(50_000, -2.0, 25.0)


@pytest.fixture(scope="module")
def board():
    config = changed(Config(), {"noise.seed": 3})
    sim, log = lived(config, locked)
    return config, sim.columns(), log


@pytest.mark.parametrize("plain", [True, False])
def test_from_power_on_to_lock_every_word_and_code_is_the_boards(board, plain):
    config, columns, log = board
    assert differing(config, columns, stimulus(config, columns, log), plain) == {}


def test_one_lsb_in_one_code_would_be_seen(board):
    config, columns, log = board
    x = stimulus(config, columns, log)
    x.codes[5000, 1] += 10
    found = differing(config, columns, x)
    assert min(min(rows) for rows in found.values()) == 5002, "codes of frame 5001 act in its window: the next row"
    assert found["magnitude"] == [5002]


@pytest.mark.parametrize(
    "values",
    [
        {"firmware.pipeline_registers": 5, "firmware.frame_latency_sense": 0, "firmware.phase_sense_ref_deg": 20.0},
        {"firmware.frame_latency_drive": 2, "firmware.frame_latency_sense": 2, "firmware.quadrature_update_khz": 1000},
        {"firmware.reference_retimed": False, "firmware.phase_drive_sine_deg": -7.0, "firmware.ftr_crossover_hz": 30.0},
    ],
    ids=["pipeline", "latencies", "compensation"],
)
def test_other_bitstreams(values):
    config = changed(Config(), {**values, "noise.seed": 9})

    def story(sim, write):
        sim.advance(30_000, 0.0, 25.0)
        write("control", sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR | sequencer.FIX_QSC)
        write("amplitude_fixed", 3_000_000)
        write("rate_fixed", -2_000_000)
        write("quadrature_fixed", 1 << 30)
        sim.advance(320_000, 3.0, 25.0)

    sim, log = lived(config, story)
    columns = sim.columns()
    assert np.abs(columns["drive_dac_code"]).max() > 1000
    assert np.abs(columns["sense_dac_code"]).max() > 1000
    assert columns["quadrature_dac_code"].max() > 1000
    assert differing(config, columns, stimulus(config, columns, log)) == {}


def test_faults_writes_within_windows_and_stale_frames(board):
    """A silent converter, bad status words, and writes at every slot of a window."""
    config, _, _ = board
    silent, bad = [], []

    def during(sim, ticks, faults, frames):
        first = sim.tick // 125
        sim.faults = faults
        sim.advance(ticks, 0.5, 25.0)
        sim.faults = engine.Faults()
        frames.extend(range(first, sim.tick // 125))

    def story(sim, write):
        simulate.start(config, sim, 1.0, 25.0)
        sim.advance(-sim.tick % 125, 1.0, 25.0)
        for tick in range(14, 22):
            sim.advance(125 + tick, 1.0, 25.0)
            write("decimation", tick % 7)
            write("control", sequencer.RUN | (sequencer.HOLD_AGC if tick % 2 else 0))
            sim.advance(125 - tick - 2, 1.0, 25.0)
        during(sim, 4 * 125, engine.Faults(status=0), bad)
        sim.advance(10 * 125, 1.0, 25.0)
        during(sim, 9 * 125, engine.Faults(silent=1), silent)
        sim.advance(30 * 125, 1.0, 25.0)

    sim, log = lived(config, story)
    columns = sim.columns()
    # DRDY falls a tick before the frame in which its codes are valid
    silent, bad = (list(range(min(s) + 1, max(s) + 2)) for s in (silent, bad))
    flags = columns["flags"]
    assert flags[min(silent) + 5] != flags[min(silent) - 2], "the watchdog saw it"
    x = stimulus(config, columns, log, silent, bad)
    assert differing(config, columns, x, True) == differing(config, columns, x, False) == {}


def test_both_ways_through_a_window_give_the_same_bits(board):
    config, columns, log = board
    x, p = stimulus(config, columns, log), build.firmware(config)
    ends = []
    for plain in (True, False):
        o = replay.rows(400)
        ends.append((replay.run(p, replay.power_on(), x, o, replay.order(p), plain), o.words))
    assert ends[0][0] == ends[1][0]
    assert np.array_equal(ends[0][1], ends[1][1])


def test_codes_at_every_tick_are_the_boards(board):
    config, _, _ = board
    ticks, codes = 125 * 600, []

    class Kept(Simulation):
        def commit_chunk(self, state, streams, inside=False):
            codes.append(np.stack([streams.drive_code, streams.sense_code], axis=1))
            super().commit_chunk(state, streams, inside)

    sim = Kept(config, 25.0, 25.0)
    sim.now = (np.zeros(1), np.full(1, 25.0))
    log = []
    for name, raw in (*sim.first_writes, ("control", 1 | sequencer.OPEN_DRIVE | sequencer.FIX_FTR)):
        entry = registers.BY_NAME[name]
        log.append((26 * sim.tick, entry.address, registers.to_bus(int(raw), entry.fmt)))
        sim.write(name, raw)
    log += [(26 * sim.tick, registers.BY_NAME["amplitude_fixed"].address, 5_000_000)]
    sim.write("amplitude_fixed", 5_000_000)
    log += [(26 * sim.tick, registers.BY_NAME["rate_fixed"].address, 4_000_000)]
    sim.write("rate_fixed", 4_000_000)
    sim.advance(400_000 - sim.tick, 0.0, 25.0)
    wanted = np.concatenate(codes)
    columns, p = sim.columns(), build.firmware(config)
    x = stimulus(config, {**columns, **{k: np.append(columns[k], 0) for k in columns}}, np.array(log, np.int64))
    o = replay.rows(3200, ticks=400_000)
    replay.run(p, replay.power_on(), x, o, replay.order(p), True)
    assert np.abs(wanted[-ticks:]).max(axis=0).min() > 1000
    assert np.array_equal(o.codes[1:], wanted[1:])


def test_a_firmware_with_a_notch_is_refused():
    with pytest.raises(ConfigError, match=r"firmware\.notch_hz: a record cannot be replayed with a notch"):
        replay.order(build.firmware(changed(Config(), {"firmware.notch_hz": 139.0})))
