"""Small valid files of every kind, made here by formulas or by the project's own writers; none was measured."""

import shutil
import subprocess
from pathlib import Path

import numpy as np

from testbench import config
from testbench.golden.bundles import bundle
from testbench.storage import vcd
from tests.fuzz.hostile import toml
from tests.testbench.measured.parts import made, recordings
from tests.testbench.measured.quality import siblings
from tests.testbench.measured.quality.mapped import mapped

WRITTEN = Path(__file__).resolve().parents[1] / "data" / "written_by_0.1.0"

PORTS = {"inputs": [("rst", 1, 0), ("x", 5, 1)], "registers": [("y", 7, 1)], "outputs": [("z", 2, 0)]}
STIM = np.array([[1, 0], [1, 0], *([0, (3 * n) % 31 - 15] for n in range(14))])
EXP = np.array([[-64, 3], [63, 0], *([n - 7, n % 4] for n in range(14))])
MAP = {
    "schema": "gyro-map/1.0",
    "first_edge": 0,
    "clock": {"signal": "toy.clk_26m", "edge": "rising"},
    "reset": {"signal": "toy.rst", "active": 1},
    "ports": {"x": "toy.x", "y": "toy.y[6:0]", "z": "toy.z"},
}
LAB = {
    "name": "lab",
    "time": {"column": "t", "unit": "s", "power_on": 0.0},
    "columns": {
        "adc_xI": {"column": "a", "unit": "code"},
        "adc_xQ": {"column": "b", "unit": "V", "lsb_V": 1.0 / 4},
        "adc_yI": {"column": "c"},
        "adc_yQ": {"column": "d", "unit": "1"},
    },
    "set": {"plant.fx_hz": 11002.5},
    "profile": {"rate_dps": [[0.0, 10.0], [0.02, 20.0]], "temperature_degc": 25.0, "rate_shape": "linear"},
    "write": [{"at_s": 0.01, "a_um": 4.0}, {"at_s": 0.02, "name": "phase_sense_ref", "raw": 5}],
    "dwells": {"settle_s": 0.1, "longest_s": 0.1, "held_out": [1]},
    "power_on": [{"held_out": False}],
    "prior": [{"param": "plant.fx_hz", "mean": 11002.3, "sd": 0.5, "unit": "Hz"}],
}
VERILOG = """`timescale 1ns/1ps
module toy;
    reg clk_26m = 0, rst = 1; reg [4:0] x = 0; reg [6:0] y = 0; reg [1:0] z = 0; reg m [0:1]; real r = 0.5;
    always @(posedge clk_26m) begin x <= x + 3; y <= y - 1; z <= x[1:0]; m[0] <= z[0]; r = r + 1; end
    initial begin
        $dumpfile("toy.fst"); $dumpvars(0, toy);
        repeat (20) begin #5 clk_26m = 1; #5 clk_26m = 0; rst = 0; end
        $finish;
    end
endmodule
"""
VHDL = """library ieee; use ieee.std_logic_1164.all; use ieee.numeric_std.all;
entity toy is end;
architecture a of toy is
    type pair is record code : unsigned(2 downto 0); flag : boolean; end record;
    type many is array (0 to 1) of pair;
    signal clk_26m, rst : std_ulogic := '0'; signal x : unsigned(4 downto 0) := "00000"; signal n : integer := -1;
    signal y : signed(6 downto 0) := "0000000"; signal z : unsigned(1 downto 0) := "00"; signal of_pairs : many;
begin
    process begin
        for k in 0 to 9 loop
            rst <= '1' when k < 2 else '0';
            x <= x + 3; y <= y - 1; z <= x(1 downto 0); n <= n + k; of_pairs(k mod 2).code <= x(2 downto 0);
            wait for 5 ns; clk_26m <= '1'; wait for 5 ns; clk_26m <= '0';
        end loop;
        wait;
    end process;
end;
"""
CAMPAIGN = {
    "name": "small",
    "set": {"scenario.seconds": 0.05, "scenario.diagnose": False},
    "axes": {"rate": {"scenario.rate_dps": [0, 100]}, "part": {"plant.fx_hz": {"linspace": [11000.0, 11004.0, 3]}}},
    "keep": {"streams": {"rate_word": 8}, "statistics": {"rate_word": ["mean", "std"]}},
}
MEASURED = {
    "name": "small",
    "repeats": 2,
    "seed": 5,
    "set": {"plant.fx_hz": 11002.5},
    "condition": [
        {"id": "a", "rate_dps": 100.0, "seconds": 0.05, "settle_s": 0.025},
        {"id": "b", "rate_dps": -80.0, "a_um": 4.0, "seconds": 0.05, "role": "validate", "counter_s": 0.02},
    ],
    "prior": [{"param": "plant.fx_hz", "mean": 11002.3, "sd": 1.0, "unit": "Hz"}],
}
CONFIG = """[plant]
fx_hz = 11010.0
[effects]
laws = ["force_x = -2.5e9 x^3"]
[scenario]
seconds = 0.5
rate_dps = [[0.0, 0.0], [0.2, 100.0]]
register_writes = [[0.1, "phase_drive_sine", 5]]
faults = [[0.2, "adc_stuck", "drive_sin", 3, 0.1]]
"""
LAW = """schema = "gyrolaw/1.0"
name = "x_cubed"
laws = ["force_x = -2.5e9 x^3"]
sd = [1.2e7]
[provenance]
record = "a"
"""
ROOM = "room temperature (value not stated)"
PARTS = (
    "levels.mat", "driven.mat", "meters.csv", "rest.npz", "ring.txt", "spectrum.txt", "sweep.s2p", "paper.csv",
)  # fmt: skip
MAPPED = {
    "meters": "csv", "levels": "mat", "driven": "npz", "ringdown": "csv", "spectrum": "parquet", "sweep": "csv",
    "rest": "parquet",
}  # fmt: skip
PAPER = "quantity,symbol,case,temperature_C,value,std_or_max_fluctuation\n"


def port(name, width, signed):
    """Entry of a manifest."""
    fmt = [signed, width - signed, 0]
    return {
        "name": name,
        "width": width,
        "signed": bool(signed),
        "fmt": fmt,
        "reset": 0,
        "rounding": "",
        "overflow": "",
    }


def golden(folder):
    """A bundle of a block of two inputs, a register and an output."""
    ports = {key: [port(*item) for item in items] for key, items in PORTS.items()}
    manifest = {
        "schema": bundle.SCHEMA,
        "block": "toy",
        "case": "default",
        "clock": {"name": "clk", "hz": 26_000_000},
        "reset": {"name": "rst", "active": 1, "cycles": 2},
        "n": len(STIM),
        **ports,
        "latency": 1,
        "families": [["all", 0, len(STIM)]],
        "params": [],
        "rules": {},
        "provenance": {"version": "1"},
    }
    files = {
        "stim.hex": bundle.hex_text(bundle.pack(STIM, [1, 5]), 6),
        "exp.hex": bundle.hex_text(bundle.pack(EXP, [7, 2]), 9),
        "mask.hex": bundle.hex_text([0x1FF] * len(EXP), 9),
    }
    bundle.write(folder, manifest, files)


def dumps(folder):
    """toy.vcd, toy.csv, and where their simulators are installed toy.fst and toy.ghw."""
    listed = [vcd.Signal("rst", 1), vcd.Signal("x", 5, True), vcd.Signal("y", 7, True), vcd.Signal("z", 2)]
    rows = np.column_stack([STIM, EXP]).astype(np.int64)
    vcd.write_vcd(folder / "toy.vcd", rows, listed, top="toy")
    lines = ["rst,x,y,z", *(",".join(map(str, row)) for row in rows.tolist())]
    (folder / "toy.csv").write_text("\n".join(lines) + "\n")
    if shutil.which("iverilog"):
        (folder / "toy.v").write_text(VERILOG)
        _run(folder, "iverilog", "-g2005", "-o", "toy.vvp", "toy.v")
        _run(folder, "vvp", "-n", "toy.vvp", "-fst")
    if shutil.which("ghdl"):
        (folder / "toy.vhd").write_text(VHDL)
        _run(folder, "ghdl", "-a", "--std=08", "toy.vhd")
        _run(folder, "ghdl", "-e", "--std=08", "-o", "toy_vhdl", "toy")
        _run(folder, "ghdl", "-r", "--std=08", "toy", "--wave=toy.ghw")


def _run(folder, *command):
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=120)


def parts(folder):
    """Recordings of parts in their published formats."""
    rng = np.random.default_rng(1)
    made.levels(folder / "levels.mat", rng)
    made.meters(folder / "meters.csv", rng, {"a": lambda v, w: 0.0 * v, "b": lambda v, w: 0.01 * v * v}, points=80)
    made.rest(folder / "rest.npz", rng, samples=20_000)
    t = np.linspace(0, 60, 400)
    power = recordings.decay(t, 1e-2, 0.15, lambda p: 0.0, rng)
    recordings.ring(folder / "ring.txt", "S-1", 7, t, power)
    f = 1e6 + 0.5 * np.arange(400)
    line = 10 * np.log10(1e-9 / (1 + ((f - f[200]) / 4) ** 2) + 1e-12) + 0.1 * rng.normal(size=400)
    recordings.ring(folder / "spectrum.txt", "S-1", 8, f, line, "frequency [Hz]")
    f = 1e7 + np.arange(400) * 1.0
    s21 = recordings.swept(f, f[150], 60.0, 0.5, 0.01) + 1e-5 * (rng.normal(size=400) + 1j * rng.normal(size=400))
    recordings.touchstone(folder / "sweep.s2p", f, s21)
    n = 4096
    u = recordings.multisine(n, rng)
    y = np.convolve(u, np.exp(-np.arange(200) / 30) * np.sin(np.arange(200) / 5))[:n] + 1e-4 * rng.normal(size=n)
    recordings.matlab(folder / "driven.mat", u, y)
    values = [
        ("phi_xe1", "case 1"), ("phi_ye1", "case 3"), ("phi_xe2", "case 3"), ("phi_ye2", "case 4 (phi_ye2"),
        ("SF", "mean of cases"), ("SF", "case 3 vs case 4"), ("Vq", "case 3 vs case 4"), ("Vq", "mean of cases"),
        ("bias", "mean of cases"), ("bias", "case 3 vs case 4"), ("ARW", "mean of cases"), ("BI", "mean of cases"),
        ("SF nonlinearity", "mean"),
    ]  # fmt: skip
    rows = [f"q,{s},{c},{t},{0.3 + k / 7:.3f},std 0.1" for k, (s, c) in enumerate(values)
            for t in (("",) if s.startswith("phi") or "non" in s else ("-20", ROOM, "50"))]  # fmt: skip
    (folder / "paper.csv").write_text(PAPER + "\n".join(rows) + "\n")


def maps(folder):
    """Recordings of all kinds of parts as tables of anybody, with their column maps."""
    for kind, form in MAPPED.items():
        (folder / "maps" / kind).mkdir(parents=True)
        mapped(siblings.draw(kind, np.random.default_rng(8)), form, folder / "maps" / kind)


def make(folder):
    """All files in a folder; what is there already stays."""
    folder = Path(folder)
    if (folder / "done").exists():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("gyrorec.h5", "run.h5", "state.h5"):
        shutil.copy(WRITTEN / name, folder / name)
    shutil.copytree(WRITTEN / "store", folder / "store", dirs_exist_ok=True)
    golden(folder / "toy")
    dumps(folder)
    parts(folder)
    maps(folder)
    texts = {"config.toml": CONFIG, "law.toml": LAW, "whole.toml": config.to_toml(config.Config())}
    trees = {"campaign.toml": CAMPAIGN, "measured.toml": MEASURED, "map.toml": MAP, "lab.toml": LAB}
    for name, text in (texts | {name: toml(tree) for name, tree in trees.items()}).items():
        (folder / name).write_text(text)
    recording = Path(config.__file__).parents[1] / "golden" / "recording" / "recordings" / "reset.npz"
    shutil.copy(recording, folder / "reset.npz")
    np.savez(folder / "point.npz", a0=np.arange(5.0), a1=np.ones((2, 3)))
    rows = np.random.default_rng(5).integers(-3000, 3000, (400, 4)) * np.minimum(np.arange(400), 1)[:, None]
    table = np.column_stack([125e-6 * np.arange(400), rows])
    np.savetxt(folder / "lab.csv", table, ["%.6f", *["%d"] * 4], ",", header="t,a,b,c,d", comments="")
    (folder / "done").write_text("")
    return folder
