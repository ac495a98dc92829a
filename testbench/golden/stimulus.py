"""Stimulus that means something: directed families made from the formats of a block, then random ones.

    idle, corners, signs, walking_ones    from the formats of the inputs alone
    edges                                 truncation carries, saturation edges +-1 LSB: solved per block and case
    reset_at, enable_at, controls         reset and enable at every state of the pipeline, all 1-bit inputs together
    held, script                          long steady inputs: debouncing, limit cycles, whole frames, start-up
    random_*                              dense, sparse and corner-weighted

The generator is our own (splitmix64 on Python integers), so that no library can change a vector.
Source  docs/blocks/ (the limits); Steele, Lea, Flood, OOPSLA 2014 (splitmix64)
"""

import itertools

import numpy as np

from fpga_model import fault_monitor, lock_monitor, modulator, pi, rates, registers, sequencer, spi_adc
from testbench.golden import blocks

MASK64 = (1 << 64) - 1
WALKING_ROWS = 2600  # rows that the walking ones of one block may take
RANDOM_ROWS = 600
SEED = 20260131


class Random:
    """splitmix64: 64 bits per call, the same for ever."""

    def __init__(self, seed):
        self.state = seed & MASK64

    def next(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & MASK64
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK64
        return z ^ (z >> 31)

    def below(self, n):
        """0 .. n - 1; the bias of the product is below n / 2**64."""
        return self.next() * n >> 64

    def raw(self, fmt):
        return fmt.lo + self.below(fmt.hi - fmt.lo + 1)

    def pick(self, items):
        return items[self.below(len(items))]


def corners(fmt):
    """Raw values at the ends of a format, around zero and around its middle bits; ascending, without repetition."""
    half = 1 << max(fmt.width - 1 - fmt.s, 0)
    near = {fmt.lo, fmt.lo + 1, -1, 0, 1, fmt.hi - 1, fmt.hi, half - 1, half, half + 1, -half, half >> 1}
    alternate = int("01" * 32, 2)
    near |= {alternate & fmt.hi, (alternate << 1) & fmt.hi}
    return sorted(v for v in near if fmt.holds(v))


class Writer:
    """Rows in the making, and the families they belong to."""

    def __init__(self, block, case, seed=SEED):
        self.block, self.case = block, case
        self.random = Random(seed ^ int.from_bytes(f"{block.stem}/{case}".encode()[-8:], "big"))
        self.names = [port.name for port in block.columns]
        self.wide = [port for port in block.inputs if port.width > 1]
        self.flags = [port for port in block.inputs if port.width == 1]
        self.rows, self.families = [], []

    def family(self, name):
        self.families.append([name, len(self.rows), 0])

    def row(self, values=None, rst=0, times=1):
        """`times` rows: idle values but for those given."""
        full = {**dict.fromkeys(self.names, 0), **self.block.idle, **(values or {}), blocks.RESET_INPUT: rst}
        if len(full) != len(self.names):
            raise ValueError(f"{self.block.stem}: no input {sorted(set(full) - set(self.names))}")
        self.rows += [[full[name] for name in self.names]] * times
        self.families[-1][2] = len(self.rows) - self.families[-1][1]

    def operation(self, values, strobes=1):
        """One operation: the strobes high in one row with the values, then as many quiet rows as it takes."""
        if self.block.stem == "spi_adc":
            frame(self, self.random)
            return
        self.row({**dict.fromkeys(self.block.strobes, strobes), **values})
        if self.block.wait:
            self.row({**values, **dict.fromkeys(self.block.strobes, 0)}, times=self.block.wait)

    def some(self):
        """Random values for every input wider than one bit."""
        return {port.name: self.random.raw(port.fmt) for port in self.wide}

    def flips(self, low=1, of=2):
        """Random values for every 1-bit input, 1 in `low` of `of`."""
        return {port.name: int(self.random.below(of) < low) for port in self.flags}


def frame(w, random, status=None, cut=spi_adc.FRAME_BITS, rows=None):
    """A conversion for `spi_adc`: DRDY_N falls, bits follow the serial clock; `cut` bits, then DOUT rests."""
    head = (spi_adc.HEAD << 20) | random.below(1 << 20) if status is None else status
    words = [head] + [random.next() & 0xFFFFFF for _ in range(spi_adc.CHANNELS)]
    if rows is not None:
        words[1:] = rows
    line = [(word >> (23 - k)) & 1 for word in words for k in range(24)][:cut]
    w.row({"drdy_n": 0, "dout": line[0]}, times=4)
    for bit in line:
        w.row({"drdy_n": 1, "dout": bit}, times=2)
    w.row({"drdy_n": 1}, times=spi_adc.TAIL_CYCLES + 4)


# ---- families from the formats --------------------------------------------------------------------------------------


def _idle(w):
    w.row(times=8)


def _corners(w):
    w.family("corners")
    for port in w.wide:
        for value in corners(port.fmt):
            w.operation({**w.some(), port.name: value})


def _signs(w):
    """Every sign of every wide input together: where products and sums are longest."""
    w.family("signs")
    ends = [(port.fmt.lo, port.fmt.hi) for port in w.wide]
    if len(ends) > 6:
        mixes = [[w.random.pick(pair) for pair in ends] for _ in range(64)]
    else:
        mixes = itertools.product(*ends)
    for mix in mixes:
        values = {port.name: value for port, value in zip(w.wide, mix, strict=True)}
        w.operation(values)
        w.operation(values)


def _walking_ones(w):
    w.family("walking_ones")
    places = [(port, k) for port in w.wide for k in range(port.width)]
    stride = max(1, -(-len(places) * (1 + w.block.wait) // WALKING_ROWS))
    for port, k in places[::stride]:
        value = 1 << k
        if port.signed and k == port.width - 1:
            value = port.fmt.lo
        w.operation({**w.some(), port.name: value})


def _reset_at(w):
    """Reset k rows after an operation began, for every k until it is over, and again with the strobes high."""
    w.family("reset_at")
    for k in range(min(blocks.depth_of(w.block), 64) + 3):
        values = w.some()
        w.row({**values, **dict.fromkeys(w.block.strobes, 1)})
        w.row({**values, **({} if w.block.wait else dict.fromkeys(w.block.strobes, 1))}, times=k)
        w.row({**w.some(), **w.flips()}, rst=1)
        w.row(times=2)


def _enable_at(w):
    """A second operation k rows after the first, for every k until it is over."""
    if not w.block.strobes:
        return
    w.family("enable_at")
    least = 1 if w.block.dense else w.block.wait
    for k in range(least, max(least, blocks.depth_of(w.block)) + 3):
        values = w.some()
        w.row({**values, **dict.fromkeys(w.block.strobes, 1)})
        w.row(values, times=k - 1)
        w.operation(w.some())


def _controls(w):
    """Every word of the 1-bit inputs, or 64 random ones, with random data."""
    if not w.block.dense:
        return
    w.family("controls")
    count = len(w.flags)
    words = range(1 << count) if count <= 6 else [w.random.below(1 << count) for _ in range(64)]
    for word in words:
        for _ in range(2):
            w.row({**w.some(), **{port.name: (word >> k) & 1 for k, port in enumerate(w.flags)}})


def _held(w):
    """Steady inputs with the strobes high, 1 to 40 rows each: counters, accumulators and idle tones."""
    if not w.block.dense:
        return
    w.family("held")
    for _ in range(40):
        values = {port.name: w.random.pick(corners(port.fmt)) for port in w.wide}
        values |= w.flips(1, 4)
        values |= dict.fromkeys(w.block.strobes, 1)
        w.row(values, times=1 + w.random.below(40))


def _random(w):
    if w.block.dense:
        w.family("random_dense")
        for _ in range(RANDOM_ROWS):
            w.row({**w.some(), **w.flips()}, rst=int(w.random.below(100) == 0))
        w.family("random_corners")
        for _ in range(RANDOM_ROWS):
            w.row({**{p.name: w.random.pick(corners(p.fmt)) for p in w.wide}, **w.flips(3, 4)})
    w.family("random_sparse")
    for _ in range(RANDOM_ROWS // (1 + w.block.wait)):
        others = {k: v for k, v in w.flips().items() if k not in w.block.strobes}
        w.operation({**w.some(), **others})
        if w.random.below(4) == 0:
            w.row(w.some(), times=w.random.below(5))


# ---- edges: what the formats do not say -----------------------------------------------------------------------------


def _inverse(odd, n):
    return pow(odd, -1, 1 << n)


def _edges_phase(w):
    """The quadrant edges and the edges of what is cut below them, +-1 LSB, in every phase input."""
    values = []
    for quadrant in range(4):
        for near in (0, 1, 1 << 25, (1 << 26) - 1, 1 << 26, (1 << 36) - 1, 1 << 36):
            values += [((quadrant << 46) + near) % (1 << 48), ((quadrant << 46) - near) % (1 << 48)]
    for value in values:
        w.operation({port.name: value for port in w.wide})


def _signed_mod(value, fmt):
    """The value that is `value` modulo the width of a signed format."""
    width = fmt.width
    return ((value - fmt.lo) % (1 << width)) + fmt.lo


def _edges_modulator(w):
    """Products whose dropped bits are 0, 1, a half +-1, all ones; and codes at both limits +-1 LSB."""
    p = w.block.cases[w.case]
    both = {"en_product": 1, "en_code": 1}
    for low in (0, 1, (1 << (p.shift - 1)) - 1, 1 << (p.shift - 1), (1 << (p.shift - 1)) + 1, (1 << p.shift) - 1):
        for sine in (1, 3, 65535, 131071, -1, -65537, -131071):
            solved = low * _inverse(sine, p.shift) % (1 << min(p.shift, 24))
            for lift in (0, 1 << 23):
                w.row({**both, "amplitude": _signed_mod(solved + lift, modulator.AMPLITUDE), "sine": sine})
    full = modulator.SINE.hi
    for limit in (p.lo, p.hi):
        for near in range(-2, 3):
            for tie in (-1, 0, 1):
                wanted = ((limit + near) << p.shift) + (1 << (p.shift - 1)) + tie
                for sine in (full, modulator.SINE.lo):
                    amplitude = wanted // sine
                    for step in (0, 1):
                        if modulator.AMPLITUDE.holds(amplitude + step):
                            w.row({**both, "amplitude": amplitude + step, "sine": sine})
    w.row(times=3)


def _edges_pi(w):
    """acc and y at both limits +-1 LSB by preset and by steps of e; sums whose 24 dropped bits are a tie +-1."""
    p = w.block.cases[w.case]
    for limit in (p.lo, p.hi):
        for near in range(-2, 3):
            preset = limit + near
            if not pi.OUT.holds(preset):
                continue
            w.row({"en": 1, "mode": pi.OFF, "preset": preset})
            for e in (0, 1, -1, 2, -2, pi.ERR.hi, pi.ERR.lo, 1, -1):
                for mode in (pi.RUN, pi.P_ONLY, pi.HOLD):
                    w.row({"en": 1, "mode": mode, "e": e, "preset": preset})
            w.row({"mode": pi.RUN, "e": 5}, times=2)
    for gain, mode in ((p.kp, pi.P_ONLY), (p.ki, pi.RUN)):
        twos = (gain & -gain).bit_length() - 1 if gain else pi.SHIFT
        if twos >= pi.SHIFT:
            continue
        odd, n = gain >> twos, pi.SHIFT - twos
        for low in (0, (1 << 23) - (1 << twos), 1 << 23, (1 << 23) + (1 << twos), (1 << 24) - (1 << twos)):
            e = (low >> twos) * _inverse(odd, n) % (1 << n)
            for sign in (1, -1):
                w.row({"en": 1, "mode": pi.OFF, "preset": 0})
                w.row({"en": 1, "mode": mode, "e": sign * e})
                w.row({"mode": mode}, times=2)


def _edges_cordic(w):
    lo, hi = -(1 << 23), (1 << 23) - 1
    for x, y in itertools.product((lo, lo + 1, -1, 0, 1, hi), repeat=2):
        w.operation({"x_in": x, "y_in": y})
    for x, y in ((1000, 1000), (-1000, 1000), (3, 4), (hi, 1), (lo, 1), (lo, -1)):
        w.operation({"x_in": x, "y_in": y})


def _edges_isqrt(w):
    for root in (1, 2, 3, 255, 256, 257, 4095, 46340, 65534, 65535):
        for u in (root * root - 1, root * root, root * root + 1):
            w.operation({"u": u})


def _edges_registers(w):
    for address in [*range(len(registers.WRITABLE) + 2), registers.FIRST_READ_ONLY, 255]:
        for data in (0, 1, registers.DATA.hi, 1 << 47, int("01" * 24, 2), int("10" * 24, 2)):
            w.row({"write": 1, "address": address, "data": data})
            w.row({"address": address, "data": data ^ registers.DATA.hi})
    for write, taken in itertools.product((0, 1), repeat=2):
        w.row({"write": 1, "address": 1, "data": 0xA5})
        w.row({"write": write, "address": 1, "data": 0x5A, "taken": taken})
        w.row(times=1)


def _edges_lock_monitor(w):
    """Each error at both of its limits +-1 LSB, long enough to lock and to lose lock."""
    p = w.block.cases[w.case]
    common = {"en": 1, "enable": 15, "judged": 15, "setpoint": 1 << 22}
    errors = ("agc_error", "phase", "sense_sin", "sense_cos")

    def limit(k, table):
        return (common["setpoint"] * table[k]) >> lock_monitor.FRACTION if k == 0 else table[k]

    for k, name in enumerate(errors):
        for table, frames in ((p.limit_in, p.frames_in), (p.limit_out, p.frames_out)):
            for near in (0, 1):
                for sign in (1, -1):
                    w.row({**common, name: sign * (limit(k, table) + near)}, times=min(frames[k], 420) + 2)
    w.row({**common, "sense_cos": 1 << 22, "rail": 1}, times=min(p.frames_in[3], 420) + 2)
    for word in range(16):
        w.row({**common, "enable": word, "judged": 15 ^ word}, times=2)


def _edges_fault_monitor(w):
    p = w.block.cases[w.case]
    common = {"en": 1, "armed": 1, "fresh": 1, "watch_stuck": 1}
    for k in range(4):
        for value in (fault_monitor.RANGE_LIMIT, fault_monitor.RANGE_LIMIT - 1):
            for sign in (1, -1):
                for row in range(p.over_range + 2):
                    w.row({**common, f"codes_{k}": sign * value, f"codes_{k ^ 1}": row})
    for name, frames in (("drive", p.drive), ("rate", p.rate), ("rail", p.rail)):
        for times in (frames - 1, frames, frames + 1):
            for row in range(times):
                w.row({**common, "codes_0": row, f"i_{name}": 1})
            w.row({**common, "codes_0": -1})
    for times in (p.stuck, p.stuck + 1, p.stuck + 2):
        w.row({**common, "codes_2": times}, times=times)
    w.row({**common, "fresh": 0}, times=5)
    for word in range(8):
        w.row({**common, "codes_1": word, "clear": 1 << word})
        w.row({**common, "codes_1": ~word, "levels": 1 << word, "clear": 1 << word})


def _edges_spi_adc(w):
    for status in (0xC00000, 0xCFFFFF, 0x800000, 0x400000, 0xD00000, 0xFFFFFF, 0):
        frame(w, w.random, status)
    for word in (0, 1, 0x800000, 0x7FFFFF, 0xFFFFFF, 0x555555, 0xAAAAAA):
        frame(w, w.random, rows=[word] * spi_adc.CHANNELS)
    for rows in (1, 2, 3, 4, 5, 6, 50, 51, 100, 430, 434, 435, 436, 470, 487, 488, 489, 490):
        begun = len(w.rows)
        frame(w, w.random)
        w.rows[begun + rows :] = []
        w.row({"drdy_n": 0, "dout": 1}, rst=1)
        w.row({"drdy_n": 1}, times=5)
    for cut in (1, 25, 100):
        frame(w, w.random, cut=cut)
        w.row(times=500)


def _edges_watchdog(w):
    p = w.block.cases[w.case]
    for ticks in (p.limit - 1, p.limit, p.limit + 1):
        w.row({"ce_1m": 1}, times=ticks)
        w.row(times=2)
        w.row({"frame": 1})
    w.row({"ce_1m": 1}, times=1030)
    w.row({"ce_1m": 1, "frame": 1})
    w.row({"ce_1m": 1}, times=3)


def _edges_rates(w):
    w.row(times=rates.FRAME_CYCLES + 30)
    w.row({"go": 1}, times=3)
    w.row(times=rates.SLOTS + 3)


def _edges_digital_sid(w):
    """A frame of full-scale samples of either sign, and dumps at every distance from the last."""
    for x, y in ((131071, -131072), (-131072, 131071), (-131072, -131072)):
        for refs in (0, 15, 5, 10):
            w.row({"ce_1m": 1, "refs": refs, "sample_x": x, "sample_y": y}, times=140)
            w.operation({"refs": refs, "sample_x": x, "sample_y": y})
    for gap in range(1, 8):
        w.row({"ce_1m": 1, "dump": 1, **w.some()})
        w.row({"refs": 3}, times=gap)


def _edges_sequencer(w):
    """Start-up to LOCKED in few frames, loss and recovery, each control bit, a stale and a stuck ADC."""
    w.row(rst=1)
    setpoint = 1 << 23
    frames = itertools.count(1)

    def run(times, control=sequencer.RUN, magnitude=setpoint, phase=0, alive=True, **more):
        for _ in range(times):
            moving = next(frames) if alive else 7
            w.row(
                {
                    "en": 1,
                    "i_adc_ok": 1,
                    "i_control": control,
                    "i_drive_sin": moving,
                    "i_magnitude": magnitude,
                    "i_setpoint": setpoint,
                    "i_phase": phase,
                    **{f"i_{k}": v for k, v in more.items()},
                }
            )

    run(10, control=0)
    for magnitude in (setpoint, 0):
        run(90, magnitude=magnitude)
    run(90)
    for k in range(1, len(sequencer.CONTROL_BITS)):
        run(4, control=sequencer.RUN | 1 << k)
        run(70)
    run(20, sense_sin=1 << 22)
    run(10)
    run(20, sense_cos=-(1 << 22), qsc_rail=1)
    run(10, drive_saturated=1, rate_saturated=1)
    run(10, drive_cos=0x7FFFFF)
    run(20, alive=False)
    run(80)
    run(3, adc_ok=0)
    run(5)
    run(3, stale=1)
    run(30, stale=1)
    run(80)
    run(30, phase=1 << 22)
    for step in (1 << 18, -(1 << 18), 1 << 22):
        run(1, control=0)
        for k in range(80):
            run(1, phase=((k * step + (1 << 23)) % (1 << 24)) - (1 << 23))
    reached = setpoint * w.block.cases[w.case].reached >> 16
    for magnitude in (reached - 1, reached, reached + 1):
        run(1, control=0)
        run(60, magnitude=magnitude)


def _edges_loop(w):
    """Strobes one clock apart as in the design, modes in turn, the inputs at their corners, long enough to saturate."""
    modes = next(port for port in w.wide if port.name == "mode")
    data = [port for port in w.wide if port.name != "mode"]
    for mode in (0, 2, 1, 2, 3, modes.fmt.hi, 2):
        for port in data:
            for value in corners(port.fmt):
                w.row({**w.some(), "mode": mode, port.name: value, "en": 1})
                w.row({**w.some(), "mode": mode, port.name: value, "en_pi": 1})
                w.row({"mode": mode}, times=3)


def _edges_rate_output(w):
    """Both polynomials at their corners, and every decimation with a change in the middle of a mean."""
    for k in range(8):
        for _ in range((1 << min(k, 6)) + 3):
            w.operation({"decimation": k, "scale": 1 << 28, "word": w.random.raw(w.wide[7].fmt)})


EDGES = {
    "dds": _edges_phase,
    "sine": _edges_phase,
    "references": _edges_phase,
    "modulator": _edges_modulator,
    "pi": _edges_pi,
    "cordic": _edges_cordic,
    "isqrt": _edges_isqrt,
    "registers": _edges_registers,
    "lock_monitor": _edges_lock_monitor,
    "fault_monitor": _edges_fault_monitor,
    "spi_adc": _edges_spi_adc,
    "watchdog": _edges_watchdog,
    "rates": _edges_rates,
    "digital_sid": _edges_digital_sid,
    "sequencer": _edges_sequencer,
    "agc": _edges_loop,
    "frequency_tracker": _edges_loop,
    "rate_loop": _edges_loop,
    "quadrature_loop": _edges_loop,
    "rate_output": _edges_rate_output,
}


def make(block, case, seed=SEED):
    """(rows, families): int64 rows in the columns of the block, and (name, first row, rows) of each family."""
    w = Writer(block, case, seed)
    w.family("idle")
    _idle(w)
    if block.stem in EDGES:
        w.family("edges")
        EDGES[block.stem](w)
    if w.wide:
        for part in (_corners, _signs, _walking_ones):
            part(w)
    for part in (_reset_at, _enable_at, _controls, _held, _random):
        part(w)
    return np.array(w.rows, np.int64), [tuple(found) for found in w.families]
