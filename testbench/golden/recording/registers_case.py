"""The recording `registers`: every bit of every word that the host writes, at both values, where its block shows it.

    start   power-on to BALANCE; a set-point out of reach and a few faults, until every flag is in the latch
    codes   OPEN, all loops fixed. The bits of the map are numbered from 1; in frame k each has bit k of its number, and
            then, in as many frames, the opposite: no two wires of the bank carry the same
    ones    the words that decide what a frame does: 0, then a one at each bit, for two frames each; behind each one of
            fault_clear, in the same frame, the one before it, which takes nothing back

The conversions are those of `story`. Words act in the frame after the one in which they are written.
Source  docs/golden.md (the whole design)
"""

import numpy as np

from fpga_model import registers, sequencer
from fpga_model.block import fill_shape
from fpga_model.fault_monitor import CODE
from testbench.golden.recording import replay_recording
from testbench.golden.recording.recording import Recording

STORY_FROM, CODES_FROM, STEP = 620, 24, 2
# Frames in which a conversion of another frame of the story comes: over range, bad status, two of a frozen channel
FAULTS = {12: 822, 19: 866, 20: 867, 21: 841}
UNREACHED = 13  # the set-point is at its top from here on
OPEN = sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR | sequencer.FIX_QSC
DECIDE = ("control", "fault_clear", "decimation")


def in_single_frames(q):
    """The sequencer with states and debounced locks of one frame."""
    one = dict.fromkeys(("power_up", "init", "kick", "decay", "search", "retune", "recover"), 1)
    lock = {name: tuple(1 for _ in getattr(q.lock, name)) for name in ("frames_in", "frames_out")}
    return q._replace(**one, lock=q.lock._replace(**lock))


def codes():
    """[{register: word}] of the frames of `codes`."""
    non_deciding_registers = [r for r in registers.WRITABLE if r.name not in DECIDE]
    wires = [(r, bit) for r in non_deciding_registers for bit in range(r.fmt.width)]
    frames = []
    for k in range(len(wires).bit_length()):
        words = dict.fromkeys(non_deciding_registers, 0)
        for number, (r, bit) in enumerate(wires, 1):
            words[r] |= (number >> k & 1) << bit
        frames.append(words)
    return [*frames, *({r: ~word for r, word in words.items()} for words in frames)]


def ones():
    """[{register: word}] of the steps of `ones`: a narrow word keeps its last."""
    deciding = [registers.BY_NAME[name] for name in DECIDE]
    steps = range(max(r.fmt.width for r in deciding))
    return [dict.fromkeys(deciding, 0), *({r: 1 << min(k, r.fmt.width - 1) for r in deciding} for k in steps)]


def script():
    """{frame: [(register, word)]} in the order of the writes, and the number of frames."""
    at = registers.BY_NAME
    frames = {UNREACHED: {at["amplitude_setpoint"]: at["amplitude_setpoint"].fmt.hi}}
    frames |= {CODES_FROM + k: words for k, words in enumerate(codes())}
    frames[CODES_FROM] |= {at["control"]: OPEN, at["decimation"]: 0}
    frames, after, clear = {k: list(words.items()) for k, words in frames.items()}, max(frames) + 1, at["fault_clear"]
    for k, words in enumerate(ones()):
        frames[after + STEP * k] = [*words.items(), (clear, words[clear] >> 1)]
    return frames, max(frames) + STEP


def case(story):
    """Recording of the case `registers`, from that of the story."""
    p = story.params
    q = in_single_frames(p.control.sequencer)
    faults = fill_shape(q.faults, lambda _: 1)._replace(top=q.faults.top)
    p = p._replace(control=p.control._replace(sequencer=q._replace(timeout=3, faults=faults)))
    frame_clocks = p.design.frame_clocks
    frames, count = script()
    host = [
        ((frame - 1) * frame_clocks + frame_clocks * (32 + k) // 64, 0, r.address, registers.to_bus(word, r.fmt))
        for frame, words in frames.items()
        for k, (r, word) in enumerate(words)
    ]
    clocks, adc = story.stimulus.adc[:, 0] // frame_clocks, []
    for frame in range(count):
        story_frame = FAULTS.get(frame, STORY_FROM + frame)
        row = story.stimulus.adc[np.flatnonzero(clocks == story_frame)[0]].copy()
        row[0] += (frame - story_frame) * frame_clocks
        row[6] = CODE.hi  # a temperature at which the least bit of each polynomial counts
        adc.append(row)
    stimulus = replay_recording.Stimulus(np.array(adc), np.array(host, np.int64), np.zeros((0, 2), np.int64))
    return Recording("registers", p, count, 1, stimulus, (), "")
