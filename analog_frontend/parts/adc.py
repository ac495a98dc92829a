"""Delta-sigma converter (ADS1298): sinc3 over the modulator's own instants, 10-code steps, noise, data ready.

    sample    v_m = start + (end - start) frac     at the modulator's instant in the tick, linear between tick ends
    filter    three frames of N samples run at once, weights w_j(m) with sum N^3:
              w0 = m (m - 1)/2   w1 = (N + m - 1)(N + m)/2 - 3 m (m - 1)/2   w2 = (N - m)(N - m + 1)/2,  m = 0 .. N - 1
    code      clamp(step floor(x + 1/2)),  x = (v + offset + noise) gain PGA 2^23 / (VREF step), bent by the INL cubic;
              a converter of n bits, left justified: step = 2^(24 - n), largest code 2^23 - step

    v --(+offset +white +flicker)--(x PGA/VREF)--(INL)--[w0|w1|w2 accumulators]--(round to 10 codes, clamp)--> code

Time      integers of 1/2^32 master cycle: 64 modulator periods of 1625/32 cycles are 125 ticks exactly; a free-running
          clock has another integer. Every instant is kept relative to the block, so nothing grows and nothing drifts
Delay     from a tone to its code: 3 (N - 1)/2 modulator periods before the last sample, 184.57 us at N = 64
Ready     DRDY falls `delay` after the last sample, at least one tick: `convert_block` returns the clock from which a
          register sees it low, in a later tick than the sample's, else -1. The codes stay until the next conversion
Between   the chord errs by h^2/8 |v''| <= h^2 A/(8 w (RC)^3) = 1.3e-9 V behind a settled 50 Hz SID at A = 2.88 V
Rounding  nearest multiple of `step`, ties toward plus infinity
Overflow  clamps to -0x800000 .. code_hi (the part's: 0x7FFFFF) before it becomes an int; NaN reads as code_hi and is
          gone after three conversions
Response  |sin(N pi f/fm)/(N sin(pi f/fm))|^3; at N = 64 -3 dB at 2092 Hz; 11 kHz appears at 3 kHz with -40.2 dB
Errors    effects.adc_*, off by default, before offset, gain and INL; f is full scale at the input:
          v' = v (1 + tc (T - 25 degC)) + f sum c_n T_n(v/f) + t |v| + m v_before,  T_n Chebyshev, n = 2 .. 14
          adc_gain_tc_per_k: tc   adc_curve: c_n   adc_turnover: t   adc_memory: m. Clocked and frame engine only
Missing   bit stream and idle tones of the modulator, multiplexing, settling after a change of the PGA
State     two arrays, mutated in place
Source    docs/plant.md, docs/effects.md
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from analog_frontend.numeric.vector import four, lane, load4, splat4
from analog_frontend.parts import noise
from fpga_model.jit import inlined, kernel

CHANNELS = 5  # drive sin, drive cos, sense sin, sense cos, temperature
TEMPERATURE = 4
UNIT_BITS = 32
UNITS_PER_CYCLE = 1 << UNIT_BITS
TICK_CLOCKS = 26
SYNCHRONOUS_PERIOD = 1625 << (UNIT_BITS - 5)  # 26 MHz / 512 kHz = 1625/32 cycles
assert SYNCHRONOUS_PERIOD * 64 == 125 * (TICK_CLOCKS << UNIT_BITS), "64 modulator periods must be one frame"

CODE_BITS = 24
FULL_CODE = 1 << (CODE_BITS - 1)
CODE_HI = FULL_CODE - 1
CODE_LO = -FULL_CODE
NOT_PENDING = -(1 << 61)
PGA_GAINS = (1, 2, 3, 4, 6, 8, 12)
CURVE = 13  # Chebyshev polynomials T2 .. T14 of the transfer's curve

# Rows of State.clock; the codes follow
DUE, SAMPLE, PENDING, COUNT, CODES = range(5)
# Columns of State.sums; the 1/f states follow
FRAMES = 3

# On-chip temperature sensor of the ADS1298, datasheet: 145.3 mV at 25 degC, 490 uV/K
SENSOR_V_AT_25_DEGC = 0.1453
SENSOR_V_PER_K = 490e-6


class Params(NamedTuple):
    """Times in units of 1/2^32 cycle; tuples have one entry per channel."""

    tick_clocks: int
    tick_units: int
    per_tick: float  # 1 / tick_units
    period: int
    delay: int
    decimation: int
    step_code: int
    normal: float  # 1 / N^3
    code_hi: int  # largest code
    full_steps: float  # 2^23 / step
    offset_v: tuple
    steps_per_v: tuple  # PGA gain (1 + error) 2^23 / (VREF step)
    inl: tuple  # (u^3 - u) of full scale added at u of full scale
    errors_on: tuple  # any of those that follow
    turnover: tuple  # |v| added at v
    gain_tc_per_k: tuple  # relative, from 25 degC of the sensor channel's voltage on
    memory: tuple  # part of the conversion before that is added
    curve: tuple  # parts of full scale by Chebyshev's T2 .. T14 of v / full scale, all channels but the sensor
    white: tuple
    flicker: tuple


class State(NamedTuple):
    """`clock` int64: next instant, sample of the frame, DRDY instant, conversions, five codes.

    `sums` float64 (channel, column): three accumulators, then the 1/f states.
    """

    clock: np.ndarray
    sums: np.ndarray


def modulator_period(ppm=0.0, modulator_hz=512e3, master_hz=26_000_000):
    """Modulator period in units, of a clock `ppm` fast against the master; exact integer 1625 * 2^27 for 0 ppm."""
    rate = Fraction(modulator_hz) * (1 + Fraction(ppm) / 1_000_000)
    if not rate > 0:
        raise ValueError(f"adc modulator_hz: {float(rate):g} Hz is not positive")
    return round(Fraction(master_hz) * UNITS_PER_CYCLE / rate)


class Design(NamedTuple):
    """A converter; all per-channel values are referred to its input (before the PGA).

    noise_v             rms of one conversion (V)
    flicker_v_per_rthz  one-sided density at 1 Hz (V/rtHz)
    conversion_delay_s  last modulator sample to the fall of DRDY (s); must be at least one tick
    tick_clocks         master clocks to a plant tick
    code_hi             largest code
    inl                 peak of the cubic as a fraction of full scale, divided by 0.385
    turnover            gain of positive less that of negative voltages, halved
    gain_tc_per_k       relative change of the gain per kelvin of the sensor channel
    memory              part of the voltage of the conversion before that is left over
    curve               up to 13 parts of full scale, of T2, T3, .. T14 of v over full scale; not for the sensor
    """

    seed: int = 0
    pga: tuple = (1, 1, 12, 12, 1)
    vref_v: float = 4.0
    step_code: int = 10
    code_hi: int = CODE_HI
    decimation: int = 64
    period: int = SYNCHRONOUS_PERIOD
    conversion_delay_s: float = 1.5e-6
    master_hz: float = 26e6
    tick_clocks: int = TICK_CLOCKS
    noise_v: tuple = (0.0,) * CHANNELS
    flicker_v_per_rthz: tuple = (0.0,) * CHANNELS
    offset_v: tuple = (0.0,) * CHANNELS
    gain_error: tuple = (0.0,) * CHANNELS
    inl: tuple = (0.0,) * CHANNELS
    turnover: tuple = (0.0,) * CHANNELS
    gain_tc_per_k: tuple = (0.0,) * CHANNELS
    memory: tuple = (0.0,) * CHANNELS
    curve: tuple = ()


def _check(d):
    """ValueError (name, value, limit) if a `Design` is impossible."""
    for gain in d.pga:
        if gain not in PGA_GAINS:
            raise ValueError(f"adc pga: {gain} is none of {PGA_GAINS}")
    for name in ("pga", "noise_v", "offset_v", "gain_error", "inl", "turnover", "gain_tc_per_k", "memory"):
        values = getattr(d, name)
        if len(values) != CHANNELS or not all(math.isfinite(v) for v in values):
            raise ValueError(f"adc {name}: {values} is not {CHANNELS} finite numbers")
    if len(d.curve) > CURVE or not all(abs(v) <= 1e-2 for v in d.curve):
        raise ValueError(f"adc curve: {d.curve} is not at most {CURVE} parts of full scale within -0.01 .. 0.01")
    if not (d.vref_v > 0.0 and 1 <= d.step_code <= 1024):
        raise ValueError(
            f"adc vref_v, step_code: {d.vref_v} V, {d.step_code} codes; limits: above 0 V, 1 .. 1024 codes"
        )
    if not 16 <= d.decimation <= 1024:
        raise ValueError(f"adc decimation: {d.decimation} is outside 16 .. 1024 samples")
    if not d.period > d.tick_clocks << UNIT_BITS:
        raise ValueError(
            f"adc period: {d.period / UNITS_PER_CYCLE:g} cycles are not above a tick of {d.tick_clocks} cycles, "
            "which may hold one sample"
        )
    delay = _delay(d)
    if not d.tick_clocks << UNIT_BITS <= delay < (d.decimation - 1) * d.period:
        raise ValueError(
            f"adc conversion_delay_s: {d.conversion_delay_s} s is outside {d.tick_clocks / d.master_hz:g} s .. one "
            "frame; DRDY must fall in a later tick than the last sample"
        )


def _delay(d):
    """Units from the last modulator sample to the fall of DRDY."""
    return round(Fraction(d.conversion_delay_s) * Fraction(d.master_hz) * UNITS_PER_CYCLE)


def design(**values):
    """Machine units of a `Design`. Raises ValueError (name, value, limit)."""
    d = Design(**values)
    _check(d)
    scale = [
        Fraction(g) * FULL_CODE / (Fraction(d.vref_v) * d.step_code) * (1 + Fraction(e))
        for g, e in zip(d.pga, d.gain_error)
    ]
    tick_units = int(d.tick_clocks) << UNIT_BITS
    return Params(
        tick_clocks=int(d.tick_clocks),
        tick_units=tick_units,
        per_tick=1.0 / tick_units,
        period=int(d.period),
        delay=_delay(d),
        decimation=int(d.decimation),
        normal=1.0 / d.decimation**3,
        step_code=int(d.step_code),
        code_hi=int(d.code_hi),
        full_steps=FULL_CODE / d.step_code,
        offset_v=tuple(float(v) for v in d.offset_v),
        steps_per_v=tuple(float(v) for v in scale),
        inl=tuple(float(v) for v in d.inl),
        errors_on=tuple(
            int(any(v) or (c != TEMPERATURE and any(d.curve)))
            for c, v in enumerate(zip(d.turnover, d.gain_tc_per_k, d.memory))
        ),
        turnover=tuple(float(v) for v in d.turnover),
        gain_tc_per_k=tuple(float(v) for v in d.gain_tc_per_k),
        memory=tuple(float(v) for v in d.memory),
        curve=tuple(float(v) for v in d.curve) + (0.0,) * (CURVE - len(d.curve)),
        white=tuple(noise.source(d.seed, f"adc_{_channel_name(c)}", d.noise_v[c]) for c in range(CHANNELS)),
        flicker=tuple(
            noise.flicker(d.seed, f"flicker_{_channel_name(c)}", d.flicker_v_per_rthz[c]) for c in range(CHANNELS)
        ),
    )


def _channel_name(channel):
    return "temp" if channel == TEMPERATURE else str(channel)


def reset(p, first_cycles=0.0):
    """Converter at t = 0 whose first modulator instant is `first_cycles` master cycles later."""
    first = round(Fraction(first_cycles) * UNITS_PER_CYCLE)
    if not 0 <= first < p.period:
        raise ValueError(f"adc first_cycles: {first_cycles} is outside 0 .. {p.period / UNITS_PER_CYCLE:g} cycles")
    sums = np.zeros((CHANNELS, FRAMES + noise.POLES))
    for c in range(CHANNELS):
        sums[c, FRAMES:] = noise.flicker_reset(p.flicker[c])
    return State(np.array([first, 0, NOT_PENDING] + [0] * (1 + CHANNELS), dtype=np.int64), sums)


@inlined
def temperature_volts(temp_degc):
    """Voltage of the on-chip sensor, what channel 4 sees."""
    return SENSOR_V_AT_25_DEGC + SENSOR_V_PER_K * (temp_degc - 25.0)


@inlined
def code(p, channel, volts):
    """Code of a filtered voltage, noise included by the caller."""
    x = (volts + p.offset_v[channel]) * p.steps_per_v[channel]
    if p.inl[channel] != 0.0:
        u = x / p.full_steps
        x = x + p.inl[channel] * p.full_steps * (u * u * u - u)
    if x != x or x >= p.full_steps:
        return p.code_hi
    if x <= -p.full_steps:
        return CODE_LO
    rounded = math.floor(x + 0.5) * p.step_code
    return p.code_hi if rounded > p.code_hi else (CODE_LO if rounded < CODE_LO else rounded)


@inlined
def _curve(p, u):
    """Sum of the Chebyshev polynomials T2 .. T14 of u with the parts of `curve`, by their recurrence."""
    last, now, total = 1.0, u, 0.0
    for n in range(CURVE):
        last, now = now, 2.0 * u * now - last
        total = total + p.curve[n] * now
    return total


@inlined
def erroneous(p, channel, volts, before_v, sensor_v):
    """Input voltage with the errors that `errors_on` announces; `before_v` of the last conversion, sensor's voltage."""
    warm_k = (sensor_v - SENSOR_V_AT_25_DEGC) / SENSOR_V_PER_K
    gain = 1.0 + p.gain_tc_per_k[channel] * warm_k
    bent = 0.0
    if channel != TEMPERATURE:
        full_v = p.full_steps / p.steps_per_v[channel]
        bent = full_v * _curve(p, volts / full_v)
    return gain * volts + bent + p.turnover[channel] * abs(volts) + p.memory[channel] * before_v


@kernel
def convert(p, clock, sums):
    """End of a frame: the oldest sums become codes, the others move up. Mutates both arrays."""
    count = clock[COUNT]
    sensor_v = sums[TEMPERATURE, 2] * p.normal
    for c in range(CHANNELS):
        volts = sums[c, 2] * p.normal
        if p.white[c].on:
            volts = volts + noise.white_fine(p.white[c], count)
        if p.flicker[c].on:
            volts = volts + noise.flicker_step(p.flicker[c], sums[c, FRAMES:], count)
        if p.errors_on[c]:
            before_v = clock[CODES + c] / (p.steps_per_v[c] * p.step_code)
            volts = erroneous(p, c, volts, before_v, sensor_v)
        clock[CODES + c] = code(p, c, volts)
        sums[c, 2] = sums[c, 1]
        sums[c, 1] = sums[c, 0]
        sums[c, 0] = 0.0
    clock[COUNT] = count + 1


@inlined
def weights(n, m):
    """Of sample `m` of `n` in the three frames that it belongs to."""
    rise = (m * (m - 1)) >> 1
    return float(rise), float((((n + m - 1) * (n + m)) >> 1) - 3 * rise), float(((n - m) * (n - m + 1)) >> 1)


@inlined
def ready(p, clock, ticks):
    """Behind a block of `ticks`: what `convert_block` returns. Mutates `clock`."""
    if clock[PENDING] == NOT_PENDING:
        return -1
    cycle = (clock[PENDING] + (UNITS_PER_CYCLE - 1)) >> UNIT_BITS
    is_ready = cycle < (ticks + 1) * p.tick_clocks
    clock[PENDING] = NOT_PENDING if is_ready else clock[PENDING] - ticks * p.tick_units
    return cycle if is_ready else -1


@inlined
def convert_block(p, clock, sums, out, ticks, sensor_v):
    """`ticks` plant ticks; mutates the two arrays of `State`.

    out       voltage of channel c < 4 at the start of tick t at 4 t + c, one row more than ticks
    sensor_v  voltage of the temperature sensor, constant
    Returns the clock, counted from the block's first, at whose edge DRDY is first seen low, or -1: 26 .. 26 ticks + 25,
    one tick and more after the block's beginning. At most one conversion may become ready in a block.
    """
    due = clock[DUE]
    end = ticks * p.tick_units
    if due < end:
        a0, a1, a2 = _load_integrator(sums, 0), _load_integrator(sums, 1), _load_integrator(sums, 2)
        t0, t1, t2 = sums[TEMPERATURE, 0], sums[TEMPERATURE, 1], sums[TEMPERATURE, 2]
        n = p.decimation
        m = clock[SAMPLE]
        # the tick of a sample by subtraction: a division for each would cost a twentieth of the plant
        tick, tick_offset = 0, due
        while due < end:
            while tick_offset >= p.tick_units:
                tick_offset = tick_offset - p.tick_units
                tick += 1
            frac = tick_offset * p.per_tick
            w0, w1, w2 = weights(n, m)
            start = load4(out, 4 * tick)
            v = start + splat4(frac) * (load4(out, 4 * tick + 4) - start)
            a0 = a0 + splat4(w0) * v
            a1 = a1 + splat4(w1) * v
            a2 = a2 + splat4(w2) * v
            t0 = t0 + w0 * sensor_v
            t1 = t1 + w1 * sensor_v
            t2 = t2 + w2 * sensor_v
            m += 1
            if m == n:
                m = 0
                clock[PENDING] = due + p.delay
                _store_integrator(sums, 0, a0, t0)
                _store_integrator(sums, 1, a1, t1)
                _store_integrator(sums, 2, a2, t2)
                convert(p, clock, sums)
                a0, a1, a2 = _load_integrator(sums, 0), _load_integrator(sums, 1), _load_integrator(sums, 2)
                t0, t1, t2 = sums[TEMPERATURE, 0], sums[TEMPERATURE, 1], sums[TEMPERATURE, 2]
            due = due + p.period
            tick_offset = tick_offset + p.period
        clock[SAMPLE] = m
        _store_integrator(sums, 0, a0, t0)
        _store_integrator(sums, 1, a1, t1)
        _store_integrator(sums, 2, a2, t2)
    clock[DUE] = due - end
    return ready(p, clock, ticks)


@inlined
def _load_integrator(sums, j):
    return four(sums[0, j], sums[1, j], sums[2, j], sums[3, j])


@inlined
def _store_integrator(sums, j, quad, temperature):
    sums[0, j] = lane(quad, 0)
    sums[1, j] = lane(quad, 1)
    sums[2, j] = lane(quad, 2)
    sums[3, j] = lane(quad, 3)
    sums[TEMPERATURE, j] = temperature


@inlined
def clocks_to_ready(p, clock, later):
    """Clocks from the present tick's first to the edge that first sees DRDY low; `later` conversions after the next."""
    pending = clock[PENDING]
    if pending == NOT_PENDING or later > 0:
        frames = later if pending == NOT_PENDING else later - 1
        pending = clock[DUE] + (p.decimation * (frames + 1) - 1 - clock[SAMPLE]) * p.period + p.delay
    return (pending + (UNITS_PER_CYCLE - 1)) >> UNIT_BITS
