"""Speed: how many simulated seconds a second of one core gives, and how long the first call takes.

    clocked     the engine of `gyro run`: every register at every edge, full plant, all noise on, locked at 100 deg/s
    firmware    the FPGA and the ADC's digital side alone, fed with fixed codes
    plant       the plant alone, fed with recorded DAC codes and with references at the drive frequency
    python      the clocked engine's own source run by CPython, without compiler: what a plain Python model would be
    first call  a fresh process from start to the first simulated frame: compiled from nothing, then from the cache

All but the first call is process CPU time, after warm-up: the median of rounds in which the kernels take turns, so that
a slow moment of the machine meets all of them. Nothing runs on more than one core.

    python -m testbench.bench       prints a table, writes build/bench.json and the table in docs/speed.md
"""

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from analog_frontend import adc_serial
from analog_frontend import top as plant
from fpga_model import top as fpga
from fpga_model.jit import hot
from fpga_model.rates import FRAME_TICKS, TICK_CYCLES, TICK_HZ
from testbench import config, engine, simulate
from testbench.docs import ROOT, markdown, replaced
from testbench.files import write_text
from testbench.tables import Table, fixed

COMMAND = "python -m testbench.bench"
RATE_RAD_S, TEMP_DEGC = 100 * simulate.DEG, 25.0
BLOCK_TICKS = 50_000
REPEATS = 7
PYTHON_FRAMES = 4
DRDY_CYCLE = 5
PHASE_MASK = (1 << 48) - 1


# ---- kernels ---------------------------------------------------------------------------------------------------------


@hot
def firmware_alone(p, f, chip, ticks, codes):
    """`ticks` of the firmware; the ADC repeats `codes`, a step up in every other frame (equal ones are a fault)."""
    for k in range(ticks):
        up = 10 * ((k // FRAME_TICKS) & 1)
        sent = (codes[0] + up, codes[1] + up, codes[2] + up, codes[3] + up, codes[4], 0, 0, 0)
        ready = 1 if k % FRAME_TICKS == 0 else 0
        for c in range(TICK_CYCLES):
            f = fpga.step(p, f, fpga.Inputs(chip.drdy_n, adc_serial.dout(chip), 0, 0, 0, 0, 0))
            loaded = ready if c == DRDY_CYCLE else 0
            chip = adc_serial.step(chip, f.adc.cs_n, f.adc.sclk, loaded, adc_serial.packed(0xC00000, sent)[0], sent)
    return f, chip


@hot
def plant_alone(p, a, tick0, drive, sense, cycles, word, quad_code, rate_rad_s, temp_degc, edges):
    """One tick per DAC code of `drive` and `sense`; references turn by `word` a clock, V_q moves every frame."""
    quadrant = 0
    for k in range(drive.shape[0]):
        tick = tick0 + k
        if tick % FRAME_TICKS == 0:
            plant.retune(p, a, rate_rad_s, quad_code + (tick // FRAME_TICKS & 1), temp_degc)
        now = (((tick * TICK_CYCLES * word) & PHASE_MASK) >> 46) & 3
        count = 0
        if now != quadrant:
            which = 0 if now == 0 or now == 2 else 1
            for d in (which, which + 2):
                edges[count, 0] = 0
                edges[count, 1] = d
                count += 1
        quadrant = now
        plant.step(p, a, tick, plant.Pins(drive[k], cycles[0], sense[k], cycles[1], count), edges)


class Bench:
    """A locked gyroscope, and three kernels on it; each call moves its own copy on by `ticks` and returns nothing."""

    def __init__(self, ticks=BLOCK_TICKS, locked=True):
        self.ticks = ticks
        self.sim = simulate.Simulation(config.Config(), TEMP_DEGC, TEMP_DEGC)
        if locked:
            lock_s = simulate.start(self.sim.config, self.sim, RATE_RAD_S, TEMP_DEGC)
            assert lock_s is not None, "the default configuration must lock"
        else:
            self.sim.now = (np.array([RATE_RAD_S]), np.array([TEMP_DEGC]))
        streams = self.sim.advance(min(ticks, simulate.CHUNK_TICKS), RATE_RAD_S, TEMP_DEGC)
        f = self.sim.state.fpga
        repeat = -(-ticks // len(streams.drive_code))
        self.drive = np.tile(streams.drive_code.astype(np.int64), repeat)[:ticks]
        self.sense = np.tile(streams.sense_code.astype(np.int64), repeat)[:ticks]
        self.word, self.quad_code = f.control.frequency_tracker.word, f.control.quadrature_loop.root.y
        self.codes = tuple(f.adc.channels[:5])
        self.digital = f, self.sim.state.chips.adc
        self.plant = plant.copy(self.sim.state.plant)
        self.cycles = tuple(int(c) for c in self.plant.cycles)
        self.tick = self.sim.tick
        self.edges = np.zeros((engine.MAX_EDGES, 2), np.int64)

    def clocked(self):
        """The engine as `gyro run` drives it."""
        self.sim.advance(self.ticks, RATE_RAD_S, TEMP_DEGC)
        self.sim.frames.clear()
        self.sim.truth.clear()

    def firmware(self):
        """The firmware alone."""
        self.digital = firmware_alone(self.sim.params.fpga, *self.digital, self.ticks, self.codes)

    def plant_only(self):
        """The plant alone."""
        plant_alone(
            self.sim.params.plant,
            self.plant,
            self.tick,
            self.drive,
            self.sense,
            self.cycles,
            self.word,
            self.quad_code,
            RATE_RAD_S,
            TEMP_DEGC,
            self.edges,
        )
        self.tick += self.ticks


# ---- measuring -------------------------------------------------------------------------------------------------------


def cpu_s(work):
    """Process CPU time (s) of a call."""
    began = time.process_time()
    work()
    return time.process_time() - began


def kernels(repeats=REPEATS):
    """Simulated seconds per CPU second, median over `repeats` rounds: clocked, firmware, plant."""
    bench = Bench()
    works = {"clocked_rt": bench.clocked, "firmware_rt": bench.firmware, "plant_rt": bench.plant_only}
    for work in works.values():
        work()
    spent = {name: [] for name in works}
    for _ in range(repeats):
        for name, work in works.items():
            spent[name].append(cpu_s(work))
    return {name: bench.ticks / TICK_HZ / statistics.median(times) for name, times in spent.items()}


def _child(code, **environment):
    """Standard output of a fresh Python process, and its wall time (s)."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout, time.perf_counter() - began


FIRST_FRAME = "from testbench.bench import Bench; Bench(ticks=125, locked=False)"
INTERPRETED = f"""
from testbench.bench import Bench, cpu_s
bench = Bench(ticks=125, locked=False)
bench.ticks = {PYTHON_FRAMES} * 125
print(cpu_s(bench.clocked))
"""


def first_calls(folder):
    """Wall time (s) of a process from its start to the first frame: empty cache in `folder`, then a full one."""
    return {
        "first_call_cold_s": _child(FIRST_FRAME, GYRO_CACHE=str(folder))[1],
        "first_call_warm_s": _child(FIRST_FRAME, GYRO_CACHE=str(folder))[1],
    }


def interpreted():
    """Simulated seconds per CPU second of the same engine without compiler."""
    out, _ = _child(INTERPRETED, NUMBA_DISABLE_JIT="1")
    return {"python_rt": PYTHON_FRAMES * FRAME_TICKS / TICK_HZ / float(out)}


def cpu():
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def versions():
    """What the numbers depend on."""
    import llvmlite
    import numba

    return {
        "python": platform.python_version(),
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "numpy": np.__version__,
    }


def measure():
    """The whole measurement."""
    with tempfile.TemporaryDirectory() as folder:
        first = first_calls(folder)
    return kernels() | first | interpreted() | {"versions": versions(), "cpu": cpu()}


# ---- showing ---------------------------------------------------------------------------------------------------------


def table(result):
    """The measurement as a table."""
    speeds = (
        ("clocked_rt", "clocked engine: firmware, chips, plant, all noise"),
        ("firmware_rt", "firmware and ADC chip alone"),
        ("plant_rt", "plant alone"),
        ("python_rt", "clocked engine, the same source without compiler"),
    )
    rows = []
    for key, text in speeds:
        rt = result[key]
        ratio = fixed(rt / result["python_rt"], 0) if key in ("clocked_rt", "python_rt") else ""
        rows.append((text, key, f"{rt:.3g}", fixed(1e3 / rt, 0) + " ns", ratio))
    for key, text in (
        ("first_call_cold_s", "first call, nothing compiled"),
        ("first_call_warm_s", "first call, from the cache"),
    ):
        rows.append((text, key, fixed(result[key], 1) + " s", "", ""))
    heads = ("what", "key", "simulated s per CPU s", "CPU time per tick", "times plain Python")
    named = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return Table("Speed, one core", heads, rows, f"{result['cpu']}; {named}", (2, 3, 4))


def speed_part(result):
    """The generated part of docs/speed.md."""
    shown = table(result)
    return f"Measured with `{COMMAND}` on {shown.note}.\n\n{markdown(shown)}"


def main():
    """Measure, print, write."""
    result = measure()
    cli_table = table(result)
    from testbench import cli

    cli._print_tables([cli_table])
    (ROOT / "build").mkdir(exist_ok=True)
    write_text(ROOT / "build" / "bench.json", json.dumps(result, indent=1) + "\n")
    page = ROOT / "docs" / "speed.md"
    write_text(page, replaced(page.read_text(), "speed", speed_part(result)))
    print("written: build/bench.json, docs/speed.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
