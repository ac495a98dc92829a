"""A scenario with RTL in place of the firmware, in lockstep with the model: what is the same, or what differs first.

    Loop         a `Simulation` whose firmware is a compiled design, compared at every edge
    Difference   where the RTL first is not the model: tick, clock, every register or pin that differs, both values
    STORY        power-on, lock, rate steps of +-300 deg/s, a silent ADC: the scenario if no other is given

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
from testbench.engines import engine
from testbench.errors import ConfigError
from testbench.flatten import leaves
from testbench.golden.loop import library, lockstep
from testbench.run import build, simulate
from testbench.run.simulation import FRAME, Simulation

SECONDS = 3.0
STEP_DPS, STEPS_S, FAULT_S, FAULT_LENGTH_S = 300.0, (1.5, 1.8, 2.1), 2.4, 0.003
SHOWN = 8  # registers of a difference that a text lists


def story(seconds=SECONDS):
    """Config of the standard scenario, cut to `seconds` from power-on; 0.001 .. 3600 s."""
    begin, turn, end = STEPS_S
    rates = [[0.0, 0.0], [begin, STEP_DPS], [turn, -STEP_DPS], [end, 0.0]]
    faults = [[FAULT_S, "adc_silent", "adc", 0, FAULT_LENGTH_S]] if seconds > FAULT_S else []
    values = {"origin": "power_on", "seconds": seconds, "rate_dps": rates, "rate_shape": "steps", "faults": faults}
    return changed(Config(), {f"scenario.{key}": value for key, value in values.items()})


class Difference(Exception):
    """The RTL is not the model.

    row     clocks since power-on; the values stand before this edge
    design  record of the design
    wrong   [(name, expected, got)] of every register and pin that differs there, in the model's order
    before  int64 (rows, values): the model's rows up to this one, the last one last
    """

    def __init__(self, row, wrong, before, design=DEFAULT):
        self.row, self.wrong, self.before, self.us = row, wrong, before, row / design.master_hz * 1e6
        self.tick, self.clock = divmod(row, design.tick_clocks)
        super().__init__(self.text())

    def text(self):
        """First line: when and which; then the other registers, and what the first one held before."""
        name, expected, got = self.wrong[0]
        lines = [f"tick {self.tick}, clock {self.clock} ({self.us:.3f} us): {name}: "
                 f"expected {expected}, got {got}"]  # fmt: skip
        lines += [f"  also {name}: expected {expected}, got {got}" for name, expected, got in self.wrong[1:SHOWN]]
        if len(self.wrong) > SHOWN:
            lines.append(f"  and {len(self.wrong) - SHOWN} more")
        held = self.before[:, library.NAMES.index(name)].tolist()
        lines.append(f"  {name} in the model, up to here: {', '.join(map(str, held))}")
        return "\n".join(lines)

    def to_dict(self):
        wrong = [{"register": name, "expected": expected, "got": got} for name, expected, got in self.wrong]
        return {"row": self.row, "tick": self.tick, "clock": self.clock, "differs": wrong}


class Seen:
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
        self.rtl = lockstep.rtl_of(design)
        self._run = self._lockstep
        self.keep_rows = False
        self.seen = Seen()
        self.sinks.append(self.seen)

    @property
    def compared(self):
        """Rows that were compared, 226 values each."""
        return int(self.rtl.found[3])

    def _lockstep(self, p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
        edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
        chunk = engine.Chunk(s.tick, rate_rad_s, temp_degc, *host, faults, o, edges)
        end = s.tick + ticks
        f, chips, drdy_cycle = lockstep.ticks(p, s.fpga, s.chips, s.plant, chunk, end, s.drdy_cycle, self.rtl)
        if self.rtl.found[0] >= 0:
            self._stop(int(self.rtl.found[0]))
        return engine.State(f, chips, s.plant, end, drdy_cycle)

    def _stop(self, row):
        expected, got = self.rtl.rows[row % lockstep.KEPT], self.library.read()
        wrong = [(name, int(expected[k]), int(got[k])) for k, name in enumerate(library.NAMES) if expected[k] != got[k]]
        first = max(0, row - lockstep.KEPT + 1)
        before = np.stack([self.rtl.rows[n % lockstep.KEPT] for n in range(first, row + 1)])
        raise Difference(row, wrong, before.copy(), self.design)

    def finish(self):
        """Compare what the last edge left; raises Difference."""
        s = self.state
        values = [int(value) for _, value in leaves(s.fpga)] + [int(v) for v in fpga.pins(self.params.fpga, s.fpga)]
        row = s.tick * self.design.tick_clocks
        self.rtl.rows[row % lockstep.KEPT] = values
        if not np.array_equal(self.library.read(), values):
            self._stop(row)
        self.rtl.found[3] += 1


class Outcome(NamedTuple):
    """What a loop came to; `difference` is None if there was none."""

    rows: int
    seconds: float
    states: tuple
    locked: bool
    flags: tuple
    codes_sha256: str
    run_s: float
    difference: Difference | None

    def to_dict(self):
        found = {**self._asdict(), "registers": len(library.REGISTERS), "pins": len(library.PINS)}
        return {**found, "difference": self.difference.to_dict() if self.difference else None}

    def text(self):
        if self.difference:
            return f"FAIL {self.difference.text()}"
        return (
            f"PASS {self.rows} rows of {len(library.REGISTERS)} registers and {len(library.PINS)} pins, no difference: "
            f"{self.seconds:g} s from power-on in {self.run_s:.1f} s; states {', '.join(self.states)}; "
            f"{'locked' if self.locked else 'not locked'} at the end; faults seen: {', '.join(self.flags) or 'none'}"
        )


def closed(config, design, firmware, progress=None):
    """`Outcome` of the scenario of `config` around a `library.Design` just reset, beside a model with `firmware`.

    Raises ConfigError for a scenario that does not begin at power-on.
    """
    if config.scenario.origin != "power_on" or config.scenario.resume:
        raise ConfigError('scenario.origin: the loop around RTL begins at power-on; set origin = "power_on"')
    timeline = scenario.expand(config.scenario, config.design_record())
    sim = Loop(config, *timeline.temp_degc.limits(), design, firmware)
    sim.now = (np.array([timeline.rate_before_rad_s]), np.array([timeline.temp_before_degc]))
    difference, began = None, time.perf_counter()
    try:
        for name, raw in sim.first_writes:
            sim.write(name, raw)
        simulate.play(sim, timeline, progress)
        sim.finish()
    except Difference as found:
        difference = found
    return Outcome(
        rows=sim.compared,
        seconds=sim.tick / sim.design.tick_hz,
        states=tuple(name for k, name in enumerate(sequencer.STATES) if sim.seen.states >> k & 1),
        locked=bool(sim.locked),
        flags=tuple(name for k, name in enumerate(fault_monitor.NAMES) if sim.seen.flags >> k & 1),
        codes_sha256=sim.codes_sha256(),
        run_s=time.perf_counter() - began,
        difference=difference,
    )


def run(config, rtl, folder=None, progress=None, firmware=None, level=2):
    """Build the design in folder `rtl`, close the loop around it, play the scenario of `config`; `Outcome`.

    folder    where the library is built; a temporary one if None
    firmware  parameters of the FPGA, if not those of `config`
    level     of the C++ compiler's optimisation (`library.build`)
    Raises ConfigError for a missing tool or a scenario that does not begin at power-on, FileError for a design that
    does not build.
    """
    firmware = firmware or build.firmware(config)
    if firmware.control.notch is not None:
        raise ConfigError("firmware.notch_hz: the Verilog of the whole design has no notch; set it to 0")
    with tempfile.TemporaryDirectory(prefix="gyro-loop-") as temporary:
        if progress:
            progress("building the design", 0, 1)
        path = library.build(rtl, firmware, folder or temporary, level)
        with library.Design(path) as design:
            return closed(config, design, firmware, progress)
