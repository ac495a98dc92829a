"""Faults of the 8 kHz frames: one counter each, live flags, and a sticky latch.

    count_k' = min(count_k + 1, frames_k) while the symptom of fault k lasts, 0 otherwise
    flag_k'  = 1 when count_k' has reached frames_k (never when frames_k = 0)
    latch'   = (latch and not clear) or flags'

    symptom_k --[count_k]--(= frames_k)--[flags]--(or)--[latch]-->     [..] register

    bit, flag            symptom                                debounce          what it does
    0 OVER_RANGE         a code at or beyond +-0x7FFF00         1 ms, 8 frames    the loops go on: the sign is right
    1 LOST_LOCK          amplitude or phase lost                of lock_monitor   starts again at KICK, FTR and QSC off
    2 STALE              no valid frame, or watchdog            none              loops hold; 100 ms: STANDBY
    3 STUCK              a code is that of the last frame       4 ms, 32 frames   as STALE
    4 DRIVE_SATURATED    amplitude at its ceiling, from SETTLE  1 ms, 8 frames    flag only
    5 RATE_SATURATED     force word at a limit                  1 ms, 8 frames    flag only
    6 QSC_RAIL           u at 0 or at the rail, loop closed     10 ms, 80 frames  flag only; lock is kept
    7 SEARCH_FAILED      nothing found, or too slow             none              starts again at KICK

    bad   = STALE or STUCK;   bad_frames, good_frames count the frames in a row, up to `top`

Formats   codes [1,23,0]   counts [0,12,0]   bad_frames, good_frames [0,16,0]   flags, latch, clear [0,8,0]
Latency   1 clock from en to flags; frames_k frames from the symptom
Rounding  none
Overflow  the counts saturate
Cost      204 register bits, comparators only
Source    docs/decisions/0016-frozen-channels.md

LOST_LOCK and SEARCH_FAILED are live until the drive is locked. A live fault cannot be cleared.

STUCK has one count for all four codes: a frozen one repeats in every frame. Noise repeats some code in 0.30 of the
frames: 32 in a row have probability 2e-17. With less noise codes may rest: `stuck_s` = 0 switches STUCK off, as on the
board `digital_sid`. It is watched from SEARCH on, and in STANDBY until the codes move. A code at its limit is clipped
and may rest: it counts for OVER_RANGE alone.

Without `armed` (POWER_UP, INIT) everything stays at its reset value, but the codes. A frame that is not valid tells
nothing about its codes: OVER_RANGE and STUCK start again.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, clamp, formats, quantize, signed_bits
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ

CODE = signed_bits(24)
COUNT = bits(12)
LONG = bits(16)
RANGE_LIMIT = 0x7FFF00
LATENCY = 1
NAMES = (
    "OVER_RANGE",
    "LOST_LOCK",
    "STALE",
    "STUCK",
    "DRIVE_SATURATED",
    "RATE_SATURATED",
    "QSC_RAIL",
    "SEARCH_FAILED",
)
OVER_RANGE, LOST_LOCK, STALE, STUCK, DRIVE_SATURATED, RATE_SATURATED, QSC_RAIL, SEARCH_FAILED = (
    1 << k for k in range(len(NAMES))
)
BAD = STALE | STUCK
FLAGS = bits(len(NAMES))
ALL = FLAGS.hi


class Params(NamedTuple):
    """Debounce in frames, 0 switches a fault off; `top` of bad_frames and good_frames. Build with `design`."""

    over_range: COUNT
    stuck: COUNT
    drive: COUNT
    rate: COUNT
    rail: COUNT
    top: LONG


class State(NamedTuple):
    """The registers."""

    codes: [CODE] * 4 = (0, 0, 0, 0)
    over_range: COUNT = 0
    stuck: COUNT = 0
    drive: COUNT = 0
    rate: COUNT = 0
    rail: COUNT = 0
    bad_frames: LONG = 0
    good_frames: LONG = 0
    flags: FLAGS = 0
    latch: FLAGS = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(over_range_s=0.001, stuck_s=0.004, drive_s=0.001, rate_s=0.001, rail_s=0.01, top=LONG.hi, frame_hz=FRAME_HZ):
    """Debounce times (s); 0 switches a fault off (STUCK where the codes have too little noise, and may really rest).

    top       of the counts of good and bad frames (frames)
    frame_hz  rate of the frames (Hz)
    """
    times = zip(Params._fields, (over_range_s, stuck_s, drive_s, rate_s, rail_s), strict=False)
    counts = (quantize(v * frame_hz, COUNT, f"{k}_s (frames)") for k, v in times)
    return Params(*counts, quantize(top, LONG, "top (frames)"))


@inlined
def _count(count, symptom, limit):
    return clamp(count + 1, 0, limit) if symptom else 0


@inlined
def _flag(count, limit, flag):
    return flag if limit > 0 and count == limit else 0


@inlined
def _exceeds_range(code):
    return 1 if code >= RANGE_LIMIT or code <= -RANGE_LIMIT else 0


@inlined
def _rests(code, before, extreme):
    return 1 if code == before and not extreme else 0


@inlined
def step(p, s, en, armed, fresh, codes, drive, rate, rail, watch_stuck, levels, clear):
    """One clock edge; `levels` is LOST_LOCK and SEARCH_FAILED."""
    if not en:
        return s
    if not armed:
        return State(codes, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    e = _exceeds_range(codes[0]), _exceeds_range(codes[1]), _exceeds_range(codes[2]), _exceeds_range(codes[3])
    first = _rests(codes[0], s.codes[0], e[0]) | _rests(codes[1], s.codes[1], e[1])
    any_still = first | _rests(codes[2], s.codes[2], e[2]) | _rests(codes[3], s.codes[3], e[3])
    overrange_count = _count(s.over_range, fresh and (e[0] | e[1] | e[2] | e[3]), p.over_range)
    stuck = _count(s.stuck, fresh and watch_stuck and any_still, p.stuck)
    drive_count = _count(s.drive, drive, p.drive)
    rate_count = _count(s.rate, rate, p.rate)
    rail_count = _count(s.rail, rail, p.rail)
    flags = (
        _flag(overrange_count, p.over_range, OVER_RANGE)
        | _flag(stuck, p.stuck, STUCK)
        | _flag(drive_count, p.drive, DRIVE_SATURATED)
        | _flag(rate_count, p.rate, RATE_SATURATED)
        | _flag(rail_count, p.rail, QSC_RAIL)
        | (0 if fresh else STALE)
        | levels
    )
    bad = flags & BAD
    return State(
        codes=codes if fresh else s.codes,
        over_range=overrange_count,
        stuck=stuck,
        drive=drive_count,
        rate=rate_count,
        rail=rail_count,
        bad_frames=clamp(s.bad_frames + 1, 0, p.top) if bad else 0,
        good_frames=0 if bad else clamp(s.good_frames + 1, 0, p.top),
        flags=flags,
        latch=(s.latch & ~clear) | flags,
    )


QUICK_TOP = 1023  # of the counters of frames in the quick case: every bit below it decides
QUICK = Params(over_range=2, stuck=4, drive=3, rate=3, rail=5, top=QUICK_TOP)

BLOCK = Block(
    place=170,
    inputs={
        "en": BIT,
        "armed": BIT,
        "fresh": BIT,
        "codes": [CODE] * 4,
        **dict.fromkeys(("drive", "rate", "rail", "watch_stuck"), BIT),
        "levels": FLAGS,
        "clear": FLAGS,
    },
    latency={"flags": LATENCY, "latch": LATENCY},
    cases={
        "default": design(),
        "quick": QUICK,
        "longest": Params(*[COUNT.hi] * 5, top=LONG.hi),
        "off": Params(over_range=1, stuck=0, drive=0, rate=1, rail=0, top=1),
    },
    rules=dict.fromkeys(
        ("over_range", "stuck", "drive", "rate", "rail", "bad_frames", "good_frames"), (None, "saturate")
    ),
    strobes=("en", "armed"),
)
