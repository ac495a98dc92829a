"""Start-up, lock and faults: a state machine at 8 kHz that gives each loop its mode.

    state         time     AGC/PLL/FTR/QSC     leaves
    0 POWER_UP    300 ms   OFF/OFF/OFF/OFF     ADC reference settles; DACs are sent 0
    1 INIT        2 ms     OFF/OFF/OFF/OFF     DACs are sent control words
    2 IDLE        -        OFF/OFF/OFF/OFF     when RUN = 1
    3 STANDBY     -        OFF/OFF/OFF/OFF     after 10 ms of good frames
    4 OPEN        -        OFF/OFF/OFF/OFF     when OPEN_DRIVE = 0; the presets are the fixed words
    5 KICK        6 ms     KICK/OFF/OFF/OFF    full force at FREQUENCY_FIXED
    6 DECAY       35 ms    OFF/OFF/OFF/OFF     the demodulator forgets the kick
    7 SEARCH      60 ms    OFF/OFF/OFF/OFF     free ring-down
    8 RETUNE      30 ms    OFF/OFF/OFF/OFF     word corrected; the demodulator settles
    9 ACQUIRE     -        P_ONLY/RUN/OFF/OFF  at 95 % of the setpoint; after 2 s: KICK
    10 SETTLE     -        RUN/RUN/OFF/OFF     AGC and PLL locked; after 2 s: KICK
    11 BALANCE    -        RUN/RUN/RUN/RUN     FTR and QSC locked
    12 LOCKED     -        RUN/RUN/RUN/RUN     FTR or QSC lost: BALANCE; AGC or PLL lost: KICK

    after INIT  RUN = 0 -> IDLE     OPEN_DRIVE -> OPEN     100 ms of bad frames -> STANDBY
    search      rotation' = rotation + wrap(phase - last_phase);  correction = round(rotation*gain) at its end

    codes, magnitude, phase --> [faults] [lock] --> next state --> [state] [timer] --> outputs     [..] register

Formats   state [0,4,0]   timer [0,16,0] frames   control [0,9,0]   last_phase [1,-1,24] turn   rotation [1,11,24] turn
          correction [1,-1,48]   gain [0,8,16]   attempts [0,8,0]   lost, failed [0,1,0]   magnitude [0,25,0]
Latency   1 clock from en to the outputs; decisions read flags and lock bits of the frame before
Rounding  ties toward +inf in correction; the 95 % product is exact
Overflow  timer and attempts saturate; rotation and correction cannot overflow
Cost      403 register bits with lock_monitor and fault_monitor

`rate_good` is LOCKED without OVER_RANGE, STALE, STUCK and RATE_SATURATED.

In the ring-down the CORDIC phase turns at fx - f; gain is 1/60 ms in word LSB per phase LSB. A search fails beyond
+-80 Hz, or with a magnitude below 0.01 um, and starts again at KICK.

A frame is usable when it is valid and no code is STUCK. An unusable one holds the loops; in ACQUIRE it switches
the drive off, where holding would keep the full force on; in DECAY and SEARCH it starts DECAY again.
"""

from typing import NamedTuple

from fpga_model import agc, cordic, fault_monitor, frequency_tracker, lock_monitor, pi
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, add_fmt, bits, clamp, formats, half_up, mul_fmt, quantize, wrap
from fpga_model.jit import inlined, kernel

STATES = (
    "POWER_UP",
    "INIT",
    "IDLE",
    "STANDBY",
    "OPEN",
    "KICK",
    "DECAY",
    "SEARCH",
    "RETUNE",
    "ACQUIRE",
    "SETTLE",
    "BALANCE",
    "LOCKED",
)
POWER_UP, INIT, IDLE, STANDBY, OPEN, KICK, DECAY, SEARCH, RETUNE, ACQUIRE, SETTLE, BALANCE, LOCKED = range(len(STATES))
CONTROL_BITS = (
    "RUN",
    "HOLD_AGC",
    "HOLD_PLL",
    "HOLD_FTR",
    "HOLD_QSC",
    "FIX_FTR",
    "FIX_QSC",
    "OPEN_DRIVE",
    "CLEAR_FAULTS",
)
RUN, HOLD_AGC, HOLD_PLL, HOLD_FTR, HOLD_QSC, FIX_FTR, FIX_QSC, OPEN_DRIVE, CLEAR_FAULTS = (
    1 << k for k in range(len(CONTROL_BITS))
)
CONTROL = bits(len(CONTROL_BITS))
TIMER = bits(16)
TIMER_TOP = TIMER.hi
ATTEMPTS = bits(8)
ATTEMPTS_TOP = ATTEMPTS.hi
MAX_SEARCH_FRAMES = 4095
PHASE = cordic.PHASE
PHASE_BITS = PHASE.width
ROTATION = Fmt(1, 11, PHASE.f)
GAIN = Fmt(0, 8, 16)
CORRECTION = frequency_tracker.CORRECTION
DOUBTFUL = fault_monitor.OVER_RANGE | fault_monitor.BAD | fault_monitor.RATE_SATURATED  # no rate is good then
FRACTION = bits(17)  # of 2**16: 1.0 itself included
LATENCY = 1
assert MAX_SEARCH_FRAMES * -PHASE.lo <= ROTATION.hi, "the rotation must fit its register"
assert add_fmt(mul_fmt(ROTATION, GAIN), bits(1)).width <= 63, "the product and its rounding must fit int64"
assert (ROTATION.hi * GAIN.hi) >> GAIN.f <= CORRECTION.hi, "the correction must fit its register"


class Params(NamedTuple):
    """Machine units; build with `design`. The times are in frames."""

    power_up: TIMER
    init: TIMER
    kick: TIMER
    decay: TIMER
    search: TIMER
    retune: TIMER
    timeout: TIMER
    offline: TIMER
    recover: TIMER
    reached: FRACTION
    min_magnitude: cordic.MAGNITUDE
    gain: GAIN
    search_limit: CORRECTION
    lock: lock_monitor.Params
    faults: fault_monitor.Params


class State(NamedTuple):
    """The registers."""

    state: bits(4) = POWER_UP
    timer: TIMER = 0
    control: CONTROL = 0
    last_phase: PHASE = 0
    rotation: ROTATION = 0
    correction: CORRECTION = 0
    attempts: ATTEMPTS = 0
    lost: bits(1) = 0
    failed: bits(1) = 0
    lock: lock_monitor.State = lock_monitor.State()
    faults: fault_monitor.State = fault_monitor.State()


class Inputs(NamedTuple):
    """What the sequencer sees in a frame: registers, and this frame's codes with their magnitude and phase."""

    control: CONTROL = 0
    clear: fault_monitor.FLAGS = 0
    adc_ok: BIT = 0
    stale: BIT = 0
    drive_sin: fault_monitor.CODE = 0
    drive_cos: fault_monitor.CODE = 0
    sense_sin: fault_monitor.CODE = 0
    sense_cos: fault_monitor.CODE = 0
    magnitude: cordic.MAGNITUDE = 0
    phase: PHASE = 0
    setpoint: agc.SETPOINT = 0
    drive_saturated: BIT = 0
    rate_saturated: BIT = 0
    qsc_rail: BIT = 0


class Outputs(NamedTuple):
    """Modes of the loops (`agc.KICK` included), and flags; valid from one frame to the next."""

    agc_mode: agc.MODE
    pll_mode: pi.MODE
    ftr_mode: pi.MODE
    qsc_mode: pi.MODE
    fix_drive: BIT
    fix_ftr: BIT
    fix_qsc: BIT
    dac_init: BIT
    load: BIT
    adjust: BIT
    drive_locked: BIT
    locked: BIT
    rate_good: BIT


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


class Design(NamedTuple):
    """Times and limits of the sequence.

    *_s               how long each state lasts (s); timeout_s ends ACQUIRE and SETTLE, offline_s is how long the ADC
                      may be bad before the drive stops, recover_s how long it must be good before the drive starts
    reached           part of the setpoint at which ACQUIRE ends
    search_min_v      a pickoff signal (V at the ADC) below this after the kick counts as nothing found
    adc_full_scale_v  ADC full scale at the PGA gain of the drive channel (V)
    search_limit_hz   largest correction that is believed (Hz)
    record            the design record
    lock, faults      Params of lock_monitor and fault_monitor; their defaults if None
    """

    power_up_s: float = 0.3
    init_s: float = 0.002
    kick_s: float = 0.006
    decay_s: float = 0.035
    search_s: float = 0.060
    retune_s: float = 0.030
    timeout_s: float = 2.0
    offline_s: float = 0.1
    recover_s: float = 0.01
    reached: float = 0.95
    search_min_v: float = 0.00576
    adc_full_scale_v: float = 4.0
    search_limit_hz: float = 80.0
    record: object = DEFAULT
    lock: object = None
    faults: object = None


def design(**values):
    """Params of a `Design`, with the constant that turns the rotation of the search into a frequency word."""
    d = Design(**values)
    faults = fault_monitor.design() if d.faults is None else d.faults
    times_s = [getattr(d, f"{name}_s") for name in Params._fields[:9]]
    state_durations_s = list(zip(Params._fields, times_s, strict=False))
    frames = [quantize(v * d.record.frame_hz, TIMER, f"{k}_s (frames)") for k, v in state_durations_s]
    for (name, time_s), n in zip(state_durations_s, frames):
        if n < 1:
            raise ValueError(f"{name}_s: {time_s} s is shorter than one frame, {1 / d.record.frame_hz} s")
    search = frames[Params._fields.index("search")]
    if search > MAX_SEARCH_FRAMES:
        raise ValueError(f"search_s: {d.search_s} s is longer than {MAX_SEARCH_FRAMES / d.record.frame_hz} s")
    if not 0 < d.reached <= 1:
        raise ValueError(f"reached: {d.reached} is outside 0 .. 1 of the setpoint")
    hz_per_turn = d.record.frame_hz / search
    waits = max(frames[Params._fields.index(name)] for name in ("offline", "recover"))
    if faults.top < waits:
        raise ValueError(f"faults: offline_s and recover_s need {waits} frames; the frame counters end at {faults.top}")
    gain = hz_per_turn * frequency_tracker.word_per_hz(d.record) * 2.0**-PHASE.f
    limit = d.search_limit_hz * frequency_tracker.word_per_hz(d.record) * 2.0 ** -CORRECTION.for_design(d.record).f
    return Params(
        *frames,
        reached=quantize(d.reached * 2**16, FRACTION, "reached"),
        min_magnitude=agc.setpoint(d.search_min_v, 1.0, d.adc_full_scale_v, d.record),
        gain=quantize(gain, GAIN, "gain (word LSB per phase LSB)"),
        search_limit=quantize(limit, CORRECTION.for_design(d.record), "search_limit_hz (turn per clock)"),
        lock=lock_monitor.design() if d.lock is None else d.lock,
        faults=faults,
    )


@inlined
def _lock_mask(control):
    """Loops whose lock counts: those that the user neither holds nor fixes."""
    loop_mask = lock_monitor.ALL
    if control & HOLD_AGC:
        loop_mask &= ~lock_monitor.AGC
    if control & HOLD_PLL:
        loop_mask &= ~lock_monitor.PLL
    if control & (HOLD_FTR | FIX_FTR):
        loop_mask &= ~lock_monitor.FTR
    if control & (HOLD_QSC | FIX_QSC):
        loop_mask &= ~lock_monitor.QSC
    return loop_mask


@inlined
def _following(p, s, i, usable, search_succeeded, locked):
    """The next state; `locked` has the bits of the loops that are locked or not judged."""
    state = s.state
    frames = s.timer + 1
    drive_locked = locked & lock_monitor.DRIVE == lock_monitor.DRIVE
    if state == POWER_UP:
        return INIT if frames >= p.power_up else POWER_UP
    if state == INIT:
        return IDLE if frames >= p.init else INIT
    if not i.control & RUN:
        return IDLE
    if i.control & OPEN_DRIVE:
        return OPEN
    if state == IDLE or state == OPEN:
        return STANDBY
    if state == STANDBY:
        return KICK if s.faults.good_frames >= p.recover else STANDBY
    if s.faults.bad_frames >= p.offline:
        return STANDBY
    if state == KICK:
        return DECAY if frames >= p.kick else KICK
    if state == DECAY:
        return SEARCH if usable and frames >= p.decay else DECAY
    if state == SEARCH:
        if not usable:
            return DECAY
        if frames < p.search:
            return SEARCH
        return RETUNE if search_succeeded else KICK
    if state == RETUNE:
        return ACQUIRE if frames >= p.retune else RETUNE
    if state == ACQUIRE:
        if usable and i.magnitude << 16 >= i.setpoint * p.reached:
            return SETTLE
        return KICK if frames >= p.timeout else ACQUIRE
    if state == SETTLE:
        if drive_locked:
            return BALANCE
        return KICK if frames >= p.timeout else SETTLE
    if not drive_locked:
        return KICK
    return LOCKED if locked & lock_monitor.SENSE == lock_monitor.SENSE else BALANCE


@kernel
def step(p, s, en, i):
    """One clock edge."""
    if not en:
        return s
    state = s.state
    fresh = 1 if i.adc_ok and not i.stale else 0
    usable = 1 if fresh and not s.faults.flags & fault_monitor.STUCK else 0
    lock_mask = _lock_mask(i.control)

    rotation = s.rotation + wrap(i.phase - s.last_phase, PHASE_BITS) if state == SEARCH and usable else 0
    correction = half_up(rotation * p.gain, GAIN.f)
    search_succeeded = 1 if abs(correction) <= p.search_limit and i.magnitude >= p.min_magnitude else 0
    following = _following(p, s, i, usable, search_succeeded, s.lock.locked | (lock_monitor.ALL & ~lock_mask))

    restart = following == KICK and state != KICK and state != STANDBY
    failed = 1 if restart and state < BALANCE else 0
    lost = 1 if restart and state >= BALANCE else 0
    forget = following == IDLE or following >= BALANCE
    timer = clamp(s.timer + 1, 0, TIMER_TOP)
    if following != state or (state == DECAY and not usable):
        timer = 0

    watch_stuck = state >= SEARCH or (state == STANDBY and s.faults.flags & fault_monitor.STUCK)
    levels = (fault_monitor.LOST_LOCK if s.lost else 0) | (fault_monitor.SEARCH_FAILED if s.failed else 0)
    return State(
        state=following,
        timer=timer,
        control=i.control,
        last_phase=i.phase if fresh else s.last_phase,
        rotation=rotation,
        correction=correction if state == SEARCH else s.correction,
        attempts=clamp(s.attempts + failed, 0, ATTEMPTS_TOP),
        lost=0 if forget else (s.lost | lost),
        failed=0 if forget else (s.failed | failed),
        lock=lock_monitor.step(
            p.lock,
            s.lock,
            1 if usable or state < SETTLE else 0,
            (lock_monitor.DRIVE if state >= SETTLE else 0) | (lock_monitor.SENSE if state >= BALANCE else 0),
            lock_mask,
            i.setpoint - i.magnitude,
            i.setpoint,
            i.phase,
            i.sense_sin,
            i.sense_cos,
            i.qsc_rail,
        ),
        faults=fault_monitor.step(
            p.faults,
            s.faults,
            1,
            1 if state > INIT else 0,
            fresh,
            (i.drive_sin, i.drive_cos, i.sense_sin, i.sense_cos),
            1 if i.drive_saturated and state >= SETTLE else 0,
            i.rate_saturated,
            1 if i.qsc_rail and state >= BALANCE and not i.control & FIX_QSC else 0,
            1 if watch_stuck else 0,
            levels,
            fault_monitor.ALL if i.control & CLEAR_FAULTS else i.clear,
        ),
    )


@inlined
def _mode(bad, hold_requested, mode):
    return pi.HOLD if bad or hold_requested else mode


@inlined
def outputs(s):
    """Modes and flags, decoded from the registers alone."""
    state, control = s.state, s.control
    bad = s.faults.flags & fault_monitor.BAD
    agc_mode, pll_mode, ftr_mode, qsc_mode = pi.OFF, pi.OFF, pi.OFF, pi.OFF
    if state == KICK:
        agc_mode = agc.KICK
    elif state == ACQUIRE:
        agc_mode = pi.OFF if bad else _mode(0, control & HOLD_AGC, pi.P_ONLY)
    elif state > ACQUIRE:
        agc_mode = _mode(bad, control & HOLD_AGC, pi.RUN)
    if state >= ACQUIRE:
        pll_mode = _mode(bad, control & HOLD_PLL, pi.RUN)
    if state >= BALANCE:
        ftr_mode = pi.OFF if control & FIX_FTR else _mode(bad, control & HOLD_FTR, pi.RUN)
        qsc_mode = pi.OFF if control & FIX_QSC else _mode(bad, control & HOLD_QSC, pi.RUN)
    fixable = state == OPEN or state >= BALANCE
    return Outputs(
        agc_mode=agc_mode,
        pll_mode=pll_mode,
        ftr_mode=ftr_mode,
        qsc_mode=qsc_mode,
        fix_drive=1 if state == OPEN else 0,
        fix_ftr=1 if fixable and control & FIX_FTR else 0,
        fix_qsc=1 if fixable and control & FIX_QSC else 0,
        dac_init=1 if state == INIT else 0,
        load=1 if state <= KICK else 0,
        adjust=1 if state == RETUNE and s.timer == 0 else 0,
        drive_locked=1 if state >= BALANCE else 0,
        locked=1 if state == LOCKED else 0,
        rate_good=1 if state == LOCKED and not s.faults.flags & DOUBTFUL else 0,
    )


def quick(d):
    """Params of a design whose states last a few frames; the gain is an LSB at least."""
    p = design(
        **{f"{name}_s": 3 / d.frame_hz for name in ("init", "kick", "retune", "recover")},
        **{f"{name}_s": 4 / d.frame_hz for name in ("power_up", "decay")},
        search_s=24 / d.frame_hz,
        timeout_s=12 / d.frame_hz,
        offline_s=6 / d.frame_hz,
        search_limit_hz=800.0,
        record=d,
        lock=lock_monitor.QUICK,
        faults=fault_monitor.QUICK,
    )
    return p._replace(gain=max(p.gain, 1))


BLOCK = Block(
    place=180,
    inputs={"en": BIT, "i": Inputs},
    outputs={"outputs": Outputs},
    latency={"state": LATENCY},
    cases=lambda d: {
        "quick": quick(d),
        # every time one frame: 255 failed attempts in a few hundred rows
        "fastest": quick(d)._replace(**dict.fromkeys(Params._fields[:9], 1)),
    },
    rules={"timer": (None, "saturate"), "attempts": (None, "saturate"), "correction": ("half_up", None)},
    strobes=("en", "i_adc_ok"),
    split=("state",),
    relations=({"rotation": 1, "timer": PHASE.lo}, {"rotation": 1, "timer": -PHASE.lo}),
)
