"""One plant tick as one matrix: its second-order jet in rate and coupling, and the columns of a step within the tick.

    out[i] = sum_j G[j, i] in[j],  j = 0 .. 23 in this order from 0.0         the frozen partition of the plant
    in     z[0:16], u_drive, du_drive, u_sense, du_sense, jit_drive, jit_sense, f_x, f_y
    out    z'[0:16], px1, px2, px3, py1, py2, py3, 0, 0
    z      0..2 drive output chain, 3..5 sense output chain (V, last = electrode)   6..9 x, x'/W, y, y'/W (m)
           10..12 drive C/V, 13..15 sense C/V (V, last = SID input)
    G      = G0 + O G1 + K G2 + O^2 G3 + O K G4 + K^2 G5      O rate (rad/s), K = k_xy total (N/m): `combine`

    chains        tau_n v_n' = v_(n-1) - v_n, from the DAC output held over the tick to the electrode
    resonator     see resonator.py; F = k_vf electrode + f
    C/V           tau_r c_1' = g x - c_1;  tau_ina c_2' = c_1 - c_2;  tau_drv c_3' = signal_gain c_2 - c_3
    px, py        the SID's closed path over the tick, from zero:  RC w_1' = c_3 - w_1,  RC w_n' = w_(n-1) - w_n
    pickoff       c and p from zero for the cubic through x and x' at both ends of the tick: the engines use it, not the
                  entries of G from all inputs to c and p. Gain error (w h)^4/720 = 3.2e-8, phase below 1e-9 rad
    u, du, jit    u is the old output over the whole tick; du = new - old acts from t_c on, so its column is the step
                  response of duration h - t_c; jit is the derivative of that column by t_c, weight du * (edge error, s)
    t_c           c Tc + analog delay, modulo h; carry[c] counts the ticks by which that falls later

Every entry is the nearest double
    * Generator and durations are double-doubles of 240-bit numbers, error below 2^-106. All later arithmetic is
      double-double, from + - * of doubles alone: no libm, BLAS or FMA, no open order, so every machine has the same.
    * e^(A Tc) is a Taylor sum at a norm of at most 1, squared; the rest are products. Below 2^14 multiply-adds stand in
      line at a condition of at most e^4: relative error below 2^-84, so one entry in 2^30 may miss the nearest double.
Truncation   third order left out: 4/3 (O h)^3, which is 9e-16 at 500 deg/s, 5e-11 of the Coriolis entry it belongs to
Temperature  `knots` builds tables every `step_k`; linear between them errs by step^2/8 of the second derivative. At
             0.5 K the damping is off by less than 2e-6 of itself (the chord of e^(j w h), and Q(T) being curved), the
             frequency by (tcf step)^2/8 = 2.3e-11 of itself (w^2 in the generator is a parabola in T)
Source       docs/plant.md, docs/decisions/0003-double-double-propagators.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.exact import MP, split
from analog_frontend.numeric.vector import load, splat, store
from analog_frontend.parts import resonator, thermal
from fpga_model.jit import inlined, kernel

INPUTS = 24
OUTPUTS = 24
JETS = 6

# inputs of a tick beyond the 16 states, and outputs beyond them
U_DRIVE, DU_DRIVE, U_SENSE, DU_SENSE, JIT_DRIVE, JIT_SENSE, F_X, F_Y = range(16, 24)
PX1, PY1 = 16, 19

# states of the generator: z, the SID response, then the inputs that are constant over a tick
DRIVE, SENSE, MODES, DRIVE_CV, SENSE_CV, DRIVE_SID, SENSE_SID = 0, 3, 6, 10, 13, 16, 19
INPUT_DRIVE, INPUT_SENSE, INPUT_FX, INPUT_FY = range(22, 26)
SIZE = 26
TICK_COLUMNS = tuple(range(16)) + (INPUT_DRIVE, INPUT_SENSE, INPUT_FX, INPUT_FY)
JET_ROWS = tuple(range(16)) + (U_DRIVE, U_SENSE, F_X, F_Y)

# jet j is the coefficient of O^p K^q
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
SHIFT = np.array(
    [[POWERS.index((p + a, q + b)) if p + a + q + b <= 2 else -1 for p, q in POWERS] for a, b in POWERS[:3]]
)
PAIRS = np.array(
    [
        (POWERS.index((p + a, q + b)), i, j)
        for i, (p, q) in enumerate(POWERS)
        for j, (a, b) in enumerate(POWERS)
        if p + a + q + b <= 2
    ]
)

# Taylor terms for a norm of 1 (whole matrix) and of 4 (one column); both leave less than 2^-110
MATRIX_TERMS = 32
COLUMN_TERMS = 60
RECIPROCALS = np.array([(0.0, 0.0), *(split(MP.mpf(1) / n) for n in range(1, COLUMN_TERMS + 1))])


class Plant(NamedTuple):
    """Tables of one device at one temperature; the last axis of every table is the output of the tick."""

    g_jet: np.ndarray  # (6, 24, 24) [jet, input, output]; the rows of du and jit are zero
    drive_step: np.ndarray  # (6, 26, 24) [jet, cycle, output]
    sense_step: np.ndarray
    drive_jitter: np.ndarray  # derivative of *_step by the instant, 1/s
    sense_jitter: np.ndarray
    drive_carry: np.ndarray  # (26,) whole ticks by which the instant falls later
    sense_carry: np.ndarray
    pickoff: np.ndarray  # (2, 4, 6) [channel; x, x'/W, and both a tick later; c_1 c_2 c_3 p_1 p_2 p_3]
    tick_s: float
    kxy_n_per_m: float
    kq_n_per_m_per_v2: float
    drive_gain_v_per_m: float  # x to the first C/V pole, before the signal gain
    sense_gain_v_per_m: float
    drive_ring_s: float
    sense_ring_s: float
    ina_s: float
    driver_s: float
    signal_gain: float  # with driver_s: the slope of the SID input is (signal_gain c_2 - c_3) / driver_s
    sid_rc_s: float


@inlined
def _two_sum(a, b):
    """a + b exactly, as sum and rest."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@inlined
def _two_prod(a, b):
    """a * b exactly, as product and rest (Dekker: split at 27 bits)."""
    p = a * b
    t = 134217729.0 * a
    a1 = t - (t - a)
    a2 = a - a1
    t = 134217729.0 * b
    b1 = t - (t - b)
    b2 = b - b1
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


@inlined
def _fma(sh, sl, ah, al, bh, bl):
    """s + a b; the low word gathers the rests and is not normalised yet."""
    p, e = _two_prod(ah, bh)
    s, t = _two_sum(sh, p)
    return s, sl + (t + (e + (ah * bl + al * bh)))


@kernel
def multiply(ah, al, bh, bl):
    """Product of two jets of matrices; structural zeros cost nothing."""
    size, width = ah.shape[1], bh.shape[2]
    ch = np.zeros((JETS, size, width))
    cl = np.zeros((JETS, size, width))
    for n in range(PAIRS.shape[0]):
        out, jet_a, jet_b = PAIRS[n]
        for i in range(size):
            for k in range(size):
                x = ah[jet_a, i, k]
                if x != 0.0:
                    for m in range(width):
                        if bh[jet_b, k, m] != 0.0:
                            ch[out, i, m], cl[out, i, m] = _fma(
                                ch[out, i, m], cl[out, i, m], x, al[jet_a, i, k], bh[jet_b, k, m], bl[jet_b, k, m]
                            )
    for j in range(JETS):
        for i in range(size):
            for m in range(width):
                ch[j, i, m], cl[j, i, m] = _two_sum(ch[j, i, m], cl[j, i, m])
    return ch, cl


@kernel
def taylor(entry_indices, value, terms, xh, xl):
    """Sum over k = 0 .. terms of (A^k / k!) X; A is sparse: entry_indices (row, column, jet), value (hi, lo)."""
    sum_h = xh.copy()
    sum_l = xl.copy()
    width = xh.shape[2]
    for k in range(1, terms + 1):
        yh = np.zeros(xh.shape)
        yl = np.zeros(xh.shape)
        for e in range(entry_indices.shape[0]):
            row, col, jet = entry_indices[e]
            ah, al = _fma(0.0, 0.0, value[e, 0], value[e, 1], RECIPROCALS[k, 0], RECIPROCALS[k, 1])
            for j in range(JETS):
                out = SHIFT[jet, j]
                if out >= 0:
                    for m in range(width):
                        if xh[j, col, m] != 0.0:
                            yh[out, row, m], yl[out, row, m] = _fma(
                                yh[out, row, m], yl[out, row, m], ah, al, xh[j, col, m], xl[j, col, m]
                            )
        for j in range(JETS):
            for i in range(xh.shape[1]):
                for m in range(width):
                    h, rounding_error = _two_sum(yh[j, i, m], yl[j, i, m])
                    yh[j, i, m], yl[j, i, m] = h, rounding_error
                    s, t = _two_sum(sum_h[j, i, m], h)
                    sum_h[j, i, m], sum_l[j, i, m] = _two_sum(s, t + (sum_l[j, i, m] + rounding_error))
        xh, xl = yh, yl
    return sum_h, sum_l


@kernel
def combine(jet, omega, kappa, out):
    """G at a rate (rad/s) and coupling (N/m), small terms first; jet (6, n, m), out (n, m)."""
    oo = omega * omega
    ok = omega * kappa
    kk = kappa * kappa
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            small = (kk * jet[5, j, i] + ok * jet[4, j, i]) + oo * jet[3, j, i]
            out[j, i] = jet[0, j, i] + (omega * jet[1, j, i] + (kappa * jet[2, j, i] + small))


@inlined
def combine_lanes(jet, at, size, omega, kappa, out, to):
    """As `combine` for the eight entries from `at` on of a flat jet of matrices of `size`, into out[to ..]."""
    o, k = splat(omega), splat(kappa)
    small = splat(kappa * kappa) * load(jet, at + 5 * size) + splat(omega * kappa) * load(jet, at + 4 * size)
    small = small + splat(omega * omega) * load(jet, at + 3 * size)
    store(out, to, load(jet, at) + (o * load(jet, at + size) + (k * load(jet, at + 2 * size) + small)))


@inlined
def locate(temp_lo_degc, step_k, count, temp_degc):
    """Knot below `temp_degc` and the weight of the next one; the caller keeps to the range. One knot has weight 0."""
    if count == 1:
        return 0, 0.0
    position = (temp_degc - temp_lo_degc) / step_k
    knot_index = min(max(int(position), 0), count - 2)
    return knot_index, position - knot_index


def cv_chain(device, channel, temp_degc):
    """Gain (V/m) and pole (s) of the ring diode of "drive" or "sense"; `device` as it is at temp_ref."""
    # imported here so that a build with a chain of its own needs no diode
    from analog_frontend.parts import ring_diode

    ring = ring_diode.diode_ring(*ring_diode.arguments(device, channel, temp_degc))
    return ring.gain_v_per_f * (device.dcdx_f_per_m if channel == "drive" else device.dcdy_f_per_m), ring.tau_s


def _generator(device, gains, rings, amplifiers, rc):
    """Non-zero entries {(row, column, jet): value} of the generator, with the constant inputs as states."""
    a = {}

    def pole(row, source, tau, gain=1):
        a[row, row, 0] = -1 / tau
        a[row, source, 0] = gain / tau

    for first, input_state, name in ((DRIVE, INPUT_DRIVE, "drive"), (SENSE, INPUT_SENSE, "sense")):
        for n, source in enumerate((input_state, first, first + 1)):
            pole(first + n, source, MP.mpf(getattr(device, f"{name}_pole_{n + 1}_s")))

    block = resonator.resonator_matrices(device)
    for jet, entries in enumerate((block.base, block.omega, block.stiffness)):
        for (row, col), value in entries.items():
            a[MODES + row, MODES + col, jet] = value
    ports = (
        (INPUT_FX, DRIVE + 2, device.k_vf_drive_n_per_v),
        (INPUT_FY, SENSE + 2, device.k_vf_sense_n_per_v),
    )
    for (row, col), value in block.force.items():
        input_state, electrode, k_vf = ports[col]
        a[MODES + row, input_state, 0] = value
        a[MODES + row, electrode, 0] = value * MP.mpf(k_vf)

    ina, driver = amplifiers
    signal_gain = MP.mpf(device.signal_gain)
    sources = ((DRIVE_CV, DRIVE_SID, resonator.X), (SENSE_CV, SENSE_SID, resonator.Y))
    for (cv, sid, mode), gain, ring in zip(sources, gains, rings):
        pole(cv, MODES + mode, ring, gain)
        pole(cv + 1, cv, ina)
        pole(cv + 2, cv + 1, driver, signal_gain)
        for n, source in enumerate((cv + 2, sid, sid + 1)):
            pole(sid + n, source, rc)
    return a


def _sparse(entries, duration):
    """Generator times `duration` as the arrays `taylor` reads; entries that are exactly zero are left out."""
    nonzero = [(entry_index, value * duration) for entry_index, value in entries.items() if value != 0]
    return np.array([entry_index for entry_index, _ in nonzero]), np.array([split(value) for _, value in nonzero])


def _columns(columns):
    """Columns {row: value} without rate or coupling as a jet: (hi, lo)."""
    hi = np.zeros((JETS, SIZE, len(columns)))
    lo = np.zeros_like(hi)
    for m, column_ in enumerate(columns):
        for row, value in column_.items():
            hi[0, row, m], lo[0, row, m] = split(value)
    return hi, lo


def instants(delay, cycle_time, clocks=26):
    """Where cycle c + delay falls: whole cycles of the delay, its rest, and the carries of c = 0 .. clocks - 1."""
    delay_cycles = int(MP.floor(delay / cycle_time))
    carry = np.array([(c + delay_cycles) // clocks for c in range(clocks)], np.int64)
    return delay_cycles, delay - delay_cycles * cycle_time, carry


# Hermite's cubics on 0 .. 1: value and first three derivatives at 0 of what goes with x(0), x'(0), x(1), x'(1)
HERMITE = ((1, 0, -6, 12), (0, 1, -4, 6), (0, 0, 6, -12), (0, 0, -2, 6))


def _pickoff(entries, tick, norm):
    """(2, 4, 6): C/V states and SID path of both channels after a tick from zero, driven by the cubic of x."""
    pickoff_matrices = []
    for cv, sid, mode in ((DRIVE_CV, DRIVE_SID, resonator.X), (SENSE_CV, SENSE_SID, resonator.Y)):
        states = (cv, cv + 1, cv + 2, sid, sid + 1, sid + 2, MODES + mode)
        a = {
            (states.index(row), states.index(col), 0): value
            for (row, col, _), value in entries.items()
            if row in states[:6] and col in states
        }
        # the input is the seventh state, its derivatives by time in ticks are the last three
        a |= {(6 + k, 7 + k, 0): 1 / tick for k in range(3)}
        pieces = max(1, int(MP.ceil(norm * tick / 4)))
        entry_indices, value = _sparse(a, tick / pieces)
        hi, lo = np.zeros((JETS, 10, 4)), np.zeros((JETS, 10, 4))
        for column, derivatives in enumerate(HERMITE):
            # x' is given as x'/W per second
            unit = tick * resonator.W if column in (1, 3) else MP.mpf(1)
            for k, derivative in enumerate(derivatives):
                hi[0, 6 + k, column], lo[0, 6 + k, column] = split(derivative * unit)
        for _ in range(pieces):
            hi, lo = taylor(entry_indices, value, COLUMN_TERMS, hi, lo)
        pickoff_matrices.append(hi[0, :6].T)
    return np.array(pickoff_matrices)


class Clock(NamedTuple):
    """The master clock and its cycles to a tick."""

    master_hz: int = 26_000_000
    cycles: int = 26


DEFAULT_CLOCK = Clock()


def _matrix_power(one, n):
    """A double-double matrix to the power n, by the bits of n from the left."""
    partial_power = one
    for bit in bin(n)[3:]:
        partial_power = multiply(*partial_power, *partial_power)
        if bit == "1":
            partial_power = multiply(*partial_power, *one)
    return partial_power


def build(device, temp_degc, chain=None, clock=DEFAULT_CLOCK):
    """Tables of `device` (as it is at temp_ref) at `temp_degc`; `chain` replaces `cv_chain`."""
    warm = thermal.device_at_temperature(device, temp_degc)
    chain = chain or cv_chain
    (drive_gain, drive_ring), (sense_gain, sense_ring) = (chain(device, c, temp_degc) for c in ("drive", "sense"))
    gains = (MP.mpf(drive_gain), MP.mpf(sense_gain))
    rings = (MP.mpf(drive_ring), MP.mpf(sense_ring))
    per_gain = 1 / (2 * MP.pi * MP.mpf(warm.opamp_gbw_hz))
    amplifiers = (MP.mpf(warm.ina_noise_gain) * per_gain, MP.mpf(warm.driver_noise_gain) * per_gain)
    rc = MP.mpf(warm.sid_r_ohm) * MP.mpf(warm.sid_c_f)
    cycle_time = 1 / (clock.master_hz * (1 + MP.mpf(warm.clock_ppm) / 10**6))
    tick = clock.cycles * cycle_time
    entries = _generator(warm, gains, rings, amplifiers, rc)
    # twice the fastest rate bounds the norm once every state is measured in units of its own size
    rates = [-v for (row, col, _), v in entries.items() if row == col]
    norm = 2 * max(*rates, resonator.W, 2 * MP.pi * max(warm.fx_hz, warm.fy_hz))

    halvings = max(0, int(MP.ceil(MP.log(norm * cycle_time, 2))))
    entry_indices, value = _sparse(entries, cycle_time / 2**halvings)
    per_cycle = taylor(entry_indices, value, MATRIX_TERMS, *_columns([{row: MP.mpf(1)} for row in range(SIZE)]))
    for _ in range(halvings):
        per_cycle = multiply(*per_cycle, *per_cycle)
    tick_matrix, _ = _matrix_power(per_cycle, clock.cycles)
    g_jet = np.zeros((JETS, INPUTS, OUTPUTS))
    for col, row in zip(TICK_COLUMNS, JET_ROWS):
        g_jet[:, row, :INPUT_DRIVE] = tick_matrix[:, :INPUT_DRIVE, col]

    steps, jitters, carries = [], [], []
    for input_state, delay_s in ((INPUT_DRIVE, warm.drive_dac_delay_s), (INPUT_SENSE, warm.sense_dac_delay_s)):
        latency_cycles, delay_remainder, carry = instants(MP.mpf(delay_s), cycle_time, clock.cycles)
        shortest = cycle_time - delay_remainder
        pieces = max(1, int(MP.ceil(norm * shortest / 4)))
        entry_indices, value = _sparse(entries, shortest / pieces)
        # e^(A s) u and its derivative e^(A s) A u; A times the first would lose the settled states to cancellation
        x = _columns([{input_state: MP.mpf(1)}, {row: v for (row, col, _), v in entries.items() if col == input_state}])
        for _ in range(pieces):
            x = taylor(entry_indices, value, COLUMN_TERMS, *x)
        step = np.zeros((JETS, clock.cycles, OUTPUTS))
        jitter = np.zeros((JETS, clock.cycles, OUTPUTS))
        for step_cycle in range(clock.cycles - 1, -1, -1):
            c = (step_cycle - latency_cycles) % clock.cycles
            step[:, c, :INPUT_DRIVE] = x[0][:, :INPUT_DRIVE, 0]
            # a later instant is a shorter duration: minus
            jitter[:, c, :INPUT_DRIVE] = 0.0 - x[0][:, :INPUT_DRIVE, 1]
            x = multiply(*per_cycle, *x)
        steps.append(step)
        jitters.append(jitter)
        carries.append(carry)

    return Plant(
        g_jet,
        *steps,
        *jitters,
        *carries,
        _pickoff(entries, tick, norm),
        tick_s=float(tick),
        kxy_n_per_m=warm.kxy_n_per_m,
        kq_n_per_m_per_v2=warm.kq_n_per_m_per_v2,
        drive_gain_v_per_m=float(drive_gain),
        sense_gain_v_per_m=float(sense_gain),
        drive_ring_s=float(drive_ring),
        sense_ring_s=float(sense_ring),
        ina_s=float(amplifiers[0]),
        driver_s=float(amplifiers[1]),
        signal_gain=warm.signal_gain,
        sid_rc_s=float(rc),
    )


class Knots(NamedTuple):
    """Tables at equally spaced temperatures; the fields of `stacks` have the knot as an additional first axis."""

    temp_lo_degc: float
    step_k: float
    count: int
    stacks: Plant


def knots(device, temp_lo_degc, temp_hi_degc, step_k=0.5, chain=None, clock=DEFAULT_CLOCK):
    """Knots that cover the range; temp_ref is one of them, because the law of k_xy has its corner there.

    A range of one temperature gives one knot, at exactly that temperature.
    """
    if temp_lo_degc == temp_hi_degc:
        return Knots(float(temp_lo_degc), 1.0, 1, Plant(*map(np.stack, zip(build(device, temp_lo_degc, chain, clock)))))
    if not 0.0 < step_k <= 10.0:
        raise ValueError(f"step_k = {step_k!r} is outside 0 .. 10 (unit K)")
    if not thermal.check(temp_lo_degc) < thermal.check(temp_hi_degc):
        raise ValueError(f"temp_lo_degc = {temp_lo_degc!r} is not below temp_hi_degc = {temp_hi_degc!r} (unit degC)")
    ref, step = MP.mpf(device.temp_ref_degc), MP.mpf(step_k)
    first = int(MP.floor((MP.mpf(temp_lo_degc) - ref) / step))
    last = int(MP.ceil((MP.mpf(temp_hi_degc) - ref) / step))
    plants = [build(device, float(ref + n * step), chain, clock) for n in range(first, last + 1)]
    stacks = Plant(*map(np.stack, zip(*plants)))
    return Knots(float(ref + first * step), float(step_k), len(plants), stacks)
