"""Script of the sequencer: start-up to LOCKED in few frames, loss and recovery, and every comparison at its edge.

The model itself runs along, so that the script can wait for a state.
Source  fpga_model/sequencer.py
"""

import itertools

from fpga_model import fault_monitor, lock_monitor, sequencer
from fpga_model.fixed import signed_bits
from testbench.golden.stimulus.writer import LONG_ROWS, around

SETPOINT = 1 << 23
FAR = 1 << 20
CHANNELS = ("drive_sin", "drive_cos", "sense_sin", "sense_cos")
PATIENCE = 120  # frames within which a state has to come
MOST_FRAMES = 20_000  # of a start-up with the times of a board
LOST = {"magnitude": SETPOINT >> 1, "phase": 1 << 22, "sense_sin": 1 << 22, "sense_cos": 1 << 22}
EXCLUSION_BITS = [getattr(sequencer, name) for name in sequencer.CONTROL_BITS if name.startswith(("HOLD_", "FIX_"))]
ALL_HOLD_BITS = sequencer.HOLD_AGC | sequencer.HOLD_PLL | sequencer.HOLD_FTR
CUT = sequencer.GAIN.f


class Walk:
    """Frames into a writer, with codes that move so that the ADC does not look stuck."""

    def __init__(self, w):
        self.w, self.p = w, w.block.cases[w.case]
        self.frames = itertools.count(1)
        self.reset()

    def reset(self, en=1):
        self.w.append_row({"en": en, "i_control": sequencer.RUN}, rst=1)
        self.state = sequencer.State()

    def run(self, times=1, control=sequencer.RUN, rests=(), **more):
        """Frames; the codes of the channels in `rests` do not move."""
        for _ in range(times):
            frame = next(self.frames)
            frame_inputs = {"control": control, "adc_ok": 1, "drive_sin": frame, "drive_cos": -frame}
            frame_inputs |= {"magnitude": SETPOINT, "setpoint": SETPOINT, **more}
            # a code near its limit is exact
            for name in ("sense_sin", "sense_cos"):
                value = frame_inputs.get(name, 0)
                frame_inputs[name] = value ^ (frame & 1) if value == 0 or abs(value) >= FAR else value
            frame_inputs |= dict.fromkeys(rests, 7)
            self.w.append_row({"en": 1, **{f"i_{name}": value for name, value in frame_inputs.items()}})
            self.state = sequencer.step(self.p, self.state, 1, sequencer.Inputs(**frame_inputs))

    def until(self, state, **more):
        """Frames until the state comes; False if it does not."""
        for _ in range(PATIENCE):
            if self.state.state == state:
                return True
            self.run(**more)
        return False

    def again(self, state, **more):
        """From IDLE to a state."""
        self.run(1, control=0)
        return self.until(state, **more)


def _walks(walk):
    """The user's bits, faults of every kind, lost lock, a bad ADC, searches that find and that do not."""
    run = walk.run
    run(10, control=0)
    for magnitude in (SETPOINT, 0):
        run(90, magnitude=magnitude)
    run(90)
    for k in range(1, len(sequencer.CONTROL_BITS)):
        run(4, control=sequencer.RUN | 1 << k)
        run(70)
    run(20, sense_sin=1 << 22)
    run(10)
    run(20, sense_cos=-(1 << 22), qsc_rail=1)
    for k in range(fault_monitor.FLAGS.width):
        run(6, drive_saturated=1, rate_saturated=1, qsc_rail=1, drive_cos=0x7FFFFF)
        run(2, clear=1 << k)
    run(10, drive_cos=0x7FFFFF)
    for rests in (CHANNELS, *((name,) for name in CHANNELS)):
        run(20, rests=rests)
        run(80)
    run(3, adc_ok=0)
    run(5)
    run(33, stale=1)
    run(80)
    run(30, phase=1 << 22)
    for step in (1 << 18, -(1 << 18), 1 << 22):
        run(1, control=0)
        for k in range(80):
            run(1, phase=((k * step + SETPOINT) % (1 << 24)) - SETPOINT)


def _attempts(walk):
    """Failed attempts until their counter is at its top and beyond."""
    if walk.p.search == 1:
        walk.run(3 * (sequencer.ATTEMPTS_TOP + 4), magnitude=0)


def _magnitude_thresholds(walk):
    """The magnitude at `reached` of the setpoint +-1 LSB of the magnitude, then of the product; and too slow."""
    p = walk.p
    walk.again(sequencer.ACQUIRE)
    walk.run(p.timeout + 2, magnitude=SETPOINT >> 1)
    for offset_lsb in (-1, 0, 1):
        walk.again(sequencer.ACQUIRE)
        walk.run(2, magnitude=(SETPOINT * p.reached >> 16) + offset_lsb)
    for offset_lsb in (-1, 1):
        setpoint = -offset_lsb * pow(p.reached, -1, 1 << 16) % (1 << 16)
        walk.again(sequencer.ACQUIRE)
        walk.run(1, setpoint=setpoint, magnitude=(setpoint * p.reached + offset_lsb) >> 16)
        walk.run(2)
    for offset_lsb in (-1, 0, 1):
        walk.run(1, magnitude=p.min_magnitude + offset_lsb)


def _rotations(walk):
    """Rotations whose product with the gain is at every edge of its rounding; phase steps at their ends."""
    p, size, half = walk.p, 1 << CUT, 1 << (CUT - 1)
    inverse = pow(p.gain, -1, size) if p.gain % 2 else 0
    rounding_cases = [(low, None, None) for low in (0, 1, half - 1, half + 1, size - 1)]
    rounding_cases += [(half, odd, negative) for odd in (0, 1) for negative in (False, True)]
    sums = []
    for low, odd, negative in rounding_cases:
        start = low * inverse % size
        for turn in itertools.chain.from_iterable((k, -1 - k) for k in range(8)):
            total = start + turn * size
            product = total * p.gain
            if odd is None or ((product >> CUT) & 1, product < 0) == (odd, negative):
                sums.append(total)
                break
    limit = (p.search_limit << CUT) // p.gain
    groups = [sums[k : k + max(1, p.search - 2)] for k in range(0, len(sums), max(1, p.search - 2))]
    for group in groups:
        if walk.again(sequencer.SEARCH):
            phase = before = 0
            for total in group:
                phase, before = phase + total - before, total
                walk.run(1, phase=_wrap_phase(phase))
    for offset_lsb in (-1, 0, 1, 2):
        if walk.again(sequencer.SEARCH):
            target_rotation, frames = limit + offset_lsb, p.search
            for k in range(1, frames + 1):
                walk.run(1, phase=_wrap_phase(target_rotation * k // frames))
    for first, second in ((2, -SETPOINT + 1), (1 - SETPOINT, 1), (0, -SETPOINT), (-SETPOINT, -1)):
        if walk.again(sequencer.SEARCH, phase=first):
            walk.run(1, phase=first)
            walk.run(1, phase=second)


def _wrap_phase(phase):
    return (phase + SETPOINT) % (1 << 24) - SETPOINT


def _error_limits(walk):
    """Each error at both of its limits, each code at its range, +-1 LSB."""
    p = walk.p.lock
    for table in (p.limit_in, p.limit_out):
        for offset_lsb, sign in itertools.product((-1, 0, 1), (1, -1)):
            walk.run(1, phase=sign * (table[1] + offset_lsb))
            walk.run(1, sense_sin=sign * (table[2] + offset_lsb))
            walk.run(1, sense_cos=sign * (table[3] + offset_lsb))
            walk.run(1, magnitude=SETPOINT - sign * ((SETPOINT * table[0] >> 16) + offset_lsb))
            walk.run(3)
        # a setpoint whose product with the limit has all ones in the bits that are cut
        walk.run(1, setpoint=(1 << 20) | (-pow(table[0], -1, 1 << 16) % (1 << 16)))
    for offset_lsb, sign in itertools.product((-1, 0, 1), (1, -1)):
        for name in CHANNELS:
            walk.run(1, **{name: sign * (fault_monitor.RANGE_LIMIT + offset_lsb)})


def _bits_of_limits(walk):
    """Each bit of each error beside its limit, alone: not locked, where one good frame counts, then locked."""
    p = walk.p.lock
    unlocked_sense_inputs = {"sense_sin": 1 << 22, "sense_cos": 1 << 22}
    slow = {"magnitude": SETPOINT >> 1, "phase": 1 << 22}
    names = {"phase": 1, "sense_sin": 2, "sense_cos": 3}
    for name, k in names.items():
        blocking_inputs = slow if name == "phase" else unlocked_sense_inputs
        unlocked = sequencer.ACQUIRE if name == "phase" else sequencer.BALANCE
        cases = ((unlocked, blocking_inputs, p.limit_in[k]), (sequencer.LOCKED, {}, p.limit_out[k]))
        for state, between, limit in cases:
            if not walk.again(state, **between):
                continue
            for n, error in enumerate([*around(limit, signed_bits(24)), -SETPOINT]):
                walk.run(1, **{**between, name: error if n % 2 or error == -SETPOINT else -error})
                walk.run(1, **between)


def _amplitudes(walk):
    """The amplitude error at its limit and one beyond, at set-points whose product with the limit has every bit.

    Not locked it is in SETTLE, which the phase keeps from ending and a timeout ends.
    """
    lock, random = walk.p.lock, walk.w.random
    if walk.p.timeout < 3:
        return  # no frame of SETTLE is left to judge
    for state, table, count, between in (
        (sequencer.SETTLE, lock.limit_in, 16, {"phase": 1 << 22, "magnitude": 0}),
        (sequencer.LOCKED, lock.limit_out, 32, {}),
    ):
        arrive = {**between, "magnitude": SETPOINT}
        for setpoint in [(1 << 20) + random.draw_integer(3 << 20) for _ in range(count)]:
            limit = setpoint * table[0] >> lock_monitor.FRACTION
            for error in (limit, limit + 1, -limit, -limit - 1):
                if walk.state.state == state or walk.again(state, **arrive):
                    walk.run(1, **{**between, "setpoint": setpoint, "magnitude": setpoint - error})
                    walk.run(1, **between)


def _covering_keys(kinds_by_key):
    """Keys, largest first, whose sets together hold all that the sets of {key: set} hold."""
    while kinds_by_key:
        key = max(kinds_by_key, key=lambda k: (len(kinds_by_key[k]), k))
        yield key
        covered_kinds = kinds_by_key[key]
        kinds_by_key = {k: kinds - covered_kinds for k, kinds in kinds_by_key.items() if kinds - covered_kinds}


def _magnitudes(walk):
    """Magnitudes for which one bit, of them or of the limit, decides whether a search finds."""
    p, fmt, kinds_by_magnitude = walk.p, sequencer.PARAMS_FMT.min_magnitude, {}
    limit = p.min_magnitude
    for size in {limit, *around(limit, fmt), *((limit - (1 << k)) % (1 << fmt.width) for k in range(fmt.width))}:
        for bit in (1 << k for k in range(fmt.width)):
            for what, is_accepted in (("size", size ^ bit >= limit), ("limit", size >= limit ^ bit)):
                if is_accepted != (size >= limit):
                    kinds_by_magnitude.setdefault(size, set()).add((what, bit, size & bit > 0))
    for size in _covering_keys(kinds_by_magnitude):
        if walk.again(sequencer.SEARCH):
            walk.run(p.search, magnitude=size)


def _setpoint_products(walk):
    """Set-points of which every bit of `reached` times them decides, and the magnitudes at both sides of the product.

    Of the bits below the magnitude's last one each alone is what keeps ACQUIRE from ending, or none is left.
    """
    p, size = walk.p, 1 << 16
    low = [1 << k for k in range(16)] if p.reached % 2 else []
    inverse = pow(p.reached, -1, size) if low else 0
    points = [(walk.w.random.draw_integer(255) + 1) * size + low_bits * inverse % size for low_bits in (0, *low)]
    points += [(1 << 20) + walk.w.random.draw_integer(15 << 20) for _ in range(12)]
    small = {"magnitude": SETPOINT >> 1}
    for setpoint in points:
        quotient, remainder = divmod(setpoint * p.reached, size)
        for magnitude in (quotient - (remainder == 0), quotient + (remainder > 0)):
            if walk.state.state == sequencer.ACQUIRE or walk.again(sequencer.ACQUIRE, **small):
                walk.run(1, setpoint=setpoint, magnitude=magnitude)


def _accepts_correction(p, correction, flipped=0, limit=0):
    """Whether a search finds, with bits of the correction and of the limit flipped."""
    return abs(correction ^ flipped) <= p.search_limit ^ limit


def _searches(walk):
    """Rotations for which one bit of the correction, of its size or of the limit decides whether a search finds."""
    p, kinds_by_rotation = walk.p, {}
    if p.search < 3:
        return  # three steps of a phase get as far as the limit
    edge = (p.search_limit << CUT) // p.gain
    rotations = {edge + k for k in range(-64, 65)} | {edge + sign * (1 << k) for k in range(6, 26) for sign in (1, -1)}
    for total in sorted(rotations | {-k for k in rotations}):
        correction = (total * p.gain + (1 << (CUT - 1))) >> CUT
        sound = _accepts_correction(p, correction)
        for k in range(p.search_limit.bit_length() + 1):
            bit, size = 1 << k, abs(correction)
            value = correction & bit > 0
            if _accepts_correction(p, correction, flipped=bit) != sound:
                kinds_by_rotation.setdefault(total, set()).add(("correction", total < 0, k, value))
            if _accepts_correction(p, size, flipped=bit) != sound:
                kinds_by_rotation.setdefault(total, set()).add(("size", k, size & bit > 0))
            if _accepts_correction(p, correction, limit=bit) != sound:
                kinds_by_rotation.setdefault(total, set()).add(("limit", k))
    for total in _covering_keys(kinds_by_rotation):
        if walk.until(sequencer.SEARCH) or walk.again(sequencer.SEARCH):
            for k in range(1, p.search + 1):
                walk.run(1, phase=_wrap_phase(total * k // p.search))


def _long(walk):
    """Frames without a drive, all good, then all bad: the carries of the counters of 16 bits below LONG_ROWS.

    Rows without `en` where the count is all ones: every bit of it is held.
    """
    walk.run(1, control=0, stale=1)
    for stale in (0, 1):
        walk.run(fault_monitor.QUICK_TOP, control=0, stale=stale)
        walk.w.append_row({"i_stale": 1 - stale}, times=2)
        walk.run(LONG_ROWS - fault_monitor.QUICK_TOP, control=0, stale=stale)
    walk.run(3, control=0)


def _disturb_each_state(walk):
    """Lost lock, unusable frames, saturations and the user's bits in ACQUIRE, SETTLE, BALANCE and LOCKED."""
    unlocked_sense_inputs = {"sense_sin": 1 << 22, "sense_cos": 1 << 22}  # keeps the sense loops from locking
    small = {"magnitude": SETPOINT >> 1}  # keeps ACQUIRE from ending
    states = {
        sequencer.ACQUIRE: small,
        sequencer.SETTLE: unlocked_sense_inputs,
        sequencer.BALANCE: unlocked_sense_inputs,
        sequencer.LOCKED: {},
    }
    for state, blocking_inputs in states.items():
        for more in (
            {"stale": 1},
            {"adc_ok": 0},
            {"drive_saturated": 1},
            {"qsc_rail": 1},
            {"qsc_rail": 1, "control": sequencer.RUN | sequencer.FIX_QSC},
            {"control": sequencer.RUN | ALL_HOLD_BITS},
            {"control": sequencer.RUN | ALL_HOLD_BITS & ~sequencer.HOLD_FTR},
            {"rate_saturated": 1},
        ):
            if walk.again(state, **blocking_inputs):
                walk.run(2, **{**blocking_inputs, **more})
        if walk.again(state, **blocking_inputs):
            walk.run(8, phase=1 << 22)


def _lock_exclusion_bits(walk):
    """Each bit that takes a loop out of judgement, alone, while the counts of all four loops would move."""
    if walk.p.timeout < 3:
        return  # no frame of SETTLE is left to judge: nothing locks
    unlocked_sense_inputs = {name: LOST[name] for name in ("sense_sin", "sense_cos")}
    for state, blocking_inputs, moves in ((sequencer.BALANCE, unlocked_sense_inputs, {}), (sequencer.LOCKED, {}, LOST)):
        for bit in EXCLUSION_BITS:
            if walk.state.state == state or walk.again(state, **blocking_inputs):
                walk.run(1, control=sequencer.RUN | bit, **moves)
                walk.run(1, **blocking_inputs)


def _resets(walk):
    """A reset in every state."""
    for state in range(sequencer.POWER_UP, sequencer.LOCKED + 1):
        opened = {"control": sequencer.RUN | sequencer.OPEN_DRIVE} if state == sequencer.OPEN else {}
        stopped = {"control": 0} if state <= sequencer.IDLE else {}
        if walk.until(state, **opened, **stopped):
            walk.reset()


def _resets_of_counts(walk):
    """A reset while all symptoms and errors are counted, and one in a search after a lost lock and a failed attempt."""
    if walk.p.timeout < 3:
        return  # no frame of SETTLE is left to judge: nothing locks
    symptoms = {"drive_saturated": 1, "rate_saturated": 1, "drive_cos": fault_monitor.CODE.hi}
    for en in (1, 0):  # a rail ends the count of its loop
        walk.until(sequencer.LOCKED)
        walk.run(2, rests=("drive_sin",), **LOST, **symptoms, qsc_rail=en)
        walk.reset(en)
        walk.until(sequencer.LOCKED)
        walk.until(sequencer.ACQUIRE, **LOST)
        walk.until(sequencer.KICK, magnitude=SETPOINT >> 1)
        walk.until(sequencer.SEARCH)
        for k in range(1, 4):
            walk.run(1, phase=k << 18)
        walk.reset(en)


def _start_up(walk):
    """Once through all states, with times that let no more than that into a bundle."""
    for _ in range(MOST_FRAMES):
        if walk.state.state == sequencer.LOCKED:
            break
        walk.run()
    walk.run(20, sense_sin=1 << 22)


def script_sequencer(w):
    walk = Walk(w)
    if walk.p.power_up > PATIENCE:
        _start_up(walk)
        return
    before = (
        _walks,
        _attempts,
        _magnitude_thresholds,
        _rotations,
        _error_limits,
        _bits_of_limits,
        _amplitudes,
        _searches,
        _magnitudes,
        _setpoint_products,
    )
    for part in (*before, _long, _disturb_each_state, _lock_exclusion_bits, _resets, _resets_of_counts):
        part(walk)
