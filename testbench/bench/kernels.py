"""What is timed of this repository: kernels on a locked gyroscope, each moves its own copy of it on.

    frame, clocked   the engines of `gyro run`: full plant, all noise, locked at 100 deg/s, hash of all codes included
    baseband         the averaged plant, the same gyroscope and noise, with the rows of 8 kHz, or their hash besides
    lanes            the same for eight gyroscopes side by side, with that hash or with the rows of 8 kHz alone
firmware         the FPGA and the ADC's digital side alone, fed with fixed codes
plant            the plant alone, tick by tick, fed with recorded DAC codes and references at the drive frequency
python           the clocked engine's own source run by CPython, without compiler, from power-on
"""

import os
import subprocess
import sys
import time

import numpy as np

from analog_frontend import top as plant
from analog_frontend.parts import adc_serial
from fpga_model import top as fpga
from fpga_model.jit import hot
from fpga_model.rates import FRAME_TICKS, TICK_CYCLES
from testbench import config
from testbench.console.markdown import ROOT
from testbench.engines import engine, lanes
from testbench.run import simulate, warmup
from testbench.run.simulation import DEG, Simulation

RATE_RAD_S, TEMP_DEGC = 100 * DEG, 25.0
BLOCK_TICKS = 100_000
FIRST_TICKS = 1000
DRDY_CYCLE = 5
PHASE_MASK = (1 << 48) - 1


def cpu_s(work, *arguments):
    """Process CPU time (s) of a call."""
    began = time.process_time()
    work(*arguments)
    return time.process_time() - began


def gyroscope(engine_name, locked=True, changes=None, codes=True):
    """`Simulation` of the default configuration, `changes` apart, on an engine: locked, at the beginning of a frame.

    codes  whether the codes are kept and hashed
    """
    first = "frame" if locked and engine_name == "clocked" else engine_name  # to lock with the same bits, sooner
    sim = Simulation(config.changed(config.Config(), changes or {}, library=True), TEMP_DEGC, TEMP_DEGC, engine=first)
    sim.keep_rows, sim.keep_codes = False, codes
    sim.now = (np.array([RATE_RAD_S]), np.array([TEMP_DEGC]))
    if locked:
        if simulate.start(sim.config, sim, RATE_RAD_S, TEMP_DEGC) is None:
            raise RuntimeError(f"not locked with {changes}: nothing can be timed")
        advance(sim, -sim.tick % FRAME_TICKS)
    sim.engine = engine_name or sim.engine
    return sim


def advance(sim, ticks):
    """Move a simulation on at the rate and temperature of all measurements."""
    return sim.advance(ticks, RATE_RAD_S, TEMP_DEGC)


def different(k):
    """What gyroscope `k` of many has of its own."""
    return {"noise.seed": 1 + k, "plant.fx_hz": 11002.3 + 0.01 * k, "plant.qx": 210e3 + 500 * k}


class SideBySide:
    """Locked gyroscopes at one tick, each with parts and noise of its own, on the lanes engine, groups in threads.

    codes  whether the codes of every tick are kept and hashed
    """

    def __init__(self, count, threads=1, codes=True):
        self.sims = [gyroscope("frame", changes=different(k)) for k in range(count)]
        last = max(sim.tick for sim in self.sims)
        for sim in self.sims:
            advance(sim, last - sim.tick)
        for sim in self.sims:
            sim.keep_codes = codes
        self.lanes = lanes.Lanes(self.sims, threads)

    def advance(self, ticks):
        """All of them by `ticks`, at the rate and temperature of all measurements."""
        count = len(self.sims)
        self.lanes.advance(ticks, [RATE_RAD_S] * count, [TEMP_DEGC] * count)


@hot
def run_firmware_only(p, rom, f, chip, ticks, codes):
    """`ticks` of the firmware; the ADC repeats `codes`, a step up in every other frame (equal ones are a fault)."""
    for k in range(ticks):
        up = 10 * ((k // FRAME_TICKS) & 1)
        sent = (codes[0] + up, codes[1] + up, codes[2] + up, codes[3] + up, codes[4], 0, 0, 0)
        ready = 1 if k % FRAME_TICKS == 0 else 0
        for c in range(TICK_CYCLES):
            f = fpga.step(p, rom, f, fpga.Inputs(chip.drdy_n, adc_serial.dout(chip), 0, 0, 0, 0, 0))
            loaded = ready if c == DRDY_CYCLE else 0
            status = adc_serial.frame_words(0xC00000, sent)[0]
            chip = adc_serial.step(adc_serial.WORD_BITS, chip, f.adc.cs_n, f.adc.sclk, loaded, status, sent)
    return f, chip


@hot
def run_plant_only(p, a, tick0, drive, sense, cycles, word, quad_code, rate_rad_s, temp_degc, edges):
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
    """A locked gyroscope on the clocked engine, and the kernels of its parts on copies of it."""

    def __init__(self, ticks=BLOCK_TICKS):
        self.ticks = ticks
        self.sim = gyroscope("clocked")
        streams = advance(self.sim, min(ticks, BLOCK_TICKS))
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

    def run_clocked(self):
        """The clocked engine as `gyro run` drives it."""
        advance(self.sim, self.ticks)

    def firmware(self):
        """The firmware alone."""
        self.digital = run_firmware_only(
            self.sim.params.fpga, self.sim.params.rom, *self.digital, self.ticks, self.codes
        )

    def plant_only(self):
        """The plant alone."""
        run_plant_only(
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


# ---- processes of their own ------------------------------------------------------------------------------------------


def serve(locked):
    """Each line of standard input names an engine and a number of ticks; the answer is their CPU time (s)."""
    sim = gyroscope("frame" if locked else "clocked", locked)
    for line in sys.stdin:
        engine_name, ticks = line.split()
        if sim.engine != engine_name:
            sim.engine = engine_name
        print(cpu_s(advance, sim, int(ticks)), flush=True)


class Served:
    """A gyroscope in a process of its own."""

    def __init__(self, locked=True, **environment):
        self.process = _spawn_python(f"from testbench.bench import kernels; kernels.serve({locked})", **environment)

    def cpu_s(self, engine_name, ticks):
        """CPU time (s) of `ticks` more on an engine."""
        self.ask(engine_name, ticks)
        return self.answer()

    def ask(self, engine_name, ticks):
        """Set it to work; `answer` waits for the end."""
        self.process.stdin.write(f"{engine_name} {ticks}\n")
        self.process.stdin.flush()

    def answer(self):
        """CPU time (s) of what was asked for."""
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError("the process that times an engine has ended")
        return float(answer)

    def close(self):
        """End the process."""
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()


def output(code):
    """Last line of what a process of its own prints."""
    process = _spawn_python(code)
    printed_text, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"a process of the benchmark failed, exit code {process.returncode}: {code}")
    return printed_text.splitlines()[-1]


def first_call():
    """A millisecond of the engine of `gyro run` from power-on, then one of the frame engine, when it is compiled."""
    sim = gyroscope(None, locked=False)
    advance(sim, FIRST_TICKS)
    warmup.wait()
    advance(sim, FIRST_TICKS)


def first_call_s(cache):
    """Wall time (s) of a process that does a `first_call` with this cache folder; the frame engine is in it then."""
    began = time.perf_counter()
    process = _spawn_python("from testbench.bench import kernels; kernels.first_call()", GYRO_CACHE=str(cache))
    process.communicate()
    if process.returncode:
        raise RuntimeError("the process of the first call failed")
    return time.perf_counter() - began


def _spawn_python(code, **environment):
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
