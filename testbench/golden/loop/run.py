"""A scenario with RTL in place of the firmware, in lockstep with the model: what is the same, or what differs first.

    Loop            a `Simulation` whose firmware is a compiled design, compared at every edge
    PinCaptureLoop  the same, nothing compared: what the pins show is kept for `pin_meter`
    Difference      where the RTL first is not the model: tick, clock, every register or pin that differs, both values
    STORY           power-on, lock, rate steps of +-300 deg/s, a silent ADC: the scenario if no other is given

Source  docs/rtl.md
"""

import tempfile
import time
from typing import NamedTuple

import numpy as np

from fpga_model import fault_monitor, sequencer
from fpga_model import top as fpga
from fpga_model.design_record import DEFAULT
from testbench.config import Config, changed, scenario
from testbench.engines import chips, engine
from testbench.errors import ConfigError
from testbench.flatten import leaves
from testbench.golden.loop import after_divergence, judgement, library, lockstep, pin_meter
from testbench.golden.recording import board_recording, replay_recording
from testbench.run import build, simulate
from testbench.run.simulation import FRAME, Simulation

SECONDS = 3.0
STEP_DPS, STEPS_S, FAULT_S, FAULT_LENGTH_S = 300.0, (1.5, 1.8, 2.1), 2.4, 0.003
STORY_KEYS = ("origin", "seconds", "rate_dps", "rate_shape", "faults")
EDGE_TICKS, EDGES = 8, 64  # a chunk has fewer reference edges than one in so many ticks, and some
MOST_PRINTED = 8  # registers of a difference that a text lists


class Pins(NamedTuple):
    """A design with the pins of the board alone.

    top    its module; of the map if None
    files  list of its files; all of the folder if None
    map    names of its ports (`design_map`); those of `board_recording.ports` if None
    exact  only a design without a difference passes
    """

    top: str | None
    files: object = None
    map: object = None
    exact: bool = False


def story(seconds=SECONDS):
    """Config of the standard scenario, cut to `seconds` from power-on; 0.001 .. 3600 s."""
    begin, turn, end = STEPS_S
    rates = [[0.0, 0.0], [begin, STEP_DPS], [turn, -STEP_DPS], [end, 0.0]]
    faults = [[FAULT_S, "adc_silent", "adc", 0, FAULT_LENGTH_S]] if seconds > FAULT_S else []
    values = ("power_on", seconds, rates, "steps", faults)
    return changed(Config(), {f"scenario.{key}": value for key, value in zip(STORY_KEYS, values, strict=True)})


class Recorded(NamedTuple):
    """What a design was given and has shown.

    params    of the model
    stimulus  `replay_recording.Stimulus`, which goes on behind the difference (`after_divergence.extend_stimulus`)
    continuation  `after_divergence.Continuation`: the rows from the difference on
    observed_indices  of library.NAMES, that the design shows
    """

    params: fpga.Params
    stimulus: replay_recording.Stimulus
    continuation: after_divergence.Continuation
    observed_indices: tuple


class Difference(Exception):
    """The RTL is not the model.

    row       clocks since power-on; the values stand before this edge
    design    record of the design
    recorded  `Recorded`: what led there
    wrong     [(name, expected, got)] of every register and pin that differs there, in the model's order
    before    int64 (rows, values): the model's rows up to this one, the last one last
    """

    def __init__(self, row, wrong, before, design=DEFAULT, recorded=None):
        self.design, self.recorded = design, recorded
        self.row, self.wrong, self.before, self.us = row, wrong, before, row / design.master_hz * 1e6
        self.tick, self.clock = divmod(row, design.tick_clocks)
        super().__init__(self.text())

    def text(self):
        """First line: when and which; then the other registers, and what the first one held before."""
        name, expected, got = self.wrong[0]
        lines = [f"tick {self.tick}, clock {self.clock} ({self.us:.3f} us): {name}: "
                 f"expected {expected}, got {got}"]  # fmt: skip
        lines += [
            f"  also {name}: expected {expected}, got {got}" for name, expected, got in self.wrong[1:MOST_PRINTED]
        ]
        if len(self.wrong) > MOST_PRINTED:
            lines.append(f"  and {len(self.wrong) - MOST_PRINTED} more")
        preceding_model_values = self.before[:, library.NAMES.index(name)].tolist()
        lines.append(
            f"  {name} in the model, clock by clock up to this one: {', '.join(map(str, preceding_model_values))}"
        )
        return "\n".join(lines)

    def to_dict(self):
        wrong = [
            {"pin" if name in library.PINS else "register": name, "expected": expected, "got": got}
            for name, expected, got in self.wrong
        ]
        return {"row": self.row, "tick": self.tick, "clock": self.clock, "differs": wrong}


class StateFlagSink:
    """A sink that keeps what was seen at frame starts: states of the sequencer and fault flags, a bit each."""

    def __init__(self):
        self.states = self.flags = 0

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if len(frames):
            self.states |= int(np.bitwise_or.reduce(1 << frames[:, FRAME["state"]]))
            self.flags |= int(np.bitwise_or.reduce(frames[:, FRAME["flags"]]))


class Loop(Simulation):
    """A simulation from power-on whose pins are those of a `library.Design` with the parameters `firmware`."""

    def __init__(self, config, temp_lo_degc, temp_hi_degc, design, firmware):
        super().__init__(config, temp_lo_degc, temp_hi_degc, engine="clocked")
        self.params = self.params._replace(fpga=firmware)
        self.library = design
        self.rtl = lockstep.connect_rtl(design)
        self._run = self._lockstep
        self.keep_rows = False
        self.seen = StateFlagSink()
        self.sinks.append(self.seen)
        self._adc, self._host, self._sar = [], [], []

    @property
    def compared_row_count(self):
        """Rows that were compared, of `library.Design.signal_indices`."""
        return int(self.rtl.comparison_state[3])

    def _lockstep(self, p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
        edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
        chunk = engine.Chunk(s.tick, rate_rad_s, temp_degc, *host, faults, o, edges)
        end = s.tick + ticks
        rtl = self.rtl._replace(
            conversions=np.zeros((ticks // self.design.frame_ticks + 2, lockstep.CONVERSION), np.int64),
            samples=np.zeros((ticks if self.params.fpga.digital else 0, 2), np.int64),
            count=np.zeros(1, np.int64),
        )
        self._sar.append(rtl.samples)
        if host[0]:
            self._host.append((s.tick * self.design.tick_clocks, 0, *host[1:]))
        f, chips, drdy_cycle = lockstep.ticks(p, s.fpga, s.chips, s.plant, chunk, end, s.drdy_cycle, rtl)
        self._adc.append(rtl.conversions[: int(rtl.count[0])])
        if self.rtl.comparison_state[0] >= 0:
            self._stop(int(self.rtl.comparison_state[0]), chips.adc)
        return engine.State(f, chips, s.plant, end, drdy_cycle)

    def _stop(self, row, converter):
        expected, got = self.rtl.rows[row % lockstep.BUFFER_ROWS], self.library.read()
        differing_indices = self.library.differing_indices(expected, got)
        wrong = [(library.NAMES[k], int(expected[k]), int(got[k])) for k in differing_indices]
        first = max(0, row - lockstep.BUFFER_ROWS + 1)
        before = np.stack([self.rtl.rows[n % lockstep.BUFFER_ROWS] for n in range(first, row + 1)])
        raise Difference(row, wrong, before.copy(), self.design, self._collect_observation(row, converter))

    def _collect_observation(self, row, converter):
        """`Recorded` of a row that differs; `converter` is the state of the ADC's pins there."""
        host = np.array(self._host, np.int64).reshape(-1, 4)
        stimulus = replay_recording.Stimulus(np.concatenate(self._adc), host, np.concatenate(self._sar))
        stimulus = after_divergence.extend_stimulus(stimulus, row, self.design)
        rows = after_divergence.simulate_continuation(self.library, converter, stimulus, row, self.design)
        return Recorded(self.params.fpga, stimulus, rows, self.library.observed_indices)

    def finish(self):
        """Compare what the last edge left; raises Difference."""
        s = self.state
        values = [int(value) for _, value in leaves(s.fpga)] + [int(v) for v in fpga.pins(self.params.fpga, s.fpga)]
        row = s.tick * self.design.tick_clocks
        self.rtl.rows[row % lockstep.BUFFER_ROWS] = values
        if self.library.differing_indices(values, self.library.read()):
            self._stop(row, s.chips.adc)
        self.rtl.comparison_state[3] += 1


class PinCaptureLoop(Loop):
    """A loop that a design drives, or the model (`design` None): nothing is compared, what the pins show is kept."""

    def __init__(self, config, temp_lo_degc, temp_hi_degc, design, firmware):
        super().__init__(config, temp_lo_degc, temp_hi_degc, design, firmware)
        self.rtl = lockstep.connect_rtl(design, lockstep.MODEL_MODE if design is None else lockstep.RTL_ONLY_MODE)
        self.keep_rows = True
        self._kept = []

    def _lockstep(self, p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
        o = o._replace(edges=np.zeros((ticks // EDGE_TICKS + EDGES, 3), np.int64))
        state = super()._lockstep(p, s, ticks, rate_rad_s, temp_degc, host, faults, o)
        self._kept.append((o.drive_code, o.sense_code, o.edges[: int(o.edge_count[0])]))
        return state

    def pin_capture(self):
        """`pin_meter.PinCapture` so far."""
        drive, sense, edges = (np.concatenate(pieces) for pieces in zip(*self._kept, strict=True))
        columns = self.columns()
        codes = [columns[f"adc_{name}"] for name in ("drive_sin", "drive_cos", "sense_sin", "sense_cos")]
        truth = [columns[f"truth_{name}"] for name in ("x", "vx", "y", "vy")]
        latched = tuple(map(int, self.rtl.latched))
        return pin_meter.PinCapture(drive, sense, latched, edges, np.stack(codes, axis=1), np.stack(truth, axis=1))


class Outcome(NamedTuple):
    """What a loop came to; `difference` is None if there was none, `verdict` unless the design was judged."""

    rows: int
    seconds: float
    states: tuple
    locked: bool
    flags: tuple
    codes_sha256: str
    run_s: float
    registers: int
    difference: Difference | None
    verdict: judgement.Verdict | None = None

    @property
    def passed(self):
        """No difference, or none that a board would show."""
        return self.difference is None or (self.verdict is not None and self.verdict.passed)

    def to_dict(self):
        outcome_entries = {"passed": self.passed, **self._asdict(), "pins": len(library.PINS)}
        optional_results = {"difference": self.difference, "verdict": self.verdict}
        return outcome_entries | {name: item.to_dict() if item else None for name, item in optional_results.items()}

    def text(self):
        if self.verdict:
            return f"NOT EXACT {self.difference.text()}\n{self.verdict.text()}"
        if self.difference:
            return f"FAIL {self.difference.text()}"
        values = f"{len(library.PINS)} pins"
        if self.registers:
            values = f"{self.registers} registers and {values}"
        return (
            f"PASS {self.rows} rows of {values}, no difference: "
            f"{self.seconds:g} s from power-on in {self.run_s:.1f} s; states {', '.join(self.states)}; "
            f"{'locked' if self.locked else 'not locked'} at the end; fault flags: {', '.join(self.flags) or 'none'}"
            + ("" if self.registers else f"\n{judgement.pass_caveat()}")
        )


def _begun(kind, config, design, firmware):
    """(simulation of a kind at power-on, timeline of the scenario)."""
    if config.scenario.origin != "power_on" or config.scenario.resume:
        raise ConfigError('scenario.origin: the loop around RTL begins at power-on; set origin = "power_on"')
    timeline = scenario.expand(config.scenario, config.design_record())
    sim = kind(config, *timeline.temp_degc.limits(), design, firmware)
    sim.now = (np.array([timeline.rate_before_rad_s]), np.array([timeline.temp_before_degc]))
    return sim, timeline


def run_lockstep(config, design, firmware, progress=None):
    """`Outcome` of the scenario of `config` around a `library.Design` just reset, beside a model with `firmware`.

    Raises ConfigError for a scenario that does not begin at power-on.
    """
    sim, timeline = _begun(Loop, config, design, firmware)
    difference, began = None, time.perf_counter()
    try:
        for name, raw in sim.first_writes:
            sim.write(name, raw)
        simulate.play(sim, timeline, progress)
        sim.finish()
    except Difference as found:
        difference = found
    return Outcome(
        rows=sim.compared_row_count,
        seconds=sim.tick / sim.design.tick_hz,
        states=tuple(name for k, name in enumerate(sequencer.STATES) if sim.seen.states >> k & 1),
        locked=bool(sim.locked),
        flags=tuple(name for k, name in enumerate(fault_monitor.NAMES) if sim.seen.flags >> k & 1),
        codes_sha256=sim.codes_sha256(),
        run_s=time.perf_counter() - began,
        registers=sum(signal_index < len(library.REGISTERS) for signal_index in design.observed_indices),
        difference=difference,
    )


def capture_pins(config, design, firmware, progress=None):
    """`pin_meter.PinCapture` of the scenario of `config`, driven by a `library.Design` or the model (None)."""
    sim, timeline = _begun(PinCaptureLoop, config, design, firmware)
    for register, raw in sim.first_writes:
        sim.write(register, raw)
    simulate.play(sim, timeline, progress)
    return sim.pin_capture()


def judge_captures(config, firmware, yours, model):
    """`judgement.Verdict` on one `pin_meter.PinCapture` beside another, both of the scenario of `config`.

    What comes before the first write or fault of the scenario counts. Raises ConfigError for a board or a scenario that
    is not judged.
    """
    record, limits = firmware.design, judgement.lock_limits(config, firmware)
    timeline = scenario.expand(config.scenario, record)
    end = min((event.tick for event in timeline.events), default=timeline.ticks)
    rates_dps = np.degrees(timeline.rate_rad_s.frame_values(0, min(end // record.frame_ticks, timeline.frames)))
    stretches, *locks = pin_meter.find_plateaus(rates_dps, record, (yours, model), limits)
    if len({s.rate_dps for s in stretches}) < 2 and min(locks) >= 0:
        raise ConfigError(
            f"scenario.rate_dps: judging a design needs two rates, each held for {pin_meter.LEAST_S:g} s after lock"
        )
    grid = record.tick_clocks if firmware.references.retimed else 1
    run_measurements = [
        pin_meter.measure(capture, record, stretches, lock, grid)
        for capture, lock in zip((yours, model), locks, strict=True)
    ]
    return judgement.assess_design(config, firmware, run_measurements[1], run_measurements[0], stretches)


def judge_design(config, design, firmware, progress=None):
    """`judgement.Verdict` of a `library.Design` just reset: it drives the scenario of `config`, then the model does."""
    if firmware.digital:
        raise ConfigError('firmware.board: a design is judged by the codes of the ADC; set board = "analog_sid"')
    captures = [
        capture_pins(config, driven_by, firmware, progress and (lambda _, done, n, name=name: progress(name, done, n)))
        for name, driven_by in (("design alone", design), ("model alone", None))
    ]
    return judge_captures(config, firmware, *captures)


def run(config, rtl, folder=None, progress=None, firmware=None, level=2, pins=None):
    """Build the design in folder `rtl`, close the loop around it, play the scenario of `config`; `Outcome`.

    folder    where the library is built; a temporary one if None
    firmware  parameters of the FPGA, if not those of `config`
    level     of the C++ compiler's optimisation (`library.build`)
    pins      `Pins` of a design that has the pins of the board alone; one that is not exact is judged
    Raises ConfigError for a missing tool or a scenario that does not begin at power-on, FileError for a design that
    does not build.
    """
    firmware = firmware or build.firmware(config)
    if pins is None:
        board_recording.check(firmware)
    face, at, source_arguments = None, ".", None
    with tempfile.TemporaryDirectory(prefix="gyro-loop-") as temporary:
        if progress:
            progress("building the design", 0, 1)
        folder = folder or temporary
        if pins is not None:
            face = library.pin_face(pins.top, firmware, chips.parts(chips.dac_chips(config.design)))
            at, name, more = rtl, pins.top, []
            if pins.map:
                face, wrapped, name = library.write_map_wrapper(face, pins.map, pins.top, folder)
                more = [wrapped]
            source_arguments = [*library.user_sources(rtl, name, pins.files, folder), *more]
        path = library.build(rtl, firmware, folder, level, face, source_arguments)
        with library.Design(path, face, at) as design:
            outcome = run_lockstep(config, design, firmware, progress)
        if outcome.difference is None or pins is None or pins.exact:
            return outcome
        with library.Design(path, face, at) as design:
            return outcome._replace(verdict=judge_design(config, design, firmware, progress))
