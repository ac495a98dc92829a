"""Slow oracles in exact integers and Fractions, written from the documented equations; imports nothing of ours.

Each is meant to be read and believed. It goes about its job in another way than the kernel it judges.
"""

import itertools
import math
from fractions import Fraction

# fixed: rounding, overflow, formats ---------------------------------------------------------------------------------


def rounded(rule, value):
    """Integer that `rule` makes of an exact value: the nearest integer, or a named choice between two neighbours."""
    below = math.floor(value)
    above = below if value == below else below + 1
    inner, outer = sorted((below, above), key=abs)
    directed = {"floor": below, "ceil": above, "toward_zero": inner}
    if rule in directed:
        return directed[rule]
    if value - below != Fraction(1, 2):
        return min((below, above), key=lambda n: abs(value - n))
    even = below if below % 2 == 0 else above
    return {"half_up": above, "half_down": below, "half_even": even, "half_away": outer, "half_zero": inner}[rule]


def in_format(value, s, i, f):
    """Whether a number format [s,i,f] has exactly this value."""
    unit = Fraction(2) ** -f
    top = Fraction(2) ** i
    return (value / unit).denominator == 1 and (-top if s else 0) <= value < top


def format_values(s, i, f):
    """Every value of a format, smallest first."""
    unit = Fraction(2) ** -f
    top = Fraction(2) ** i
    count = (top * (2 if s else 1)) / unit
    return [(-top if s else 0) + k * unit for k in range(int(count))]


def congruent_within(value, modulus, lowest):
    """The one number of lowest .. lowest + modulus - 1 that differs from `value` by a multiple of `modulus`."""
    turns = Fraction(value - lowest, modulus)
    return value - math.floor(turns) * modulus


# cordic -------------------------------------------------------------------------------------------------------------


def arctan_bounds(x, terms):
    """Two rationals that enclose atan(x), 0 < x < 1: neighbouring partial sums of the alternating series."""
    partial = [Fraction(0)]
    for k in range(terms):
        partial.append(partial[-1] + Fraction((-1) ** k, 2 * k + 1) * Fraction(x) ** (2 * k + 1))
    return min(partial[-2:]), max(partial[-2:])


def pi_bounds():
    """Two rationals that enclose pi, by Euler's formula pi/4 = 5 atan(1/7) + 2 atan(3/79)."""
    a, b = arctan_bounds(Fraction(1, 7), 24), arctan_bounds(Fraction(3, 79), 16)
    return tuple(20 * a[k] + 8 * b[k] for k in (0, 1))


def arctan_turns_bounds(i):
    """Two rationals that enclose atan(2**-i) in turns; the first is one eighth exactly."""
    if i == 0:
        return Fraction(1, 8), Fraction(1, 8)
    angle, pi = arctan_bounds(Fraction(1, 2**i), 60 if i == 1 else 40), pi_bounds()
    return angle[0] / (2 * pi[1]), angle[1] / (2 * pi[0])


def cordic(table_turns, inputs, guard_bits=8):
    """Register rows of the vectoring CORDIC before each edge, and after the last one.

    table_turns  the angles in turns, at most 24
    inputs       (start, x_in, y_in) at each edge
    guard_bits   fraction bits of x and y, and those of the angle beyond 24
    x and y are kept in input LSB, angles in turns, all as Fractions; a vector is a point that gets turned.
    """
    grid = Fraction(1, 2**guard_bits)

    def snap(value):
        return rounded("half_up", value / grid) * grid

    def one_turn(value):
        return value - math.floor(value + Fraction(1, 2))

    x = y = angle = phase = Fraction(0)
    i = busy = done = magnitude = 0
    rows = []
    for start, x_in, y_in in [*inputs, (0, 0, 0)]:
        rows.append((x / grid, y / grid, angle * 2 ** (24 + guard_bits), i, busy, done, magnitude, phase * 2**24))
        done = 0
        if start:
            side = -1 if x_in < 0 else 1
            x, y, angle, i, busy = Fraction(side * x_in), Fraction(side * y_in), Fraction(side - 1, 4), 0, 1
        elif busy and i == 24:
            phase = one_turn(Fraction(rounded("half_up", angle * 2**24), 2**24)) if x else Fraction(0)
            magnitude, busy, done = rounded("half_up", x), 0, 1
        elif busy:
            turn = -1 if y < 0 else 1
            if i < len(table_turns):
                x, y = x + turn * snap(y / 2**i), y - turn * snap(x / 2**i)
                angle = one_turn(angle + turn * table_turns[i])
            i += 1
    return [tuple(int(v) for v in row) for row in rows]


# isqrt --------------------------------------------------------------------------------------------------------------


def isqrt(inputs):
    """Register rows of the square root before each edge, and after the last one; inputs: (start, u) at each edge.

    After k iterations the registers are what the root of the top 2k bits of u makes them.
    """
    u = k = y = busy = done = 0
    rows = []
    for start, value in [*inputs, (0, 0)]:
        top = u // 4 ** (16 - k)
        root = math.isqrt(top)
        rows.append(((u * 4**k) % 2**32, root, top - root**2, k % 16, busy, done, y))
        done = 0
        if start:
            u, k, busy = value, 0, 1
        elif busy:
            k += 1
            if k == 16:
                y, busy, done = math.isqrt(u), 0, 1
    return rows


# pi -----------------------------------------------------------------------------------------------------------------


def pi(kp, ki, lo, hi, inputs, fraction_bits=24):
    """Register rows of the PI controller before each edge, and after the last one.

    kp, ki   gains in LSB per LSB (Fractions);  lo, hi  limits in LSB
    inputs   (en, mode, e, preset) at each edge; mode 0 off, 1 proportional only, 2 run, else hold
    fraction_bits  of both parts
    """

    grid = Fraction(1, 2**fraction_bits)

    def snap(value):
        return rounded("half_up", value / grid) * grid

    def limited(value):
        return sorted((Fraction(lo), value, Fraction(hi)))[1]

    prop = acc = y = Fraction(0)
    rows = []
    for en, mode, e, preset in [*inputs, (0, 0, 0, 0)]:
        rows.append((int(prop / grid), int(acc / grid), int(y)))
        y = limited(Fraction(rounded("half_up", prop + acc)))
        if en and mode in (0, 1, 2):
            acc = {0: limited(Fraction(preset)), 1: acc, 2: limited(acc + snap(ki * e))}[mode]
            prop = Fraction(0) if mode == 0 else snap(kp * e)
    return rows


# rates --------------------------------------------------------------------------------------------------------------


def rates(goes):
    """Register rows (tick, frame, slot) before each edge, and after the last: positions in time, not counters."""
    rows = []
    for n in range(len(goes) + 1):
        since = next((n - k for k in range(n - 1, max(n - 61, -1), -1) if goes[k]), 0)
        rows.append((n % 26, n // 26 % 125, since))
    return rows


# dds ----------------------------------------------------------------------------------------------------------------


def dds(words, offsets):
    """Register rows (phase and four outputs, raw) before each edge, and after the last; offsets: four per edge.

    Angles are Fractions of a turn; only the row is raw.
    """

    def raw(turns):
        return int((turns - math.floor(turns)) * 2**48)

    rows = [(0, 0, 0, 0, 0)]
    travelled = Fraction(0)
    for word, four in zip(words, offsets, strict=True):
        outputs = [raw(travelled + Fraction(offset, 2**48)) for offset in four]
        travelled += Fraction(word, 2**48)
        rows.append((raw(travelled), *outputs))
    return rows


# sine ---------------------------------------------------------------------------------------------------------------


def quarter_sine(halvings, unit_bits=200):
    """sin(k/n quarter turns), k = 0 .. n = 2**halvings, as Fractions good to about 2**(2*halvings - unit_bits).

    Half-angle formulas down from 90 degrees, then sin(k+1) = 2 cos(1) sin(k) - sin(k-1): neither pi nor a series.
    """
    one = 1 << unit_bits
    sin, cos = one, 0
    for _ in range(halvings):
        cos = math.isqrt((one + cos) * one // 2)
        sin = sin * one // (2 * cos)
    wave = [0, sin]
    while len(wave) <= 1 << halvings:
        wave.append(2 * cos * wave[-1] // one - wave[-2])
    return [Fraction(value, one) for value in wave]


def sine_rows(phases, wave, full_scale):
    """Register rows (sign, base, slope, fraction, sign2, base2, product, y) before each edge, and after the last.

    wave  1025 values of the quarter wave; each row is worked out from the phases 1, 2 and 3 edges before it
    """
    steps = len(wave) - 1

    def snap(value, unit):
        return rounded("half_up", value / unit) * unit

    def stages(phase):
        middle = (math.floor(Fraction(phase, 2**26)) + Fraction(1, 2)) / 2**22
        half_turn = middle % Fraction(1, 2)
        place = min(half_turn, Fraction(1, 2) - half_turn) * 4 * steps
        a = math.floor(place)
        base = snap(full_scale * wave[a], Fraction(1, 64))
        slope = snap(full_scale * (wave[a + 1] - wave[a]), Fraction(1, 32))
        rise = slope * (place - a)
        magnitude = rounded("half_up", base + rise)
        negative = 1 if middle > Fraction(1, 2) else 0
        first = (negative, base * 64, slope * 32, (place - a) * 1024 - Fraction(1, 2))
        return first, (negative, base * 64, rise * 2**16), (-magnitude if negative else magnitude,)

    reset = ((0, 0, 0, 0), (0, 0, 0), (0,))
    past = [reset, reset, reset, *map(stages, phases)]
    rows = [past[n + 2][0] + past[n + 1][1] + past[n][2] for n in range(len(phases) + 1)]
    return [tuple(int(v) for v in row) for row in rows]


# delay, references, modulator ---------------------------------------------------------------------------------------


def delay(depth, xs):
    """Register rows (eight taps) before each edge, and after the last: the last eight inputs, newest first."""
    seen = [0] * 8 + (list(xs) if depth else [0] * len(xs))
    return [tuple(reversed(seen[n : n + 8])) for n in range(len(xs) + 1)]


def references(align, phases, enables):
    """Register rows (signs, aligned 0 .. 2, retimed) before each edge, and after the last.

    phases  (drive, sense) as Fractions of a turn at each edge; enables: the 1 MHz enable at each edge
    """

    def word(n):
        """Signs of the phases n edges into the run; nothing before the first."""
        if n < 0:
            return 0
        drive, sense = phases[n]
        pins = [drive < Fraction(1, 2), abs(drive - Fraction(1, 2)) > Fraction(1, 4) or drive == Fraction(3, 4)]
        pins += [sense < Fraction(1, 2), abs(sense - Fraction(1, 2)) > Fraction(1, 4) or sense == Fraction(3, 4)]
        return sum(2**k for k, pin in enumerate(pins) if pin)

    rows = []
    for n in range(len(phases) + 1):
        loads = [k for k in range(n) if enables[k]]
        retimed = word(loads[-1] - 1 - align) if loads else 0
        rows.append((word(n - 1), word(n - 2), word(n - 3), word(n - 4), retimed))
    return rows


def modulator(shift, lo, hi, inputs):
    """Register rows (product, code, held1, held2) before each edge, and after the last.

    inputs  (en_product, en_code, amplitude, sine) at each edge
    """
    rows = []
    products, codes = [0], [0, 0, 0]
    for en_product, en_code, amplitude, sine in [*inputs, (0, 0, 0, 0)]:
        rows.append((products[-1], codes[-1], codes[-2], codes[-3]))
        if en_code:
            codes.append(min(max(rounded("half_up", Fraction(products[-1], 2**shift)), lo), hi))
        if en_product:
            products.append(amplitude * sine)
    return rows


# spi_dac, dac_serial ------------------------------------------------------------------------------------------------


def spi_dac(bits, lead, ldac, inputs, gap=0, strobe=0):
    """Register rows (shift, left, lead, sync_n, sclk_en, ldac_n, ldac_wait) before each edge, and after the last.

    inputs  (load, word) at each edge; each row follows from the time since the last load alone
    """
    rows = []
    for n in range(len(inputs) + 1):
        loads = [k for k in range(n) if inputs[k][0]]
        if not loads:
            rows.append((0, 0, 0, 1, 0, 1, 0))
            continue
        word = inputs[loads[-1]][1]
        clock = n - 1 - loads[-1]
        # a bit is a period of gap + 1 clocks: SCLK in its first, what is left of it counted down in the others
        period, place = divmod(max(clock - lead, 0), gap + 1)
        after = clock - lead - bits * (gap + 1)
        sent = min(period + (place > 0), bits)
        text = f"{word:0{bits}b}"[sent:].ljust(bits, "0")
        running = clock >= lead and after < 0 and place == 0
        to_come = lead - clock if clock < lead else gap + 1 - place if place and after < 0 else 0
        pulse = (ldac and after == 1) or (strobe and clock == 0)
        waiting = ldac and after == 0
        pins = (int(after >= 0), int(running), int(not pulse))
        rows.append((int(text, 2), bits - sent, to_come, *pins, int(waiting)))
    return rows


def dac_chip(part, pins):
    """Rows of what the chip holds after each clock: a walk over whole frames written as text.

    part  dict: bits, exact, ldac (bools), data (data bits), offset (value of data 0), signed, header, control (text or
          None: the leading bits of a data and of a control word), on (text of the 3 bits DACTRI, OPGND and RBUF below
          which the output is on: the first two), start (code behind the output at power-on)
    pins  (sync_n, sclk_en, sdin, ldac_n) of each clock
    Row: (last 24 bits seen, bits in this frame, sync_n, ldac_n, staged, latch, code, enabled, updated)
    """
    ever, frame = "0" * 24, ""
    sync_before, ldac_before = 1, 1
    staged = latch = part["start"]
    enabled = part["control"] is None
    rows = []
    for sync_n, sclk_en, sdin, ldac_n in pins:
        events = []
        if (sync_before, sync_n) == (1, 0):
            frame = ""
        if (sync_before, sync_n) == (0, 1):
            word = ever[-part["bits"] :]
            complete = len(frame) == part["bits"] or not part["exact"]
            if complete and word.startswith(part["header"]):
                data = int(word[-part["data"] :], 2)
                if part["signed"] and word[-part["data"]] == "1":
                    data -= 2 ** part["data"]
                staged = data + part["offset"]
                if not part["ldac"] or ldac_n == 0:
                    events.append("latch")
            elif complete and part["control"] and word.startswith(part["control"]):
                enabled = word[-4:-2] == "00"
                events.append("control")
        if part["ldac"] and (ldac_before, ldac_n) == (1, 0):
            events.append("latch")
        if "latch" in events:
            latch = staged
        if sclk_en and not sync_n:
            ever, frame = (ever + str(sdin))[-24:], frame + str(sdin)
        sync_before, ldac_before = sync_n, ldac_n
        code = latch if enabled else 0
        rows.append((int(ever, 2), len(frame), sync_n, ldac_n, staged, latch, code, int(enabled), int(bool(events))))
    return rows


# spi_adc, adc_serial ------------------------------------------------------------------------------------------------


def spi_adc(drdy, dout, divider=2, word_bits=24, sent=8, tail=54):
    """Register rows of the ADC master before each edge, and after the last, from the levels on its two inputs.

    divider  clocks of a bit, the first half of them with SCLK low; word_bits, sent, tail  of a word, channels, clocks
    Row: (meta, sync, seen, busy, count, cs_n, sclk, shift, word, status, eight channels, valid, ok)
    """

    def before(n):
        return drdy[n] if n >= 0 else 0

    def justified():
        return int(("0" * 24 + taken)[-word_bits:].ljust(24, "0"), 2)

    rows = []
    start = None
    half, all_bits = divider // 2, (1 + sent) * word_bits
    read = divider * all_bits
    taken = ""
    status, channels, ok = 0, [0] * 8, 0
    for n in range(len(drdy) + 1):
        age = None if start is None else n - start
        if age is not None and age == read + tail:
            start = age = None
        synchronised = (before(n - 1), before(n - 2), before(n - 3))
        shift = justified()
        if age is None:
            state = (0, 0, 1, 0, 0)
            valid = 0
        else:
            bits = min(age // divider, all_bits)
            words, rest = bits // word_bits, bits % word_bits
            if bits < all_bits:
                high, clock = divmod(age % divider, half)
                state = (1, rest * half + clock, 0, high, words)
            else:
                state = (1, age - read, 0, 0, 1 + sent)
            if age % divider == 0 and age <= read and bits and not rest:
                if words == 1:
                    status = shift
                else:
                    channels[words - 2] = shift - (2**24 if shift >= 2**23 else 0)
            valid = int(age == read)
            if valid:
                ok = int(f"{status:024b}".startswith("1100"))
        busy, count, cs_n, sclk, word = state
        rows.append((*synchronised, busy, count, cs_n, sclk, shift, word, status, *channels, valid, ok))
        if n < len(drdy):
            if age is None and synchronised[1:] == (0, 1):
                start = n + 1
            elif age is not None and age < read and age % divider == divider - 1:
                taken += str(dout[n])
    return rows


def adc_chip(inputs, word_bits=24):
    """Rows of what the ADC's digital side shows after each clock: frames as text, a place in them as a count of edges.

    inputs  (cs_n, sclk, loaded, status, eight codes) of each clock
    Row: (cs_n, sclk, drdy_n, pulse, out, shift, left, word, nine result words, nine frame words)
    """

    def text(words):
        return "".join(f"{word:024b}"[:word_bits] for word in words)

    result = frame = (0,) * 9
    cs_before, sclk_before, drdy_n = 1, 0, 1
    rises = 0
    falls_at = None
    level = 0
    rows = []
    for n, (cs_n, sclk, loaded, status, codes) in enumerate(inputs):
        unread = drdy_n == 0
        pulsing = falls_at is not None
        if n == falls_at:
            drdy_n, falls_at = 0, None
        if loaded:
            result = (status % 2**24, *[code % 2**24 for code in codes])
            if unread:
                drdy_n, falls_at = 1, n + 4
            elif not pulsing:
                drdy_n = 0
        if cs_n != cs_before:
            level = rises = 0
            frame = frame if cs_n else result
        elif not cs_n and sclk > sclk_before:
            rises += 1
            level = int((text(frame) + "0" * rises)[rises - 1])
        elif not cs_n and sclk < sclk_before and not loaded and not pulsing:
            drdy_n = 1
        done = min(rises, 9 * word_bits)
        word = -(-done // word_bits)
        left = word * word_bits - done
        # what is not sent of a word stands behind its last bit
        shift = int(f"{frame[word - 1]:024b}"[word_bits - left :].ljust(24, "0"), 2) if 0 < rises == done else 0
        waiting = 0 if falls_at is None else falls_at - n
        rows.append((cs_n, sclk, drdy_n, waiting, level, shift, left, word, *result, *frame))
        cs_before, sclk_before = cs_n, sclk
    return rows


# plant: the equations of the analog side in physical units, and a matrix exponential in big integers -----------------


def matrix_exponential(matrix, time, bits=640):
    """exp(matrix * time) of a square list of rows of mpf: Taylor and squaring of integers with `bits` fraction bits."""
    import mpmath
    import numpy as np

    n = len(matrix)
    norm = max(sum(abs(x) for x in row) for row in matrix) * time
    halvings = max(0, int(mpmath.ceil(mpmath.log(norm + 1, 2)))) + 4
    a = np.array([[int(mpmath.nint(mpmath.ldexp(x * time, bits - halvings))) for x in row] for row in matrix], object)
    term = np.array([[int(i == j) << bits for j in range(n)] for i in range(n)], object)
    total = term
    for k in range(1, bits):
        # the norm is below 1/16, so that each term has at least four bits less than the one before
        term = (term.dot(a) >> bits) // k
        total = total + term
        if k * 4 > bits:
            break
    for _ in range(halvings):
        total = total.dot(total) >> bits
    return [[mpmath.ldexp(mpmath.mpf(int(x)), -bits) for x in row] for row in total]


def gyro_numbers(device, gains, rings):
    """What the equations of the plant need, as exact mpf, from a record with the device's field names."""
    import mpmath

    def get(name):
        return mpmath.mpf(getattr(device, name))

    amplifier = 1 / (2 * mpmath.pi * get("opamp_gbw_hz"))
    same = "mass_kg coriolis_mass_kg fx_hz fy_hz qx qy dxy_ratio signal_gain k_vf_drive_n_per_v k_vf_sense_n_per_v"
    return {name: get(name) for name in same.split()} | {
        "drive_poles": [get(f"drive_pole_{n}_s") for n in (1, 2, 3)],
        "sense_poles": [get(f"sense_pole_{n}_s") for n in (1, 2, 3)],
        "gains": [mpmath.mpf(g) for g in gains],
        "rings": [mpmath.mpf(r) for r in rings],
        "ina": get("ina_noise_gain") * amplifier,
        "driver": get("driver_noise_gain") * amplifier,
        "rc": get("sid_r_ohm") * get("sid_c_f"),
        "tick": mpmath.mpf(1) / 10**6 / (1 + get("clock_ppm") / 10**6),
    }


GYRO_STATES = "v1 v2 v3 s1 s2 s3 x dx y dy c1 c2 c3 e1 e2 e3 p1 p2 p3 q1 q2 q3 ud us fx fy".split()


def gyro_generator(d, omega, kappa):
    """Rows of the generator of the whole plant, states GYRO_STATES in SI units, from `gyro_numbers`.

    v, s output chains  x dx y dy modes (m, m/s)  c, e drive and sense C/V  p, q closed SID paths   ud us fx fy constant
    """
    import mpmath

    row = {name: dict.fromkeys(GYRO_STATES, mpmath.mpf(0)) for name in GYRO_STATES}

    def lag(name, tau, source, gain=1):
        # tau * name' = gain * source - name
        row[name][name] = -1 / tau
        row[name][source] = gain / tau

    for names, source, taus in (("v1 v2 v3", "ud", d["drive_poles"]), ("s1 s2 s3", "us", d["sense_poles"])):
        for name, tau in zip(names.split(), taus):
            lag(name, tau, source)
            source = name
    for chain, paths, mode, gain, ring in zip(("c", "e"), ("p", "q"), ("x", "y"), d["gains"], d["rings"]):
        lag(chain + "1", ring, mode, gain)
        lag(chain + "2", d["ina"], chain + "1")
        lag(chain + "3", d["driver"], chain + "2", d["signal_gain"])
        lag(paths + "1", d["rc"], chain + "3")
        lag(paths + "2", d["rc"], paths + "1")
        lag(paths + "3", d["rc"], paths + "2")

    m = d["mass_kg"]
    coriolis = 2 * d["coriolis_mass_kg"] * omega
    wx, wy = 2 * mpmath.pi * d["fx_hz"], 2 * mpmath.pi * d["fy_hz"]
    d_x, d_y = m * wx / d["qx"], m * wy / d["qy"]
    d_xy = d["dxy_ratio"] * d_x
    row["x"]["dx"] = row["y"]["dy"] = mpmath.mpf(1)
    force_x = {"x": -m * wx**2, "dx": -d_x, "y": -kappa, "dy": coriolis - d_xy, "v3": d["k_vf_drive_n_per_v"], "fx": 1}
    force_y = {"y": -m * wy**2, "dy": -d_y, "x": -kappa, "dx": -coriolis - d_xy, "s3": d["k_vf_sense_n_per_v"], "fy": 1}
    for name, force in (("dx", force_x), ("dy", force_y)):
        for source, newton in force.items():
            row[name][source] = newton / m
    return [[row[a][b] for b in GYRO_STATES] for a in GYRO_STATES]


# watchdog -----------------------------------------------------------------------------------------------------------


def watchdog(limit, inputs):
    """Rows (age, stale): the 1 MHz ticks since the last frame are counted anew in the whole past of each row."""
    rows = []
    for n in range(len(inputs) + 1):
        since = inputs[:n]
        frames = [k for k, (_, frame) in enumerate(since) if frame]
        if frames:
            since = since[frames[-1] + 1 :]
        ticks = sum(1 for ce_1m, _ in since if ce_1m)
        rows.append((min(ticks, 1023), int(ticks > limit)))
    return rows


def notch(g, c, inputs):
    """Rows (x1, x2, y1, y2) for inputs (en, x): words as fractions of full scale, the difference equation as it is.

    y is the nearest multiple of 2^-33, ties up, of the value that the coefficients g / 2^22 and c / 2^22 give.
    """
    gain, cosine = Fraction(g, 1 << 22), Fraction(c, 1 << 22)
    x, y = [Fraction(0)] * 2, [Fraction(0)] * 2
    rows = [(0, 0, 0, 0)]
    for en, word in inputs:
        if en:
            now = Fraction(word, 1 << 23)
            exact = gain * now + cosine * x[0] + gain * x[1] - cosine * y[0] - (2 * gain - 1) * y[1]
            steps = math.floor(exact * (1 << 33) + Fraction(1, 2))
            top = Fraction((1 << 23) - 1, 1 << 23)
            y = [max(Fraction(-1), min(top, Fraction(steps, 1 << 33))), y[0]]
            x = [now, x[0]]
        rows.append((int(x[0] * (1 << 23)), int(x[1] * (1 << 23)), int(y[0] * (1 << 33)), int(y[1] * (1 << 33))))
    return rows


# spi_slave ----------------------------------------------------------------------------------------------------------


def crc_j1850(text):
    """CRC-8/SAE-J1850 of a text of bits, before it is inverted: the remainder of a division of polynomials."""
    left = (int("0" + text, 2) << 8) ^ (0xFF << len(text))
    while left.bit_length() > 8:
        left ^= 0x11D << (left.bit_length() - 9)
    return left


def spi_slave_frame(loaded, bits, rdata, before):
    """What a frame has done to the registers after some bits, from the text of all of them.

    loaded  shift when it began;  bits  text of SDI;  rdata  words taken so far
    before  (words, read, address, data, second) when it began
    Row: (phase, bit, words, read, address, crc, shift, data, second, spoiled, refused)
    """
    count = len(bits)
    sent = f"{loaded:040b}"
    words, read, address, data, second = before
    if count < 16:
        return 0, count, words, read, address, crc_j1850(bits), int((sent + bits)[-40:], 2), data, second, 0, 0
    command = int(bits[:16], 2)
    read, asked, address = command >> 15, command >> 12 & 7, command & 2047
    refused = int(asked == 0 or (not read and asked > 2) or bool(command >> 11 & 1) or command % 4 > 0)
    length = max(asked, 1)
    first = 24 if read else 16
    last = first + 32 * length
    gone = min(max(count - first, 0) // 32, length - 1)
    phase = 1 if count < first else 2 if count < last else 3 if count < last + 8 else 4 if count == last + 8 else 5
    start = (0, 16, first + 32 * gone, last, last + 8, last + 8)[phase]
    bit = count - start if phase < 4 else (count - last - 8) % 32
    words = asked - gone
    known = "".join(f"{word:032b}" for word in rdata)
    covered = bits[:16] + (known[: count - first] if read else bits[16:last])
    crc = crc_j1850(covered[: 16 + 32 * length])
    spoiled = 0
    if read:
        spoiled = int(count >= 24 and int(bits[16:24], 2) != crc_j1850(bits[:16]) ^ 255)
        address += 4 * len(rdata)
        if count >= last:
            sent, start = f"{crc_j1850(covered) ^ 255:08b}" + "0" * 32, last
        elif count >= first:
            sent, start = f"{rdata[-1]:032b}" + "0" * 8, first + 32 * gone
        else:
            start = 0
    else:
        start = 0
        if count >= last + 8:
            spoiled = int(int(bits[last : last + 8], 2) != crc_j1850(bits[:last]) ^ 255)
        if gone:
            data, second = int(bits[first + 32 * (gone - 1) : first + 32 * gone], 2), 1
    shift = int((sent + bits[start:])[-40:], 2)
    return phase, bit, words, read, address % 2048, crc, shift, data, second, spoiled, refused


def spi_slave(inputs):
    """Register rows before each edge, and after the last: (cs_meta, cs_n, active, sck_meta, sck, sck_seen, sdi_meta,
    sdi, phase, bit, words, read, address, crc, shift, data, second, spoiled, refused, write, done, errors).

    inputs  (cs_n, sck, sdi, status, rdata, clear) at each edge
    """

    def past(name, n, rest):
        return inputs[n][name] if n >= 0 else rest

    rows = []
    kept = (0, 0, 0, 0, 0)  # words, read, address, data, second
    shift, bits, rdata, write, done, errors, owed = 0, "", [], 0, 0, 0, None
    for n in range(len(inputs) + 1):
        cs = [past(0, n - k, 1) for k in (1, 2, 3)]
        sck = [past(1, n - k, 0) for k in (1, 2, 3)]
        sdi = [past(2, n - k, 0) for k in (1, 2)]
        state = spi_slave_frame(shift, bits, rdata, kept)
        rows.append((cs[0], cs[1], 1 - cs[2], *sck, *sdi, *state, write, done, errors))
        if n == len(inputs):
            return rows
        _, _, _, status, word, clear = inputs[n]
        was = (write, done)
        write = done = wrong = 0
        words, read, address, data, second = state[2], state[3], state[4], state[7], state[8]
        following = owed if was[0] and second else None
        if cs[1]:
            if cs[2]:
                told = status * 8 + errors
                shift = (told << 32) | ((told ^ 255) << 24)
            else:
                phase, spoiled, refused = state[0], state[9], state[10]
                shift = state[6]
                if phase == 4 and not spoiled and not refused:
                    write, done = 1 - read, read
                    if second:
                        owed = state[6] >> 8 & 0xFFFFFFFF
                    else:
                        data = state[6] >> 8 & 0xFFFFFFFF
                else:
                    second = 0
                    wrong = 0 if not bits else 2 if phase != 4 else 1 if spoiled else 4
            bits, rdata = "", []
            if following is not None:
                data, address, second, write = following, (address + 4) % 2048, 0, 1
            kept = (words, read, address, data, second)
        else:
            if following is not None:
                kept = (words, read, (address + 4) % 2048, following, 0)
                write = 1
            if sck[1] and not sck[2]:
                bits += str(sdi[1])
                if len(bits) >= 24 and bits[0] == "1" and (len(bits) - 24) % 32 == 0:
                    if (len(bits) - 24) // 32 < max(int(bits[1:4], 2), 1):
                        rdata.append(word)
        errors = (errors & ~clear & 7) | wrong
    return rows


# host_bus -----------------------------------------------------------------------------------------------------------


def host_bus(pairs, inputs):
    """Register rows before each edge, and after the last, each from the whole past: (high, high_of, low, low_of,
    pending, bank_write, bank_address, bank_data, clear, frames, fresh, rate, temperature, status, number,
    held_temperature, held_status, held_number, unread, unread_after, reading).

    pairs   registers of two words
    inputs  (address, fetch, start, done, write, data, value, frame, valid, rate, temperature, k, flags, state, lock)
    """
    names = "address fetch start done write data value frame valid rate temperature k flags state lock".split()
    past = [dict(zip(names, row, strict=True)) for row in inputs]

    def before(n, wanted):
        return [m for m in range(n) if wanted(past[m])]

    def register(m):
        return past[m]["address"] // 8

    def high(m):
        return past[m]["address"] % 8 >= 4

    writes = before(len(past), lambda i: i["write"])
    bank = {}  # clock: word of 48 bits
    for place, m in enumerate(writes):
        opened = writes[place - 1] if place else None
        if high(m):
            if opened is not None and register(opened) == register(m) in pairs and not high(opened):
                bank[m] = past[m]["data"] % 2**16 * 2**32 + past[opened]["data"]
        elif register(m) not in pairs:
            bank[m] = past[m]["data"]
    frames = before(len(past), lambda i: i["frame"])
    samples = {}  # clock: number of the frame
    for number, m in enumerate(frames):
        begin = frames[number - 1] + 1 if number else 0
        if any(past[j]["valid"] for j in range(begin, m + 1)):
            samples[m] = number % 4096
    takes = before(len(past), lambda i: i["fetch"] and i["address"] == 0x280)
    ends = before(len(past), lambda i: i["start"] or i["done"])

    def last(clocks, n):
        return max((m for m in clocks if m < n), default=None)

    def reading(n):
        taken, ended = last(takes, n), last(ends, n)
        return int(taken is not None and (ended is None or ended <= taken))

    def since(first, n):
        return min(2, sum(first <= m < n for m in samples))

    def unread(n):
        reads = [m for m in range(n) if past[m]["done"] and reading(m)]
        return since(last(takes, reads[-1]) if reads else 0, n)

    def sample(n):
        """(rate, temperature, status, number) of the sample that is the newest before edge n."""
        m = last(samples, n)
        if m is None:
            return 0, 0, 0, 0
        i = past[m]
        status = i["flags"] + i["state"] * 256 + i["lock"] * 4096 + i["k"] * 65536
        return i["rate"], i["temperature"], status, samples[m]

    rows = []
    for n in range(len(past) + 1):
        read, written = last(before(n, lambda i: i["fetch"] and i["address"] % 8 < 4), n), last(bank, n)
        lows = [m for m in writes if m < n and not high(m) and register(m) in pairs]
        taken = last(takes, n)
        held = (0, 0, 0)
        if taken is not None:
            _, temperature, status, number = sample(taken)
            told = unread(taken)
            held = (temperature, status + (2**19 if told else 0) + (2**20 if told == 2 else 0), number)
        begun = last(frames, n)
        rows.append((
            past[read]["value"] // 2**32 if read is not None else 0,
            register(read) if read is not None else 0,
            past[lows[-1]]["data"] if lows else 0,
            register(lows[-1]) if lows else 0,
            int(bool(lows) and last(writes, n) == lows[-1]),
            int(written is not None and written == n - 1),
            register(written) if written is not None else 0,
            bank[written] if written is not None else 0,
            bank[written] % 8 if written is not None and written == n - 1 and register(written) == 0x54 else 0,
            sum(m < n for m in frames) % 4096,
            int(any(past[m]["valid"] for m in range(0 if begun is None else begun + 1, n))),
            *sample(n),
            *held,
            unread(n),
            since(taken or 0, n),
            reading(n),
        ))  # fmt: skip
    return rows


# the four loops: what their PI is given -----------------------------------------------------------------------------


def held(values, enables, reset=0):
    """Rows of a register that takes values[n] where enables[n], one row more than inputs."""
    rows = [reset]
    for value, enable in zip(values, enables, strict=True):
        rows.append(value if enable else rows[-1])
    return rows


def loop(gains, errors, inputs):
    """Rows (error, (prop, acc, y)) of a loop; gains as for `pi`, inputs (en, en_pi, mode, preset) per clock."""
    error = held(errors, [en for en, *_ in inputs])
    given = [(en, mode, e, preset) for (_, en, mode, preset), e in zip(inputs, error[:-1], strict=True)]
    controller = pi(*gains, given)
    return list(zip(error, controller, strict=True))


def centre(reset, inputs):
    """Rows of the tracker's centre from (en, load, adjust, correction, preset): the last load and all that follow."""
    rows = []
    for n in range(len(inputs) + 1):
        past = inputs[:n]
        loads = [k for k, (en, load, *_) in enumerate(past) if en and load]
        base = past[loads[-1]][4] if loads else reset
        after = past[loads[-1] + 1 :] if loads else past
        rows.append((base + sum(c for en, load, adjust, c, _ in after if en and adjust and not load)) % 2**48)
    return rows


# digital_sid --------------------------------------------------------------------------------------------------------


def nearest(value, unit):
    """Multiple of `unit` nearest to an exact value, ties upwards."""
    return math.floor(Fraction(value) / unit + Fraction(1, 2)) * unit


def digital_sid(alpha, gains, ref_delay, limit, inputs):
    """Rows (refs, acc, pole1, pole2, pole3, stage, codes, valid, last, still, ok), each lane in plain values.

    alpha and gains are Fractions.
    A dump leaves a list of errands, and every clock does the first of them.
    """
    lsb = Fraction(1, 2**16)
    seen, acc = [0, 0, 0, 0], [0] * 4
    poles, codes = [[Fraction(0)] * 4 for _ in range(3)], [0] * 4
    errands, rows, samples, ok = [], [], [(0, 0)], 0

    def still():
        changed = [any(a == b for a, b in zip(*pair)) for pair in itertools.pairwise(samples)]
        return min(run_length(changed), limit)

    def row(valid):
        raw = [tuple(int(v / lsb) for v in pole) for pole in poles]
        # the number of errands left tells the stage: three after a dump
        stage = (4 - len(errands)) % 4 if errands else 0
        return (tuple(seen[:4]), tuple(acc), *raw, stage, tuple(codes), valid, samples[-1], still(), ok)

    rows.append(row(0))
    for ce_1m, dump, refs, sample_x, sample_y in inputs:
        valid = 0
        errand = errands.pop(0) if errands else None
        if errand in (1, 2):
            pairs = zip(poles[errand - 1], poles[errand], strict=True)
            poles[errand] = [y + nearest(alpha * (x - y), lsb) for x, y in pairs]
        elif errand == 3:
            codes = [max(-(2**23), min(2**23 - 1, nearest(g * y, 1))) for g, y in zip(gains, poles[2], strict=True)]
            valid, ok = 1, int(not limit or still() < limit)
        if ce_1m:
            samples.append((sample_x, sample_y))
            aperture = ([refs] + seen)[ref_delay]
            lanes = [sample_x, sample_x, sample_y, sample_y]
            lanes = [v if (aperture >> k) % 2 else -v for k, v in enumerate(lanes)]
            if dump:
                poles[0] = [y + nearest(alpha * (x - y), lsb) for x, y in zip(acc, poles[0], strict=True)]
                acc, errands = lanes, [1, 2, 3]
            else:
                acc = [max(-(2**24), min(2**24 - 1, a + v)) for a, v in zip(acc, lanes, strict=True)]
            seen = [refs, *seen[:3]]
        rows.append(row(valid))
    return rows


# rate_output --------------------------------------------------------------------------------------------------------


def rate_output(c, samples):
    """(intermediates of each sample, means): the documented equations in Fractions; c has the coefficients by name.

    samples  (word, temperature code, decimation in force)
    Returns  per sample t, t2, bias, scale, corrected, scaled; and (index of the last sample, y) of each mean
    """
    steps, means, group = [], [], []
    for n, (word, temperature, decimation) in enumerate(samples):
        t = math.floor(Fraction(temperature, 256))
        t2 = nearest(Fraction(t * t, 2**15), 1)
        bias = c["bias"] + c["bias_t1"] * t + c["bias_t2"] * t2
        unit = Fraction(1, 2**28)
        scale = min(max(nearest(c["scale"] + c["scale_t1"] * t + c["scale_t2"] * t2, unit), Fraction(-2)), 2 - unit)
        unit = Fraction(1, 2**8)
        corrected = min(max(nearest(word - bias, unit), Fraction(-(2**23))), 2**23 - unit)
        unit = Fraction(1, 2**20)
        scaled = min(max(nearest(corrected * scale / 2**12, unit), Fraction(-(2**11))), 2**11 - unit)
        steps.append((t, t2, bias, scale, corrected, scaled))
        if not group:
            size = 2 ** min(decimation, 6)
        group.append(scaled)
        if len(group) == size:
            means.append((n, nearest(sum(group) / size, unit)))
            group = []
    return steps, means


# lock_monitor, fault_monitor, sequencer -----------------------------------------------------------------------------


def run_length(history):
    """How many of the last entries are true."""
    return next((k for k, entry in enumerate(reversed(history)) if not entry), len(history))


class Locks:
    """Four loops, each with the history of what spoke against its present state."""

    def __init__(self, p):
        self.p = p
        self.locked = [False] * 4
        self.against = [[] for _ in range(4)]

    def row(self):
        return sum(1 << k for k in range(4) if self.locked[k]), tuple(run_length(h) for h in self.against)

    def frame(self, enable, judged, agc_error, setpoint, phase, sense_sin, sense_cos, rail):
        errors = [abs(agc_error), abs(phase), abs(sense_sin), abs(sense_cos)]
        for k in range(4):
            if k not in enable:
                self.locked[k], self.against[k] = False, []
                continue
            if k not in judged:
                continue
            limit_in, limit_out = self.p.limit_in[k], self.p.limit_out[k]
            if k == 0:
                limit_in, limit_out = (math.floor(Fraction(v * setpoint, 2**16)) for v in (limit_in, limit_out))
            railed = k == 3 and rail
            against = errors[k] > limit_out and not railed if self.locked[k] else errors[k] <= limit_in or railed
            self.against[k].append(against)
            patience = (self.p.frames_out if self.locked[k] else self.p.frames_in)[k]
            if against and run_length(self.against[k]) >= patience:
                self.locked[k], self.against[k] = not self.locked[k], []


class Faults:
    """Histories of each symptom; flags are a set of names."""

    NAMES = "over_range lost_lock stale stuck drive rate rail search_failed".split()
    COUNTED = "over_range stuck drive rate rail".split()

    def __init__(self, p):
        self.p = p
        self.codes = (0, 0, 0, 0)
        self.clear_histories()

    def clear_histories(self):
        self.history = {name: [] for name in self.COUNTED}
        self.good, self.flags, self.latch = [], set(), set()

    def word(self, names):
        return sum(1 << k for k, name in enumerate(self.NAMES) if name in names)

    def row(self):
        counts = [min(run_length(self.history[name]), getattr(self.p, name)) for name in self.COUNTED]
        good = min(run_length(self.good), self.p.top)
        bad = min(run_length([not g for g in self.good]), self.p.top)
        return (self.codes, *counts, bad, good, self.word(self.flags), self.word(self.latch))

    def frame(self, armed, fresh, codes, drive, rate, rail, watch_stuck, levels, clear):
        if not armed:
            self.clear_histories()
            self.codes = codes
            return
        symptoms = {
            "over_range": fresh and max(map(abs, codes)) >= 8388608 - 256,
            "stuck": fresh and watch_stuck and any(a == b and abs(a) < 8388352 for a, b in zip(codes, self.codes)),
            "drive": drive,
            "rate": rate,
            "rail": rail,
        }
        for name, symptom in symptoms.items():
            self.history[name].append(bool(symptom))
        self.flags = {n for n in self.COUNTED if 0 < getattr(self.p, n) <= run_length(self.history[n])} | set(levels)
        if fresh:
            self.codes = codes
        else:
            self.flags.add("stale")
        self.good.append(not self.flags & {"stale", "stuck"})
        self.latch = {n for n in self.latch if not (clear >> self.NAMES.index(n)) & 1} | self.flags


def drive_story(p):
    """The way from STANDBY to LOCKED, told in order: yields a state, is sent what the frame was like.

    what  a dict: usable, recovered, turn (phase since the last frame, raw), magnitude, reached, drive, sense (locked)
    """
    what = yield "STANDBY"
    while not what["recovered"]:
        what = yield "STANDBY"
    while True:
        for _ in range(p.kick):
            yield "KICK"
        turns = None
        while turns is None:
            quiet = 0
            while quiet < p.decay:
                what = yield "DECAY"
                quiet = quiet + 1 if what["usable"] else 0
            turns = 0
            for _ in range(p.search):
                what = yield "SEARCH"
                if not what["usable"]:
                    turns = None
                    break
                turns += what["turn"]
        if abs(nearest(Fraction(turns * p.gain, 2**16), 1)) > p.search_limit or what["magnitude"] < p.min_magnitude:
            continue
        for _ in range(p.retune):
            yield "RETUNE"
        for _ in range(p.timeout):
            what = yield "ACQUIRE"
            if what["reached"]:
                break
        if not what["reached"]:
            continue
        for _ in range(p.timeout):
            what = yield "SETTLE"
            if what["drive"]:
                break
        state = "BALANCE"
        while what["drive"]:
            what = yield state
            state = "LOCKED" if what["sense"] else "BALANCE"


SEQUENCER_STATES = "POWER_UP INIT IDLE STANDBY OPEN KICK DECAY SEARCH RETUNE ACQUIRE SETTLE BALANCE LOCKED".split()


def sequencer(p, inputs):
    """Rows of all registers of the sequencer, in their order; inputs have the fields of its Inputs."""
    locks, faults = Locks(p.lock), Faults(p.faults)
    rank = SEQUENCER_STATES.index
    beginning = ["POWER_UP"] * p.power_up + ["INIT"] * p.init
    state, story = beginning.pop(0), None
    control = last_phase = rotation = correction = attempts = age = 0
    lost = failed = False
    rows = []

    def row():
        timer = min(age, 65535)
        return (rank(state), timer, control, last_phase, rotation, correction, attempts, int(lost), int(failed)) + (
            locks.row(),
            faults.row(),
        )

    rows.append(row())
    for i in inputs:
        fresh = bool(i.adc_ok and not i.stale)
        usable = fresh and "stuck" not in faults.flags
        bit = {name: bool((i.control >> k) & 1) for k, name in enumerate("run a p f q ff fq open clear".split())}
        idle = (bit["a"], bit["p"], bit["f"] or bit["ff"], bit["q"] or bit["fq"])
        judged = {k for k in range(4) if not idle[k]}
        fine = [locks.locked[k] or k not in judged for k in range(4)]
        turn = congruent_within(i.phase - last_phase, 2**24, -(2**23))
        what = {
            "usable": usable,
            "recovered": run_length(faults.good) >= p.recover,
            "turn": turn,
            "magnitude": i.magnitude,
            "reached": usable and Fraction(i.magnitude) >= Fraction(i.setpoint * p.reached, 2**16),
            "drive": fine[0] and fine[1],
            "sense": fine[2] and fine[3],
        }
        rotation = rotation + turn if state == "SEARCH" and usable else 0
        if state == "SEARCH":
            correction = nearest(Fraction(rotation * p.gain, 2**16), 1)

        before = state
        if state in ("POWER_UP", "INIT"):
            state = beginning.pop(0) if beginning else "IDLE"
        elif not bit["run"]:
            state, story = "IDLE", None
        elif bit["open"]:
            state, story = "OPEN", None
        elif story is None or (state != "STANDBY" and run_length([not g for g in faults.good]) >= p.offline):
            story = drive_story(p)
            state = next(story)
        else:
            state = story.send(what)

        age = 0 if state != before or (state == "DECAY" and not usable) else age + 1
        flags_before = set(faults.flags)
        levels = {name for name, level in (("lost_lock", lost), ("search_failed", failed)) if level}
        if state == "KICK" and before in ("SEARCH", "ACQUIRE", "SETTLE"):
            failed, attempts = True, min(attempts + 1, 255)
        if state == "KICK" and before in ("BALANCE", "LOCKED"):
            lost = True
        if state in ("IDLE", "BALANCE", "LOCKED"):
            lost = failed = False
        control = i.control
        if fresh:
            last_phase = i.phase
        if usable or rank(before) < rank("SETTLE"):
            enable = [0, 1] * (rank(before) >= rank("SETTLE")) + [2, 3] * (rank(before) >= rank("BALANCE"))
            error = i.setpoint - i.magnitude
            locks.frame(enable, judged, error, i.setpoint, i.phase, i.sense_sin, i.sense_cos, i.qsc_rail)
        faults.frame(
            before not in ("POWER_UP", "INIT"),
            fresh,
            (i.drive_sin, i.drive_cos, i.sense_sin, i.sense_cos),
            i.drive_saturated and rank(before) >= rank("SETTLE"),
            i.rate_saturated,
            i.qsc_rail and before in ("BALANCE", "LOCKED") and not bit["fq"],
            rank(before) >= rank("SEARCH") or (before == "STANDBY" and "stuck" in flags_before),
            levels,
            255 if bit["clear"] else i.clear,
        )
        rows.append(row())
    return rows


# ---- testbench: scenario, waveforms ----------------------------------------------------------------------------


def profile_at(points, t, steps):
    """Value at time t of a profile of points (time, value), exact; a later point at one time wins."""
    before = [p for p in points if Fraction(p[0]) <= t]
    after = [p for p in points if Fraction(p[0]) > t]
    if not before:
        return Fraction(points[0][1])
    (t0, v0) = before[-1]
    if steps or not after:
        return Fraction(v0)
    (t1, v1) = after[0]
    share = (t - Fraction(t0)) / (Fraction(t1) - Fraction(t0))
    return Fraction(v0) + share * (Fraction(v1) - Fraction(v0))


def edge_picoseconds(edge, clock_mhz=26):
    """Time of an edge of the clock in whole picoseconds, nearest."""
    exact = Fraction(edge * 10**6, clock_mhz)
    whole = exact.numerator // exact.denominator
    return whole + (1 if exact - whole >= Fraction(1, 2) else 0)


# noise --------------------------------------------------------------------------------------------------------------


def noise_words(key0, key1, counter):
    """The counter hash, round by round: both halves of a 63-bit product, the key stepping by the golden ratio."""
    left, right = counter % 2**32, (counter // 2**32) ^ key1
    for turn in range(7):
        product = left * 1327217885
        left, right = (product // 2**31) ^ right ^ ((key0 + turn * 2654435769) % 2**32), product % 2**32
    return left, right


def noise_counter(key0, key1, words):
    """Undo the hash: which counter gave these words."""
    left, right = words
    inverse = pow(1327217885, -1, 2**32)
    for turn in reversed(range(7)):
        before = right * inverse % 2**32
        left, right = before, left ^ (before * 1327217885 // 2**31) ^ ((key0 + turn * 2654435769) % 2**32)
    return left + (right ^ key1) * 2**32


def noise_sum(key0, key1, counters):
    """Sum over counters of the four 16-bit halves of the hash, less its mean."""
    halves = [h for c in counters for w in noise_words(key0, key1, c) for h in divmod(w, 2**16)]
    return Fraction(sum(halves)) - Fraction(65535 * len(halves), 2)


# axi_slave ----------------------------------------------------------------------------------------------------------


def axi_slave(inputs):
    """Register rows before each edge, and after the last, from the instants of every transfer: (awready, awaddr,
    wready, wdata, wstrb, bvalid, bresp, arready, araddr, rvalid, rdata, rresp).

    inputs  (awvalid, awaddr, wvalid, wdata, wstrb, bready, arvalid, araddr, rready, word) at each edge
    A transfer happens at the first edge at which it may with its level at 1; an access in the first clock it may.
    """
    end = len(inputs)

    def first(level, at):
        return next((n for n in range(at, end) if inputs[n][level]), end)

    aw, w, b, turns = [], [], [], []  # of each write: address, data and response pass, and the clock of its access
    while not turns or turns[-1] < end:
        after = turns[-1] + 1 if turns else 0
        aw.append(first(0, after))
        w.append(first(2, after))
        turns.append(max(aw[-1], w[-1], b[-1] if b else -1) + 1)
        b.append(first(5, turns[-1] + 1))
    ar, r, fetches = [], [], []
    while not fetches or fetches[-1] < end:
        ar.append(first(6, fetches[-1] + 1 if fetches else 0))
        fetches.append(max(ar[-1], r[-1] if r else -1) + 1)
        while fetches[-1] in turns:
            fetches[-1] += 1
        r.append(first(8, fetches[-1] + 1))

    def between(begins, ends, n):
        return int(any(a < n <= z for a, z in zip(begins, ends, strict=True)))

    def at_last(clocks, n, what, rest=0):
        past = [k for k, m in enumerate(clocks) if m < min(n, end)]
        return what(past[-1]) if past else rest

    def written(k):
        strobes = inputs[w[k]][4]
        return 0 if inputs[aw[k]][1] % 4 == 0 and strobes in (0, 15) else 2

    def whole(k):
        return inputs[ar[k]][7] % 4 == 0

    return [
        (
            1 - between(aw, turns, n),
            at_last(aw, n, lambda k: inputs[aw[k]][1]),
            1 - between(w, turns, n),
            at_last(w, n, lambda k: inputs[w[k]][3]),
            at_last(w, n, lambda k: inputs[w[k]][4]),
            between(turns, b, n),
            at_last(turns, n, written),
            1 - between(ar, fetches, n),
            at_last(ar, n, lambda k: inputs[ar[k]][7]),
            between(fetches, r, n),
            at_last(fetches, n, lambda k: inputs[fetches[k]][9] if whole(k) else 0),
            at_last(fetches, n, lambda k: 0 if whole(k) else 2),
        )
        for n in range(end + 1)
    ]
