"""Frequency plan: where the drive frequency, its harmonics, carrier and converters meet, before anything runs.

    ticks     f_tick / 2f = p / q: re-timed edges repeat q places of the tick. Near it their mean lateness is a sawtooth
              of 1/q tick with the beat |q f_tick - 2 p f|. A step of the frequency word moves the beat by 2 p steps,
              and the loop takes both words next to f. The loop answers the sawtooth by the word, which pulls the beat:
              edges dwell late below the ratio and early above it
    frames    the SID's ripple at h f, h = 1 and 2, is seen at its distance to a multiple of f_frame, weakened by three
              poles of the SID and by the converter's sinc3
    carrier   the DAC's image k f_tick +- f reaches the drive frequency by the carrier, off by |f_carrier - k f_tick|
    DDS       half a step of the word turns the drive by atan((step / 2) / (f / 2Q)) until the loop takes the next word
    memory    the frequency loop remembers the edges of 1/w_c, n = 2f/w_c, at the places frac(k f_tick / 2f) of a tick.
              Theta may move by the largest gap between two of the places before an edge moves. The mean of the word
              over T with Hann's weights, whose variation is 4/T, is known to 2/T times that gap in turns

Mean of a sawtooth of 1 peak to peak and beat b over T: within min(1/2, 1/(8 b T)). Answered by the loop, with d = f/2Q:

    s = j 2 pi n B,   L = `drive_loops.turns_per_turn` at n B,   G_n = L / (1 - L 2 pi d/(s + 2 pi d))
    m = |sum of Im G_n / (pi n)|, n = 1, 2, ..        B = b - 2 pi d m
    within min(1/2, m + (1/8 + sum of |G_n|/(pi n)^2) / (B T)),   1/2 where there is no B: edges lock on the grid

Between two of its falls the loop is linear, so m is exact while the wave falls once a beat. A slower one falls to and
fro at its end: there the bound is compared with a loop that is computed edge by edge.
Source    docs/design_of_loops.md
"""

import math
from typing import NamedTuple

import numpy as np

from analog_frontend.parts import sid
from fpga_model.design_record import DEFAULT
from testbench.design import drive_loops

MOST_EDGE_PHASES = 24  # of a tick: at 11 kHz what is finer wanders by less than a sixth of a degree
HARMONICS = (1, 2)
LINES = np.arange(1, 65)  # of the beat: the SID leaves nothing of higher ones where the bound is below 1/2
ROUNDS = 20  # from the slowest beat that the loop can make, each nearer to its own
MEAN_S = 1.0  # of which the plan states the frequency's mean
EXAMPLE_OFF_HZ = 3.7  # of a measured frequency from a nominal one, in a remedy
LEAST_STEPS = 4  # of the DDS within the half bandwidth f / 2Q
LEAST_ALIAS_DB = -100.0  # of the sense signal: a weaker alias is below a millionth of it


class Meeting(NamedTuple):
    """One line of the plan: what meets, the distance that it has and should have (Hz), what it does, what to do."""

    what: str
    distance_hz: float
    least_hz: float
    effect: str
    remedy: str = ""

    @property
    def is_satisfied(self):
        return self.distance_hz >= self.least_hz


class Slide(NamedTuple):
    """A ratio of ticks to half turns: places of the tick, its exact frequency, beat, wander (deg peak to peak)."""

    phase_count: int
    exact_hz: float
    beat_hz: float
    wander_deg: float


def slides(f_hz, design=DEFAULT):
    """[Slide, ...] of all ratios up to MOST_EDGE_PHASES near a drive frequency, the slowest beat first."""
    ratio_slides, step_hz = [], design.master_hz / 2**design.dds_bits
    for q in range(1, MOST_EDGE_PHASES + 1):
        p = round(q * design.tick_hz / (2 * f_hz))
        if p and math.gcd(p, q) == 1:
            beat = max(abs(q * design.tick_hz - 2 * p * f_hz) - 2 * p * step_hz, 0.0)
            ratio_slides.append(Slide(q, q * design.tick_hz / (2 * p), beat, 360 * f_hz / design.tick_hz / q))
    return sorted(ratio_slides, key=lambda s: s.beat_hz)


def dwell(beat_hz, seconds, loop=None):
    """Largest distance from 0 of the mean over `seconds` of a sawtooth of 1 peak to peak, which a `DriveLoop` answers.

    Without a loop the frequency word stands still, and the sawtooth is even.
    """
    if loop is None:
        return min(0.5, 1 / (8 * beat_hz * seconds)) if beat_hz else 0.5
    mean, decay = 0.5, 2 * math.pi * loop.half_width_hz
    for _ in range(ROUNDS):
        pulled_hz = beat_hz - decay * mean
        if pulled_hz <= 0:
            return 0.5
        gain, s = drive_loops.turns_per_turn(pulled_hz * LINES, loop), 2j * math.pi * pulled_hz * LINES
        gain = gain / (1 - gain * decay / (s + decay))
        mean = min(0.5, float(abs(np.sum(gain.imag / (math.pi * LINES)))))
    swing = 1 / 8 + float(np.sum(np.abs(gain) / (math.pi * LINES) ** 2))
    return min(0.5, mean + swing / (pulled_hz * seconds))


def slide_deg(f_hz, seconds, design=DEFAULT, loop=None):
    """Largest error (deg) that re-timed edges leave of a phase's mean over `seconds`; `loop` as in `dwell`."""
    return max(s.wander_deg * dwell(s.beat_hz, seconds, loop) for s in slides(f_hz, design))


def gap_turns(f_hz, loop, design=DEFAULT):
    """Turns (peak to peak) of theta that move no edge: the largest gap between places of those in the loop's memory."""
    edges = np.arange(int(f_hz / (math.pi * loop.crossover_hz)))
    edge_phases = np.sort(edges * (design.tick_hz / (2 * f_hz)) % 1.0)
    return float(np.diff(edge_phases, append=edge_phases[0] + 1.0).max()) * f_hz / design.tick_hz


def word_hz(f_hz, seconds, loop, design=DEFAULT):
    """Largest error (Hz) that this wander leaves of the word's Hann-weighted mean over `seconds`."""
    return 2 * gap_turns(f_hz, loop, design) / seconds


def alias_hz(f_hz, rate_hz):
    """Where a tone is seen after sampling (Hz, 0 .. half the rate)."""
    return abs(f_hz - round(f_hz / rate_hz) * rate_hz)


def ripple_db(f_hz, device):
    """What three poles of the SID and the converter's sinc3 leave of a tone (dB)."""
    n, modulator = device.adc_decimation, device.adc_modulator_hz
    corner = sid.corner_hz(device.sid_r_ohm * device.sid_c_f)
    angle = math.pi * f_hz / modulator
    sinc = abs(math.sin(n * angle) / (n * math.sin(angle))) if math.sin(angle) else 1.0
    return 60 * math.log10(max(sinc, 1e-9)) - 30 * math.log10(1 + (f_hz / corner) ** 2)


def plan(device, bandwidth_hz, f_tolerance=0.0, design=DEFAULT, loop=None):
    """[Meeting, ...] of a board whose rate loop has a bandwidth (Hz); `loop` as in `dwell`."""
    f = device.fx_hz
    slow = slides(f, design)[0]
    ratio = f"beat of edges and ticks, {slow.phase_count} phases, zero at {slow.exact_hz:.1f} Hz"
    off_deg = slow.wander_deg * dwell(slow.beat_hz, math.inf, loop)
    effect = f"references vary by {slow.wander_deg:.3f} deg, and their mean is wrong by up to {off_deg:.3f} deg"
    if loop is not None:
        effect += f"; the mean frequency over {MEAN_S:g} s is known to {1e6 * word_hz(f, MEAN_S, loop, design):.0f} uHz"
    measured = f"if {f:.10g} Hz is only nominal, state the measured frequency, such as {f + EXAMPLE_OFF_HZ:.1f} Hz"
    meetings = [Meeting(ratio, slow.beat_hz, bandwidth_hz, effect, measured)]
    for h in HARMONICS:
        level = ripple_db(h * f, device)
        alias_distance_hz = max(alias_hz(h * f, design.frame_hz) - h * f * f_tolerance, 0.0)
        meetings.append(
            Meeting(
                f"alias of {h} f at the frame rate {design.frame_hz:g} Hz, tolerance included",
                alias_distance_hz,
                bandwidth_hz if level > LEAST_ALIAS_DB else 0.0,
                f"ripple of {level:.0f} dB of the sense signal",
            )
        )
    carrier = device.carrier_hz * (1 + 1e-6 * device.carrier_ppm)
    k = max(round(carrier / design.tick_hz), 1)
    meetings.append(
        Meeting(
            f"carrier from image {k} of the DAC",
            abs(carrier - k * design.tick_hz),
            bandwidth_hz,
            f"image of {20 * math.log10(f / (k * design.tick_hz)):.0f} dB of the force, by stray coupling",
        )
    )
    step = design.master_hz / 2**design.dds_bits
    half_width = f / (2 * device.qx)
    turn = math.degrees(math.atan(step / 2 / half_width))
    meetings.append(
        Meeting(
            f"f/2Q, compared with {LEAST_STEPS} steps of the DDS",
            half_width,
            LEAST_STEPS * step,
            f"half a step of the DDS turns the phase by {turn:.2g} deg",
        )
    )
    return meetings
