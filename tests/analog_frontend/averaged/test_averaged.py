"""The averaged plant's parts: short formulas to what they claim, the same noise samples, modes continuous at jumps."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend import top as plant
from analog_frontend.averaged import averaged, averaged_codes, averaged_modes, averaged_noise, averaged_sid
from analog_frontend.averaged.averaged_modes import M_SIZE, NOW_SIZE, NOW_TEMP, A, F
from analog_frontend.numeric.shapes import zeros
from analog_frontend.parts import adc, noise
from fpga_model import dds, references
from fpga_model.design_record import DEFAULT
from fpga_model.jit import hot
from fpga_model.rates import FRAME_CYCLES, TICK_CYCLES
from testbench import config
from testbench.engines import baseband_frames, baseband_setup, baseband_state
from testbench.paper.calibration import calibration_boards
from testbench.run import build
from tests.testbench.bench_setup import board as configuration
from tests.testbench.bench_setup import configured

LO_DEGC, HI_DEGC = 25.0, 26.0


@pytest.fixture(scope="module")
def params():
    return build.params(configured(), LO_DEGC, HI_DEGC)


@pytest.fixture(scope="module")
def setup(params):
    return baseband_setup.setup(params)


# ---- formulas --------------------------------------------------------------------------------------------------------


def test_unit_is_cosine_and_sine():
    for k in range(257):
        phase = (k * (1 << 48)) // 257
        cos, sin = averaged_modes.unit(phase)
        angle = 2 * math.pi * phase / 2**48
        assert abs(cos - math.cos(angle)) < 7e-12
        assert abs(sin - math.sin(angle)) < 7e-12


@pytest.mark.parametrize(("x", "bound"), [(0.12, 1e-15), (-0.12, 1e-15), (0.5, 3e-10)])
def test_small_turns(x, bound):
    cos, sin = averaged_modes.small_turn(x)
    assert abs(cos - math.cos(x)) < bound
    assert abs(sin - math.sin(x)) < bound


@pytest.mark.parametrize(("u", "bound"), [(0.0, 1e-16), (0.03, 5e-15), (0.2, 3e-9)])
def test_decay(u, bound):
    assert abs(averaged_sid.decay(u) - math.exp(-u)) < bound


@hot
def rounded(volts, lsb_v):
    return averaged_codes.rounded_sine_fundamental(volts, lsb_v)


@pytest.mark.parametrize("u", [0.03, 0.08, 0.2])
def test_droop_is_that_of_a_ladder_stepped_in_small_steps(u):
    """Runge-Kutta through one half period; the state that returns to itself, the signal being linear in it."""

    def over(w, volts, steps=400):
        h, rate = u / steps, math.pi / u
        for k in range(steps):
            w = _kutta(w, k * h, h, lambda s, w: (volts * math.sin(rate * s) - w[0], w[0] - w[1], w[1] - w[2]))
        return np.array(w)

    pushed = over((0.0, 0.0, 0.0), 1.0)
    carried = np.column_stack([over(np.eye(3)[k], 0.0) for k in range(3)])
    w = np.linalg.solve(np.eye(3) - carried, pushed)
    assert averaged_sid.droop(u) == pytest.approx(w[1] / w[2] - 1.0, rel=1e-4)


def _kutta(w, s, h, slope):
    """One step of fourth order."""
    w = np.array(w)
    k1 = np.array(slope(s, w))
    k2 = np.array(slope(s + h / 2, w + h / 2 * k1))
    k3 = np.array(slope(s + h / 2, w + h / 2 * k2))
    k4 = np.array(slope(s + h, w + h * k3))
    return w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@pytest.mark.parametrize(("codes", "bound"), [(0.3, 0.0), (0.8, 1e-4), (3.51, 1e-4), (8.2, 2e-3), (30.7, 1e-4)])
def test_the_fundamental_of_rounded_codes(codes, bound):
    """Against a sine that is rounded at two million phases, ties toward plus infinity as the modulator has them."""
    lsb_v = 3e-4
    sine = np.sin(2 * np.pi * (np.arange(2_000_000) + 0.5) / 2_000_000)
    wanted = 2 * np.mean(np.floor(codes * sine + 0.5) * sine)
    assert abs(rounded(codes * lsb_v, lsb_v) / lsb_v - wanted) <= bound


@given(st.floats(30.0, 32767.0))
def test_the_fundamental_of_rounded_codes_from_thirty_on(codes):
    """Against the sum over all codes, from which the short form comes."""
    k = np.arange(0.5, codes)
    wanted = 4 / math.pi * np.sqrt(1 - (k / codes) ** 2).sum()
    assert abs(rounded(codes, 1.0) - wanted) < 1e-4
    assert rounded(codes, 0.0) == codes


# ---- noise -----------------------------------------------------------------------------------------------------------


@hot
def _convert(p, room, own, first, frames):
    averaged_noise.convert(p, room, own, first, frames)


@hot
def _draw(on, table, room, tick, frames, frame_ticks, samples):
    averaged_noise.draw(on, table, room, tick, frames, frame_ticks, samples)


@hot
def _integral(room, row, place):
    return averaged_noise.integral(room, row, place)


@hot
def _one_by_one(p, state, number, frames, out):
    for c in range(adc.CHANNELS):
        for n in range(frames):
            pink = noise.flicker_step(p.flicker[c], state[c, adc.FRAMES :], number + n) if c < 4 else 0.0
            out[c, n] = noise.white_fine(p.white[c], number + n) + pink


@pytest.mark.parametrize("silent", ["", "white", "flicker"])
@pytest.mark.slow
def test_the_converter_has_the_samples_and_flicker_states_of_the_other_engines(params, silent):
    p, batch = params.plant.adc, averaged_noise.BATCH
    if silent:
        sources = getattr(p, silent)
        p = p._replace(**{silent: (sources[0], sources[1]._replace(on=0), *sources[2:])})
    rng = np.random.default_rng(1)
    sums = np.zeros((adc.CHANNELS, adc.FRAMES + noise.POLES))
    sums[:, adc.FRAMES :] = rng.normal(size=(adc.CHANNELS, noise.POLES))
    own, room = sums.copy(), zeros(averaged_noise.Drawn)
    for first, frames in ((0, batch), (7 * batch, batch - 3), (3_000_000_000, 2)):
        want = np.zeros((adc.CHANNELS, frames))
        _convert(p, room, own, first, frames)
        _one_by_one(p, sums, first, frames, want)
        got = room.converter.reshape(adc.CHANNELS, batch)[:, :frames]
        assert np.array_equal(got, want)
        assert np.array_equal(own[:4], sums[:4]), "so 1/f noise keeps its past, whichever engine made it"
        assert np.ptp(want) > 0


def _held_growths(ticks, hz):
    """Growth of a mode (times e^(-i phase)) in a frame from a unit of force in each of its ticks, undamped."""
    return np.exp(2j * np.pi * hz * 1e-6 * (ticks - 1 - np.arange(ticks)))


@pytest.mark.parametrize("frame_ticks", [*(pytest.param(n, marks=pytest.mark.slow) for n in (50, 250, 426)), 123, 125])
def test_cv_and_force_samples_are_the_held_ones(params, frame_ticks):
    """A sample stands for five ticks from a multiple of five on, however many of them a frame has."""
    on, room, tick = params.plant.noise, zeros(averaged_noise.Drawn), frame_ticks * 1234
    grown = [_held_growths(frame_ticks, hz) for hz in (11_002.0, 10_863.0)]
    values = [np.exp(2j * np.pi * hz * 1e-6) for hz in (11_002.0, 10_863.0)]
    force = averaged._noise_sample_growth([3.0, 1j, 2.0, 5.0 - 1j], values, frame_ticks, noise.HOLD)
    table = averaged_noise.table(force)
    frames, samples = averaged_noise.batch(table, frame_ticks)
    _draw(on, table, room, tick, frames, frame_ticks, samples)
    names = ("cv_x", "cv_y", "force_x", "force_y", "drive_dac", "sense_dac")
    ticks = range(tick, tick + frames * frame_ticks)
    held = {name: np.array([noise.hold_sample(getattr(on, name), t) for t in ticks]) for name in names}
    for row, name in ((0, "cv_x"), (averaged_noise.ROW, "cv_y")):
        begun = tick % noise.HOLD / noise.HOLD
        seen = [_integral(room, row, begun + n * frame_ticks / noise.HOLD) for n in range(frames + 1)]
        wanted = held[name].reshape(frames, frame_ticks).sum(axis=1) / noise.HOLD
        assert np.diff(seen) == pytest.approx(wanted, abs=1e-11 * np.abs(wanted).max())
    for n in range(frames):
        part = slice(n * frame_ticks, (n + 1) * frame_ticks)
        x = grown[0] @ (3.0 * held["force_x"][part] + 2.0 * held["drive_dac"][part])
        y = grown[1] @ (1j * held["force_y"][part] + (5.0 - 1j) * held["sense_dac"][part])
        assert room.growth[4 * n : 4 * n + 4] == pytest.approx([x.real, x.imag, y.real, y.imag], rel=1e-8), n


# ---- edges -----------------------------------------------------------------------------------------------------------

DRIVE_HZ, TURN_CLOCK, TURN = (11_001.1001, 3_925.29, 14_000.7, 21_990.3), 461, 1 << dds.PHASE.width


@hot
def _demodulate(p, q, phase, old, turn_clock, turn_phase, new, offsets, base, cubic, poles, volts, sums):
    turn, noise = (turn_clock, turn_phase, new), (volts, sums, 100)
    averaged_sid.demodulate(p, q, (phase, old), turn, offsets, base, cubic, poles, noise, 0.0)


def _pins(p, phase, words, offsets):
    """The four pins of the firmware at every clock of len(words) - 1 frames; a word changes at TURN_CLOCK."""
    d, r, out = dds.State(phase=phase), references.State(), []
    for old, new in itertools.pairwise(words):
        for clock in range(FRAME_CYCLES):
            out.append(references.pins(p, r))
            r = references.step(DEFAULT, p, r, d.drive_ref, d.sense_ref, int(clock % TICK_CYCLES == 0))
            d = dds.step(DEFAULT, d, old if clock < TURN_CLOCK else new, 0, 0, *offsets)
    return np.array(out)[:, None] >> np.arange(4) & 1


def _cases(word):
    rng = np.random.default_rng(1)
    for _ in range(6):
        words = [int(w) for w in word + rng.integers(-word // 200, word // 200, 7)]
        yield int(rng.integers(TURN)), words, tuple(int(v) for v in rng.integers(TURN, size=2))
    # a crossing at a clock, an LSB before and after it, with which an edge comes a tick later
    for clock in (26 * 70 - 3, 26 * 70 - 2, 26 * 70 - 1):
        for past in (-1, 0, 1):
            yield (TURN // 2 - (FRAME_CYCLES + clock) * word + past) % TURN, [word] * 7, (0, TURN // 8)


@pytest.mark.slow
@pytest.mark.parametrize("drive_hz", DRIVE_HZ)
@pytest.mark.parametrize("retimed", [True, False], ids=["retimed", "any clock"])
def test_edges_are_those_of_the_firmware_clock_by_clock(setup, retimed, drive_hz):
    """Where the words agree the edges agree: no reference slips a tick in one engine and not in another."""
    align = setup.sid.delay - 2
    p = references.design(align, retimed)
    sid = setup.sid._replace(retimed=int(retimed), edges=baseband_setup.most_edges(DEFAULT, drive_hz))
    for phase, words, offsets in _cases(dds.word_of_hz(drive_hz)):
        pins = _pins(p, phase, words, offsets)
        q = np.zeros(4 * averaged_sid.Q_ROWS)
        q[4 * averaged_sid.WAITING :][:4] = -1.0
        q[4 * averaged_sid.SIGN :][:4] = 1.0
        for n, (old, new) in enumerate(itertools.pairwise(words)):
            turned = (phase + TURN_CLOCK * old) % TURN
            room = np.zeros(8), np.zeros(24), (0.0,) * 8, np.zeros(200), np.zeros(200)
            _demodulate(sid, q, phase, old, TURN_CLOCK, turned, new, offsets, *room)
            phase = (turned + (FRAME_CYCLES - TURN_CLOCK) * new) % TURN
            for d in range(4 if n > 2 else 0):  # what waits for the first frame is not known
                # row n is what clock n finds, so what differs in row n + 1 has changed at clock n
                edges = np.flatnonzero(np.diff(pins[:, d])) - (n + 1) * FRAME_CYCLES + sid.switch
                acted = edges[edges < 0][-2:]
                found = [q[4 * row + d] for row in (averaged_sid.BEGAN, averaged_sid.CLOSED_AT)]
                assert found == pytest.approx(acted, abs=1e-6), (words, offsets, n, d)


# ---- a ringing envelope ----------------------------------------------------------------------------------------------

FRAMES, SETTLED = 1200, 800  # 0.1 s: the three stages of 50 Hz have forgotten their start to 1e-10


@hot
def _frame(u, sid, q, phase, word, turned, base, cubic, volts, sums):
    poles = baseband_state.poles_at(u, word)
    baseband_frames._tilde(u, cubic, poles)
    averaged_sid.bases(0, 0, base)
    turn, noise = (u.turn_clock, turned, word), (volts, sums, 100)
    averaged_sid.demodulate(sid, q, (phase, word), turn, (0, 0), base, cubic, poles, noise, 0.0)


def _averaged(u, sid, word, envelope):
    """Sums of sinc3 of the sense demodulators (frames, 2), the signal in each e^(envelope t + i theta), t in clocks."""
    q, phase, k, sums = np.zeros(4 * averaged_sid.Q_ROWS), 0, u.moments, []
    q[4 * averaged_sid.WAITING :][:4] = -1.0
    q[4 * averaged_sid.SIGN :][:4] = 1.0
    for n in range(FRAMES):
        v0, v1 = (np.exp(envelope * clock) for clock in (n * u.frame_clocks, (n + 1) * u.frame_clocks))
        d0, d1 = envelope * u.frame_clocks * v0, envelope * u.frame_clocks * v1
        cubic = np.array([v0, d0, 3 * (v1 - v0) - 2 * d0 - d1, d0 + d1 - 2 * (v1 - v0), 0, 0])
        cubic = np.stack([cubic.real, cubic.imag] * 2, axis=1).ravel()
        turned = (phase + u.turn_clock * word) % TURN
        _frame(u, sid, q, phase, word, turned, np.zeros(8), cubic, np.zeros(200), np.zeros(200))
        phase = (turned + (u.frame_clocks - u.turn_clock) * word) % TURN
        s, slope = (q[4 * row + 2 : 4 * row + 4] for row in (averaged_sid.S, averaged_sid.SLOPE))
        sums.append(k[:, :1] * s + k[:, 1:] * slope)
    sums = np.array(sums)
    return sums[2:, 2] + sums[1:-1, 1] + sums[:-2, 0]


def _stepped(u, sid, word, tone, quarter, period, n):
    """The same of one demodulator: three stages from edge to edge and sample to sample, exact for a tone."""
    poles = (1 / (1 + tone * sid.rc)) ** np.arange(1, 4)

    def after(caps, t0, t):
        d, x = caps - (poles * np.exp(tone * t0)).real, (t - t0) / sid.rc
        held = np.array([d[0], d[1] + x * d[0], d[2] + x * d[1] + x * x / 2 * d[0]])
        return math.exp(-x) * held + (poles * np.exp(tone * t)).real

    caps, on, last, halves, out = np.zeros((2, 3)), 1, 0.0, 0, []
    for clock in (f * u.frame_clocks + m * period for f in range(FRAMES) for m in range(n)):
        while (edge := -(-((halves + 1) * TURN // 2 - quarter) // word) + sid.delay - 1.0 + sid.switch) <= clock:
            if edge > last:
                caps[on] = after(caps[on], last, edge)
                last = edge
            on, halves = 1 - on, halves + 1
        now = after(caps[on], last, clock)[2] - caps[1 - on][2]
        out.append(now if on else -now)
    frames, m = np.reshape(out, (FRAMES, n)), np.arange(n)
    third = m * (m - 1) / 2, (n + m - 1) * (n + m) / 2 - 3 * m * (m - 1) / 2, (n - m) * (n - m + 1) / 2
    return frames[2:] @ third[2] + frames[1:-1] @ third[1] + frames[:-2] @ third[0]


@pytest.mark.parametrize(
    ("board", "ring_hz"),
    [pytest.param("published_3k9", 53.16, marks=pytest.mark.slow), ("published_3k9", -53.16), ("paper", -139.0)],
)
def test_a_ringing_envelope_is_demodulated_to_a_quarter_of_its_second_derivative(board, ring_hz):
    """Codes of an envelope that turns beside theta: a term of second order that is left out is (ring / f)^2."""
    checked = config.changed(configuration(board), {"firmware.reference_retimed": False})
    p = build.params(checked, LO_DEGC, LO_DEGC)
    u, word = baseband_setup.setup(p), dds.word_of_hz(checked.plant.fx_hz)
    sid = u.sid._replace(charge=(0.0,) * 6, charge_slope=0.0)
    envelope = 2j * math.pi * ring_hz * u.clock_s
    found = _averaged(u, sid, word, envelope)[SETTLED:]
    period, n = p.plant.adc.period / adc.UNITS_PER_CYCLE, p.plant.adc.decimation
    for d, quarter in enumerate((0, TURN // 4)):
        tone = envelope + 2j * math.pi * word / TURN
        wanted = _stepped(u, sid, word, tone, quarter, period, n)[SETTLED:]
        error = np.std(found[:, d] - wanted) / np.std(wanted)
        assert error < (ring_hz / checked.plant.fx_hz) ** 2 / 4, (d, error)


# ---- basis -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("board", [None, 2, 5, 16])
def test_columns_of_the_basis_are_eigenvectors_of_the_tick_of_every_board(board):
    """To rounding: iterations in doubles left 1e-4 of board 2's sense mode, 1e-8 of the drive modes of 5 and 16."""
    checked = config.Config() if board is None else calibration_boards.draw(config.Config(), 1, board)
    g = build.params(checked, LO_DEGC, LO_DEGC).plant.tables.g_jet[0][0]
    m = [[float(g[k][i]) for k in averaged.MODE] for i in averaged.MODE]
    values, basis = averaged._eigen(m)
    for j, value in enumerate(values):
        column = [row[j] for row in basis]
        assert column[2 * j] == 1.0
        for i in range(4):
            assert abs(sum(m[i][k] * column[k] for k in range(4)) - value * column[i]) < 1e-15


# ---- modes -----------------------------------------------------------------------------------------------------------


@hot
def _there_and_back(u, p, now, m, cos, sin, z, out):
    averaged_modes.compute_frame_tables(u.knots, p.temp_lo_degc, p.temp_step_k, now, 0.5, 1e-4, 25.3)
    averaged_modes.project_slow_amplitudes(now, m, cos, sin, z[0], z[1], z[2], z[3])
    averaged_modes.motion(now, m, cos, sin, out, 0)


@hot
def _jumped(u, p, now, m, cos, sin, rate, volts_squared, temp, z, out):
    averaged_modes.motion(now, m, cos, sin, z, plant.X)
    averaged_modes.retune_tables(
        u.knots, p.temp_lo_degc, p.temp_step_k, now, m, rate, volts_squared, temp, cos, sin, z, plant.X
    )
    averaged_modes.motion(now, m, cos, sin, out, 0)


@pytest.fixture
def moving(params, setup):
    now, m, out = np.full(NOW_SIZE, np.inf), np.zeros(M_SIZE), np.zeros(4)
    z = np.array([3e-6, -4e-6, 2e-9, 1e-9])
    m[F : F + 4] = 0.1, 0.02, 0.03, -0.01
    cos, sin = math.cos(1.1), math.sin(1.1)
    _there_and_back(setup, params.plant, now, m, cos, sin, z, out)
    assert out == pytest.approx(z, rel=1e-11)
    return now, m, cos, sin


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "volts_squared", "temp", "bound"),
    [(3.0, 20.0, 25.3, 1e-8), (0.5, 18.0, 25.3, 1e-8), (0.5, 20.0, 25.3 + 3e-4, 1e-11), (1.0, 19.0, 25.31, 1e-9)],
    ids=["rate", "V_q", "temperature of a frame", "all"],
)
def test_the_modes_go_on_where_their_tables_jump(params, setup, moving, rate, volts_squared, temp, bound):
    now, m, cos, sin = moving
    z, out = np.zeros(16), np.zeros(4)
    before = m[A : A + 4].copy()
    _jumped(setup, params.plant, now, m, cos, sin, rate, volts_squared, temp, z, out)
    assert now[NOW_TEMP] == temp
    assert np.abs(out - z[plant.X : plant.X + 4]).max() < bound * 5e-6
    assert not np.array_equal(m[A : A + 4], before), "the slow amplitudes have taken the jump"
