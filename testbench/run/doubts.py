"""What a run shows of faults that the firmware has no flag for: warnings of its summary.

    repeated   a code of the ADC repeats for more frames than its noise explains with probability REPEATED in the run
    not null   the mean of a code that a loop brings to zero is not zero in the last quarter of the run
    drift      a word of a loop moves from the first to the last quarter of the run by more than its part of LIMITS,
               and by more than SIGMAS of what its blocks scatter

The last two need a constant rate and temperature: changes of these explain them.
Rows in LOCKED count, without those of the first SETTLE_FRAMES, or more where loops are slower. Sums are kept by
blocks of frames, whose length doubles when there are BLOCKS of them: their number does not grow with the run.
Source  docs/faults.md
"""

import math

import numpy as np

from fpga_model import sequencer
from testbench.run import resting
from testbench.run.simulation import FRAME

CODES = ("adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos")
NULLED = {"adc_drive_sin": "phase", "adc_sense_sin": "rate", "adc_sense_cos": "quadrature"}
LIMITS = {"frequency_word": 2e-6, "amplitude_word": 5e-3, "quadrature_code": 5e-3}  # parts of the word
SUMMED = tuple(dict.fromkeys((*NULLED, *LIMITS)))
NULL_CODES = 2000.0  # a mean beyond it is no null: 2 deg/s, 0.02 deg
BLOCKS, BLOCK_FRAMES = 64, 400
SETTLE_FRAMES = 4000
REPEATED = 1e-6
SIGMAS = 8.0
QUARTER = 4


class Doubts:
    """A sink of rows: longest runs of equal codes, and sums of blocks.

    pace  how many times longer than the default's loops these take to settle
    """

    def __init__(self, pace=1.0):
        self.settle = round(SETTLE_FRAMES * pace)
        self.active = False
        self.locked = 0  # frames in a row
        self.frames = 0  # that count
        self.last = np.zeros(len(CODES), np.int64)
        self.runs = np.zeros(len(CODES), np.int64)
        self.longest = np.zeros(len(CODES), np.int64)
        self.length = BLOCK_FRAMES
        self.count = 0  # frames of the block that is not yet full
        self.sums = np.zeros(len(SUMMED), np.int64)
        self.means = np.zeros((0, len(SUMMED)))

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if not self.active or not len(frames):
            return
        locked = frames[:, FRAME["state"]] == sequencer.LOCKED
        self._rest(frames[:, [FRAME[name] for name in CODES]], locked)
        after = _in_a_row(locked, self.locked)
        self.locked = int(after[-1])
        counted = frames[after > self.settle][:, [FRAME[name] for name in SUMMED]]
        self.frames += len(counted)
        while len(counted):
            piece = counted[: self.length - self.count]
            self.sums += piece.sum(axis=0)
            self.count += len(piece)
            counted = counted[len(piece) :]
            if self.count == self.length:
                self._block()

    def _rest(self, codes, locked):
        """Longest runs of frames that repeat a code while locked."""
        same = np.diff(np.concatenate([self.last[None], codes]), axis=0) == 0
        for k in range(len(CODES)):
            runs = _in_a_row(same[:, k] & locked, int(self.runs[k]))
            self.longest[k] = max(self.longest[k], runs.max())
            self.runs[k] = runs[-1]
        self.last = codes[-1].copy()

    def _block(self):
        self.means = np.concatenate([self.means, self.sums[None] / self.count])
        self.sums, self.count = np.zeros(len(SUMMED), np.int64), 0
        if len(self.means) == BLOCKS:
            self.means, self.length = self.means.reshape(BLOCKS // 2, 2, -1).mean(axis=1), 2 * self.length

    def dump(self):
        """What a checkpoint keeps."""
        return {name: value for name, value in vars(self).items() if name not in ("active", "settle")}

    def restore(self, values):
        """Continue where `dump` was."""
        vars(self).update(values)

    def warnings(self, config):
        """Sentences, one for each doubt."""
        wanted = config.scenario
        profiles = any(isinstance(v, (list, tuple)) for v in (wanted.rate_dps, wanted.temperature_degc))
        steady = () if profiles or config.plant.self_heating_k else (*self._not_null(), *self._drifted())
        return (*self._repeated(config), *steady)

    def _repeated(self, config):
        if config.firmware.board != "analog_sid" or not self.frames:
            return
        frame_ms = 1e3 / config.design_record().frame_hz
        for name, p, longest in zip(CODES, resting.adc_repeats(config), self.longest.tolist()):
            if p**longest * self.frames < REPEATED:
                yield f"{name} repeated one code for {longest + 1} frames ({longest * frame_ms:.3g} ms): frozen?"

    def _not_null(self):
        for name, what in NULLED.items():
            means = self.means[-(len(self.means) // QUARTER) :, SUMMED.index(name)]
            mean = np.median(means) if len(self.means) >= QUARTER else 0.0
            if abs(mean) > NULL_CODES:
                yield f"{name} has a mean of {mean:.0f} codes at the end: the {what} loop does not null it"

    def _drifted(self):
        quarter = len(self.means) // QUARTER
        if quarter < 2:
            return
        for name, limit in LIMITS.items():
            means = self.means[:, SUMMED.index(name)]
            before, after = np.median(means[:quarter]), np.median(means[-quarter:])
            steps = np.diff(means)
            scatter = np.median(np.abs(steps - np.median(steps))) / math.sqrt(quarter)
            change = (after - before) / before if before else 0.0
            if abs(change) > limit and abs(after - before) > SIGMAS * scatter:
                percent = f"{100 * change:+.3g} %"
                yield f"{name} drifted by {percent} at constant rate and temperature: a channel, a DAC or the gyroscope"


def _in_a_row(flags, before):
    """Number of True up to each place, in a row, continuing `before` of them."""
    places = np.arange(1, len(flags) + 1)
    last_false = np.maximum.accumulate(np.where(flags, 0, places))
    return np.where(last_false == 0, places + before, places - last_false)
