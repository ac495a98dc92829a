"""Comparators of the engines: the reference RTL of the firmware around chips and plant in C++, from a locked state.

    verilator   testbench/rtl verilated, around the board of board.h      icarus   the same two, joined by VPI
    c           the firmware in C, generated from the kernels, around the same board
    peak        peak of multiply-add pairs of this CPU

`export` writes registers and constants of a locked gyroscope; the programs continue from there and write every code.
The first two share no code with the engines: equal codes are an independent check of both. Of `c` this holds for the
plant; its firmware has the engines' equations and another compiler. A missing tool is `Missing`.
Source    docs/speed.md
"""

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analog_frontend.parts import adc, noise, sid
from fpga_model import references, sequencer
from fpga_model.rates import FRAME_TICKS
from testbench import flatten
from testbench.golden.c_model import export as c_model
from testbench.golden.loop import library
from testbench.golden.recording import board
from testbench.run import simulation

SOURCES = Path(__file__).parent
RTL = SOURCES.parent / "rtl"
DESIGN = "gyro_core.v"
# SSE to AVX-512 give the same doubles as long as products are not fused into sums
FLAGS = ("-O3", "-march=native", "-ffp-contract=off")
PLANT_STATES = 16 + 24


class Missing(Exception):
    """A comparator that cannot be built or run here; the text says why in one line."""


class Codes(NamedTuple):
    """What a comparator wrote: DAC codes per tick, ADC codes at the beginning of each frame, and at the end all
    registers and the 16 + 24 voltages and displacements of its plant.
    """

    drive: np.ndarray
    sense: np.ndarray
    adc: np.ndarray
    registers: dict
    plant: np.ndarray
    cpu_s: float


# ---- export ----------------------------------------------------------------------------------------------------------


def _check(sim):
    """The comparators know the base plant and the LOCKED state alone; ValueError for anything else."""
    p, a = sim.params.fpga, sim.params.plant
    wrong = {
        "board = digital_sid": p.digital,
        "quadrature_update_khz = 1000": p.quadrature_fast,
        "effects": a.effects.any_force or a.effects.any_cv or a.laws.force or a.laws.cv or a.ring.on,
        "DAC bow or glitch": any(d.bow or d.glitch_v_s for d in (a.drive_dac, a.sense_dac)),
        "INL": any(a.adc.inl),
        "a range of temperatures": a.temp_count != 1,
        "a gyroscope that is not locked": not sim.locked,
        "a tick that begins no frame": sim.tick % FRAME_TICKS,
    }
    for what, found in wrong.items():
        if found:
            raise ValueError(f"the comparators leave out: {what}")


def _words(sim, rate_rad_s):
    """The words of state.bin, in the order of Board::load."""
    f, s, p, chips = sim.state.fpga, sim.state.plant, sim.params.plant, sim.state.chips
    t = p.tables
    yield from (sim.tick, sim.state.drdy_cycle, references.pins(sim.params.fpga.references, f.references))
    yield from (value for _, value in flatten.leaves(chips))
    for array in (
        s.z,
        s.jet,
        s.column_jet,
        s.pickoff,
        s.volts,
        s.coming_v,
        s.late_area,
        s.caps,
        s.late_tau_s,
        s.adc.sums,
    ):
        yield from np.asarray(array, float).ravel().tolist()
    for array in (s.cycles, s.switch, s.late_count, s.adc.clock):
        yield from array.tolist()
    temp_degc = float(sim.now[1][-1])
    yield from (float(rate_rad_s), float(t.kq_n_per_m_per_v2[0]), float(t.kxy_n_per_m[0]), p.quad_lsb_v)
    yield from (p.drive_dac.lsb_v, p.sense_dac.lsb_v, p.drive_dac.offset_v, p.sense_dac.offset_v)
    yield from p.switch_tau_s.ravel().tolist()
    yield from (p.slope_gain, float(t.driver_s[0]), adc.SENSOR_V_AT_25_DEGC + adc.SENSOR_V_PER_K * (temp_degc - 25.0))
    yield from (p.adc.normal, p.adc.full_steps, *p.adc.offset_v, *p.adc.steps_per_v)
    yield from (*noise.DECAY.tolist(), *noise.GAIN.tolist())
    yield from (int(carry) for carry in p.switch_carry.ravel())
    yield from (int(t.drive_carry[0, s.cycles[0]]), int(t.sense_carry[0, s.cycles[1]]))
    yield from (p.adc.period, p.adc.delay, p.adc.decimation, p.adc.step_code)
    n = p.noise
    sources = (n.force_x, n.force_y, n.cv_x, n.cv_y, n.drive_dac, n.sense_dac, n.edge_jitter)
    for source in (*sources, *p.adc.white, *p.adc.flicker):
        yield from (source.key0, source.key1, source.on, getattr(source, "half", 0), source[2])
    d = p.sid
    taylor = np.moveaxis(d.taylor.reshape(4, sid.TERMS, 4), -1, 0)[: sid.STAGES]
    yield from (d.h_s, d.r, d.e1, d.e2, d.e3, d.s1, d.s2, d.s3, *d.inject.tolist(), *taylor.ravel().tolist())
    yield from (noise.IH4_SCALE, noise.IH12_SCALE)


def _register(name):
    """Where a register of the model stands below `gyro_board`: blocks are instances, an index is part of the name."""
    *blocks, last = name.split(".")
    if last.isdigit():
        last = f"{blocks.pop()}_{last}"
    return ".".join(("firmware", *blocks, f"r_{last}"))


def _design(params):
    """Verilog of gyro_board that begins with the registers of state.hex and shows its own at the end."""
    loads = [f"    {_register(name)} = loaded[{k}];" for k, name in enumerate(library.REGISTERS)]
    shows = [f'    $display("register {k} %0d", {_register(name)});' for k, name in enumerate(library.REGISTERS)]
    state = [f"reg [63:0] loaded [0:{len(loads) - 1}];", "initial begin", '    $readmemh("state.hex", loaded);', *loads]
    state += ["end", "final begin", *shows, "end", "", "endmodule"]
    return board.text(params).replace("\nendmodule", "\n" + "\n".join(state))


def export(sim, rate_rad_s, folder):
    """Write the design, its tables and the present state of a locked `Simulation` for the comparators to `folder`."""
    _check(sim)
    words = list(_words(sim, rate_rad_s))
    raw = b"".join(np.array(w, "<f8" if isinstance(w, float) else "<i8").tobytes() for w in words)
    registers = zip(flatten.leaves(sim.state.fpga), library.formats_of(sim.design), strict=False)
    state = [f"{int(value) & ((1 << fmt.width) - 1):x}" for (_, value), fmt in registers]
    folder.mkdir(parents=True, exist_ok=True)
    board.write_roms(folder)
    (folder / DESIGN).write_text(_design(sim.params.fpga))
    (folder / "state.hex").write_text("\n".join(state) + "\n")
    (folder / "state.bin").write_bytes(raw)
    (folder / "model").mkdir(exist_ok=True)
    for name, text in c_model.model(sim.params.fpga).items():
        (folder / "model" / name).write_text(text)


# ---- build -----------------------------------------------------------------------------------------------------------


def tool(name):
    """Path of a program; Missing if there is none."""
    path = shutil.which(name)
    if path is None:
        raise Missing(f"{name} is not installed")
    return path


def versions():
    """{tool: version} of what builds the comparators, None for a tool that is not there."""
    asked = {"gcc": ("-dumpfullversion",), "verilator": ("--version",), "iverilog": ("-V",)}
    found = {}
    for name, arguments in asked.items():
        path = shutil.which(name)
        said = subprocess.run([path, *arguments], capture_output=True, text=True).stdout if path else ""
        number = re.search(r"\d+(\.\d+)+", said)
        found[name] = number[0] if number else None
    return found


def _call(command, folder):
    done = subprocess.run([str(part) for part in command], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()
        said = next((line for line in lines if "error" in line.lower()), lines[-1])
        raise Missing(f"{Path(command[0]).name} failed: {said.strip()}")
    return done.stdout


def _compiler():
    return tool(os.environ.get("CXX", "g++"))


def build_verilator(folder, flags=FLAGS):
    """The verilated firmware; returns its command."""
    verilator, make, _ = tool("verilator"), tool("make"), _compiler()
    _call(
        [verilator, "--cc", "--exe", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--noassert", "-Wno-lint"]
        + ["-Wno-fatal", "--Mdir", "verilated", "--top-module", board.MODULE, "-CFLAGS", f"-std=c++17 -I{SOURCES}"]
        + [DESIGN, *library.sources(RTL), SOURCES / "verilator.cpp"],
        folder,
    )
    # OPT_FAST is -Os by default and comes after CFLAGS: an -O3 there would be undone
    fast = " ".join(flags)
    name = f"V{board.MODULE}"
    _call([make, "-s", "-C", "verilated", "-f", f"{name}.mk", f"OPT_FAST={fast}", f"OPT_GLOBAL={fast}"], folder)
    return [str(folder / "verilated" / name)]


def build_icarus(folder):
    """The firmware under Icarus with the board as a VPI module; returns its command."""
    iverilog, vvp = tool("iverilog"), tool("vvp")
    header = Path(iverilog).resolve().parent.parent / "include" / "iverilog"
    _call(
        [_compiler(), "-std=c++17", *FLAGS, "-shared", "-fPIC", f"-I{header}", SOURCES / "vpi.cpp", "-o", "board.vpi"],
        folder,
    )
    # 2012 for the `final` block of the design alone
    _call(
        [iverilog, "-g2012", "-s", "icarus", "-o", "core.vvp", SOURCES / "icarus.v", DESIGN, *library.sources(RTL)],
        folder,
    )
    return [vvp, "-M", str(folder), "-m", "board", str(folder / "core.vvp")]


def build_c(folder, flags=FLAGS):
    """The firmware in C; returns its command."""
    cc, cxx = tool(os.environ.get("CC", "gcc")), _compiler()
    objects = folder / "objects"
    objects.mkdir(exist_ok=True)
    sources = sorted((folder / "model").glob("*.c"))
    _call([cc, "-std=c99", *flags, f"-I{folder / 'model'}", "-c", *sources], objects)
    program = [SOURCES / "c_firmware.cpp", *sorted(objects.glob("*.o"))]
    _call([cxx, "-std=c++17", *flags, f"-I{folder / 'model'}", f"-I{SOURCES}", *program, "-o", "c_firmware"], folder)
    return [str(folder / "c_firmware")]


def build_peak(folder):
    """The kernel that measures the peak of this CPU; returns its command."""
    folder.mkdir(parents=True, exist_ok=True)
    _call([tool("gcc"), *FLAGS, SOURCES / "peak.c", "-o", "peak"], folder)
    return [str(folder / "peak")]


BUILDERS = {"verilator": build_verilator, "icarus": build_icarus, "c": build_c}


# ---- run -------------------------------------------------------------------------------------------------------------


def run(name, command, folder, ticks):
    """Run a built comparator for `ticks` from the exported state; returns `Codes`."""
    files = {"state": folder / "state.bin", "ticks": ticks, "codes": folder / f"{name}.codes"}
    arguments = [f"+{key}={value}" for key, value in files.items()] if name == "icarus" else list(files.values())
    shown = _call([*command, *arguments], folder)
    values = [line.split()[1:] for line in shown.splitlines() if line.startswith("register ")]
    raw = files["codes"].read_bytes()
    ticks, frames = (int(n) for n in np.frombuffer(raw, "<i8", 2))
    cpu_s, *plant = np.frombuffer(raw, "<f8", 1 + PLANT_STATES, 16)
    first = 8 * (3 + PLANT_STATES)
    drive, sense = np.frombuffer(raw, "<i4", 2 * ticks, first).reshape(2, ticks)
    rows = np.frombuffer(raw, "<i8", frames * adc.CHANNELS, first + 8 * ticks).reshape(frames, adc.CHANNELS)
    registers = {library.REGISTERS[int(k)]: int(value) for k, value in values}
    return Codes(drive, sense, rows, registers, np.array(plant), float(cpu_s))


def reference(sim, rate_rad_s, ticks):
    """`Codes` of an engine for the next `ticks` of a locked `Simulation`; here a row of ADC codes is what was read."""
    if ticks > simulation.CHUNK_TICKS:
        raise ValueError(f"ticks: {ticks} is above {simulation.CHUNK_TICKS}, one chunk")
    streams = sim.advance(ticks, rate_rad_s, float(sim.now[1][-1]))
    if not np.all(streams.frames[:, simulation.FRAME["state"]] == sequencer.LOCKED):
        raise ValueError("the gyroscope lost its lock")
    return Codes(
        streams.drive_code,
        streams.sense_code,
        streams.frames[:, : adc.CHANNELS],
        {name: int(value) for name, value in flatten.leaves(sim.state.fpga)},
        np.concatenate([sim.state.plant.z, sim.state.plant.caps.ravel()]),
        float("nan"),
    )


def differences(engine, peer):
    """First difference of each kind between an engine's `Codes` and a comparator's, as lines of text; none is none.

    A shorter run of the comparator is compared as far as it goes, then without its registers and plant.
    """
    found = []
    ticks = len(peer.drive)
    for name, have, want in (("drive", peer.drive, engine.drive), ("sense", peer.sense, engine.sense)):
        for k in np.flatnonzero(have != want[:ticks])[:1]:
            found.append(f"{name} DAC, tick {k}: code {have[k]} instead of {want[k]}")
    # a conversion that is there when a frame begins is read in that frame, and the engine's next row shows it
    have, want = peer.adc[: len(engine.adc) - 1], engine.adc[1 : 1 + len(peer.adc)]
    for k, c in np.argwhere(have != want)[:1]:
        found.append(f"ADC channel {c}, frame {k}: code {have[k, c]} instead of {want[k, c]}")
    if ticks == len(engine.drive):
        for name in [name for name, value in peer.registers.items() if value != engine.registers[name]][:1]:
            found.append(f"register {name}: {peer.registers[name]} instead of {engine.registers[name]}")
        for k in np.flatnonzero(peer.plant != engine.plant)[:1]:
            found.append(f"plant state {k}: {float(peer.plant[k]).hex()} instead of {float(engine.plant[k]).hex()}")
    return found


def peak_pairs_per_s(command, rounds=20_000_000):
    """Multiply-add pairs of doubles per CPU second, not fused, in vectors, nothing waiting for anything."""
    return float(_call([*command, rounds], None))
