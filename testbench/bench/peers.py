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

from analog_frontend.parts import adc
from fpga_model import sequencer
from testbench import flatten
from testbench.golden.c_model import export_c as c_model
from testbench.golden.loop import library, locked_state
from testbench.golden.recording import board_recording
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


def _design(params):
    """Verilog of gyro_board from a state, that shows its registers at the end."""
    shows = [
        f'    $display("register {k} %0d", {locked_state.hierarchical_name(name)});'
        for k, name in enumerate(library.REGISTERS)
    ]
    return locked_state.from_state(board_recording.text(params)).replace(
        "\nendmodule", "\n".join(["", "final begin", *shows, "end", "", "endmodule"])
    )


def export(sim, rate_rad_s, folder):
    """Write the design, its tables and the present state of a locked `Simulation` for the comparators to `folder`."""
    locked_state.write_state(sim, rate_rad_s, folder)
    board_recording.write_roms(folder)
    (folder / DESIGN).write_text(_design(sim.params.fpga))
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
    version_arguments = {"gcc": ("-dumpfullversion",), "verilator": ("--version",), "iverilog": ("-V",)}
    version_by_tool = {}
    for name, arguments in version_arguments.items():
        path = shutil.which(name)
        version_output = subprocess.run([path, *arguments], capture_output=True, text=True).stdout if path else ""
        number = re.search(r"\d+(\.\d+)+", version_output)
        version_by_tool[name] = number[0] if number else None
    return version_by_tool


def _run_command(command, folder):
    completed_process = subprocess.run([str(part) for part in command], cwd=folder, capture_output=True, text=True)
    if completed_process.returncode:
        messages = (completed_process.stderr.strip() or completed_process.stdout.strip() or "no message").splitlines()
        error_line = next((line for line in messages if "error" in line.lower()), messages[-1])
        raise Missing(f"{Path(command[0]).name} failed: {error_line.strip()}")
    return completed_process.stdout


def _compiler():
    return tool(os.environ.get("CXX", "g++"))


def build_verilator(folder, flags=FLAGS):
    """The verilated firmware; returns its command."""
    verilator, make, _ = tool("verilator"), tool("make"), _compiler()
    _run_command(
        [verilator, "--cc", "--exe", "-O3", "--x-assign", "fast", "--x-initial", "fast", "--noassert", "-Wno-lint"]
        + [
            "-Wno-fatal",
            "--Mdir",
            "verilated",
            "--top-module",
            board_recording.MODULE,
            "-CFLAGS",
            f"-std=c++17 -I{SOURCES}",
        ]
        + [DESIGN, *library.sources(RTL), SOURCES / "verilator.cpp"],
        folder,
    )
    # OPT_FAST is -Os by default and comes after CFLAGS: an -O3 there would be undone
    fast = " ".join(flags)
    name = f"V{board_recording.MODULE}"
    _run_command([make, "-s", "-C", "verilated", "-f", f"{name}.mk", f"OPT_FAST={fast}", f"OPT_GLOBAL={fast}"], folder)
    return [str(folder / "verilated" / name)]


def build_icarus(folder):
    """The firmware under Icarus with the board as a VPI module; returns its command."""
    iverilog, vvp = tool("iverilog"), tool("vvp")
    header = Path(iverilog).resolve().parent.parent / "include" / "iverilog"
    _run_command(
        [_compiler(), "-std=c++17", *FLAGS, "-shared", "-fPIC", f"-I{header}", SOURCES / "vpi.cpp", "-o", "board.vpi"],
        folder,
    )
    # 2012 for the `final` block of the design alone
    _run_command(
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
    _run_command([cc, "-std=c99", *flags, f"-I{folder / 'model'}", "-c", *sources], objects)
    program = [SOURCES / "c_firmware.cpp", *sorted(objects.glob("*.o"))]
    _run_command(
        [cxx, "-std=c++17", *flags, f"-I{folder / 'model'}", f"-I{SOURCES}", *program, "-o", "c_firmware"], folder
    )
    return [str(folder / "c_firmware")]


def build_peak(folder):
    """The kernel that measures the peak of this CPU; returns its command."""
    folder.mkdir(parents=True, exist_ok=True)
    _run_command([tool("gcc"), *FLAGS, SOURCES / "peak.c", "-o", "peak"], folder)
    return [str(folder / "peak")]


BUILDERS = {"verilator": build_verilator, "icarus": build_icarus, "c": build_c}


# ---- run -------------------------------------------------------------------------------------------------------------


def run(name, command, folder, ticks):
    """Run a built comparator for `ticks` from the exported state; returns `Codes`."""
    files = {"state": folder / "state.bin", "ticks": ticks, "codes": folder / f"{name}.codes"}
    arguments = [f"+{key}={value}" for key, value in files.items()] if name == "icarus" else list(files.values())
    program_output = _run_command([*command, *arguments], folder)
    values = [line.split()[1:] for line in program_output.splitlines() if line.startswith("register ")]
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
    messages = []
    ticks = len(peer.drive)
    for name, have, want in (("drive", peer.drive, engine.drive), ("sense", peer.sense, engine.sense)):
        for k in np.flatnonzero(have != want[:ticks])[:1]:
            messages.append(f"{name} DAC, tick {k}: code {have[k]} instead of {want[k]}")
    # a conversion that is there when a frame begins is read in that frame, and the engine's next row shows it
    have, want = peer.adc[: len(engine.adc) - 1], engine.adc[1 : 1 + len(peer.adc)]
    for k, c in np.argwhere(have != want)[:1]:
        messages.append(f"ADC channel {c}, frame {k}: code {have[k, c]} instead of {want[k, c]}")
    if ticks == len(engine.drive):
        for name in [name for name, value in peer.registers.items() if value != engine.registers[name]][:1]:
            messages.append(f"register {name}: {peer.registers[name]} instead of {engine.registers[name]}")
        for k in np.flatnonzero(peer.plant != engine.plant)[:1]:
            messages.append(f"plant state {k}: {float(peer.plant[k]).hex()} instead of {float(engine.plant[k]).hex()}")
    return messages


def peak_pairs_per_s(command, rounds=20_000_000):
    """Multiply-add pairs of doubles per CPU second, not fused, in vectors, nothing waiting for anything."""
    return float(_run_command([*command, rounds], None))
