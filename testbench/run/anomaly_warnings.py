"""What a run shows of faults that the firmware has no flag for: warnings of its summary.

    repeated   a code of the ADC repeats for more frames than its noise explains with probability REPEATED in the run
    jumps      a code leaves the line between its neighbours by more than SIGMAS of what it scatters by in the same
               block, in OFTEN blocks or more
    rings      so do both codes of the sense mode over RING_FRAMES, about equally: it swings freely, because a force
               that its loop commands was not there
    not null   the mean of a code that a loop brings to zero is not zero in the last quarter of the run
    drift      a word of a loop moves from the first to the last quarter of the run by more than its part of LIMITS,
               and by more than SIGMAS of what its blocks scatter

The last three need a constant rate and temperature: changes of these explain them. Jumps need none, because the
converter smooths a true rate; a register write, or a change of the rate beyond JUMP_DPS, explains OFTEN of them.
Rows in LOCKED count, without those of the first SETTLE_FRAMES, or more where loops are slower. Sums are kept by
blocks of frames, whose length doubles when there are BLOCKS of them: their number does not grow with the run.
Source  docs/faults.md
"""

import math

import numpy as np

from fpga_model import sequencer
from testbench.run import repeated_code_probability
from testbench.run.simulation import FRAME

CODES = ("adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos")
COLUMNS = [FRAME[name] for name in CODES]
NULLED = {"adc_drive_sin": "phase", "adc_sense_sin": "rate", "adc_sense_cos": "quadrature"}
LIMITS = {"frequency_word": 2e-6, "amplitude_word": 5e-3, "quadrature_code": 5e-3}  # parts of the word
SUMMED = tuple(dict.fromkeys((*NULLED, *LIMITS)))
SUMMED_COLUMNS = [FRAME[name] for name in SUMMED]
NULL_CODES = 2000.0  # a mean beyond it is no null: 2 deg/s, 0.02 deg
BLOCKS, BLOCK_FRAMES = 64, 400
OFTEN = 3  # blocks; noise alone gives as many in an hour with probability below 1e-8
RING_FRAMES = 16
SCATTER_CODES = 60.0  # at least: below it a jump is no error of the rate
ALIKE = 3.0  # times that one code of a mode that swings freely exceeds the other, at most
JUMP_DPS, JUMP_S = 100.0, 1e-3
SETTLE_FRAMES = 4000
REPEATED = 1e-6
SIGMAS = 8.0
MEDIAN_SIGMAS = 0.6745  # median of the size of a Gaussian of sigma 1
SENSE = slice(2, 4)  # of CODES
OF_BLOCKS = f"blocks of {BLOCK_FRAMES} frames"
QUARTER = 4


class AnomalyDetector:
    """A sink of rows: longest runs of equal codes, blocks in which codes jump, and sums of blocks.

    pace  how many times longer than the default's loops these take to settle
    step  of the codes of the ADC
    """

    def __init__(self, pace=1.0, step=10):
        self.settle = round(SETTLE_FRAMES * pace)
        self.least = max(SCATTER_CODES, float(step))
        self.active = False
        self.locked = 0  # frames in a row
        self.frames = 0  # that count
        self.last = np.zeros(len(CODES), np.int64)
        self.runs = np.zeros(len(CODES), np.int64)
        self.longest = np.zeros(len(CODES), np.int64)
        self.recent = np.zeros((len(CODES), 0), np.int32)  # codes of the block that is not yet whole
        self.jumps = np.zeros(len(CODES), np.int64)  # blocks
        self.rings = 0  # blocks
        self.length = BLOCK_FRAMES
        self.count = 0  # frames of the block that is not yet full
        self.sums = np.zeros(len(SUMMED), np.int64)
        self.means = np.zeros((0, len(SUMMED)))

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if not self.active or not len(frames):
            return
        locked = frames[:, FRAME["state"]] == sequencer.LOCKED
        codes = frames[:, COLUMNS].T.astype(np.int32)
        self._count_repeats(codes, locked)
        after = _in_a_row(locked, self.locked)
        self.locked = int(after[-1])
        after = slice(None) if after[0] > self.settle and locked.all() else after > self.settle
        self._swing(codes[:, after])
        counted = frames[:, SUMMED_COLUMNS][after]
        self.frames += len(counted)
        while len(counted):
            piece = counted[: self.length - self.count]
            self.sums += piece.sum(axis=0)
            self.count += len(piece)
            counted = counted[len(piece) :]
            if self.count == self.length:
                self._block()

    def _count_repeats(self, codes, locked):
        """Longest runs of frames that repeat a code while locked."""
        is_repeat = np.diff(codes, axis=1, prepend=self.last[:, None]) == 0
        runs = _in_a_row(is_repeat & locked, self.runs[:, None])
        self.longest = np.maximum(self.longest, runs.max(axis=1))
        self.last, self.runs = codes[:, -1].astype(np.int64), runs[:, -1].copy()

    def _swing(self, codes):
        """Whole blocks in which a code leaves the line between its neighbours; what is left waits for more."""
        codes = np.concatenate([self.recent, codes], axis=1)
        blocks = max(0, codes.shape[1] - 2 * RING_FRAMES) // BLOCK_FRAMES
        self.recent = codes[:, blocks * BLOCK_FRAMES :].copy()
        codes = codes[:, : blocks * BLOCK_FRAMES + 2 * RING_FRAMES]
        neighbour_bends = _bends(codes[:, RING_FRAMES - 1 : codes.shape[1] - RING_FRAMES + 1], 1)
        middle = np.partition(neighbour_bends, BLOCK_FRAMES // 2)[..., BLOCK_FRAMES // 2]
        limits = SIGMAS * np.maximum(middle / MEDIAN_SIGMAS, self.least)
        self.jumps += (neighbour_bends.max(axis=-1) > limits).sum(axis=1)
        ring_bends = _bends(codes[SENSE], RING_FRAMES).max(axis=-1)
        self.rings += int(((ring_bends > limits[SENSE]) & (ALIKE * ring_bends > ring_bends[::-1])).all(axis=0).sum())

    def _block(self):
        self.means = np.concatenate([self.means, self.sums[None] / self.count])
        self.sums, self.count = np.zeros(len(SUMMED), np.int64), 0
        if len(self.means) == BLOCKS:
            self.means, self.length = self.means.reshape(BLOCKS // 2, 2, -1).mean(axis=1), 2 * self.length

    def dump(self):
        """What a checkpoint keeps."""
        return {name: value for name, value in vars(self).items() if name not in ("active", "settle", "least")}

    def restore(self, values):
        """Continue where `dump` was."""
        vars(self).update(values)

    def warnings(self, config):
        """Sentences, one for each doubt."""
        scenario = config.scenario
        profiles = any(isinstance(v, (list, tuple)) for v in (scenario.rate_dps, scenario.temperature_degc))
        steady = (
            ()
            if profiles or config.plant.self_heating_k
            else (*self._warn_ringing(), *self._warn_offsets(), *self._warn_drifts())
        )
        return (*self._warn_repeats(config), *self._warn_jumps(scenario), *steady)

    def _warn_repeats(self, config):
        if config.firmware.board != "analog_sid" or not self.frames:
            return
        frame_ms = 1e3 / config.design_record().frame_hz
        for name, p, longest in zip(CODES, repeated_code_probability.adc_repeats(config), self.longest.tolist()):
            if p**longest * self.frames < REPEATED:
                repeated_ms = longest * frame_ms
                yield f"{name} repeated one code for {longest + 1} frames ({repeated_ms:.3g} ms); it may be frozen"

    def _warn_jumps(self, scenario):
        explained = OFTEN * (len(scenario.register_writes) + _rate_jumps(scenario))
        for name, blocks in zip(CODES, self.jumps.tolist()):
            if blocks >= OFTEN + explained:
                yield f"{name} jumps by more than {SIGMAS:g} times its scatter in {blocks} {OF_BLOCKS}; possible spikes"

    def _warn_ringing(self):
        if self.rings >= OFTEN:
            yield f"the sense mode swings freely in {self.rings} {OF_BLOCKS}; a DAC may have stopped at times"

    def _warn_offsets(self):
        for name, what in NULLED.items():
            means = self.means[-(len(self.means) // QUARTER) :, SUMMED.index(name)]
            mean = np.median(means) if len(self.means) >= QUARTER else 0.0
            if abs(mean) > NULL_CODES:
                yield f"{name} has a mean of {mean:.0f} codes at the end: the {what} loop does not null it"

    def _warn_drifts(self):
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
                yield f"{name} drifted by {percent} at constant rate and temperature; check channel, DAC and gyroscope"


def _bends(codes, lag):
    """Distance of each code from the mean of those `lag` before and behind it, twice, by channel, block and frame."""
    bends = np.abs(codes[:, : -2 * lag] + codes[:, 2 * lag :] - 2 * codes[:, lag:-lag])
    return bends.reshape(len(codes), -1, BLOCK_FRAMES)


def _rate_jumps(scenario):
    """How often the scenario's rate changes by more than JUMP_DPS within JUMP_S."""
    if not isinstance(scenario.rate_dps, (list, tuple)):
        return 0
    times, rates = np.array(scenario.rate_dps, float).T
    part = np.minimum(JUMP_S / np.maximum(np.diff(times), JUMP_S), 1.0) if scenario.rate_shape == "linear" else 1.0
    return int(np.count_nonzero(np.abs(np.diff(rates)) * part > JUMP_DPS))


def _in_a_row(flags, before):
    """Number of True up to each place, in a row, continuing `before` of them; each row for itself."""
    frame_numbers = np.arange(1, flags.shape[-1] + 1)
    last_false = np.maximum.accumulate(np.where(flags, 0, frame_numbers), axis=-1)
    return np.where(last_false == 0, frame_numbers + before, frame_numbers - last_false)
