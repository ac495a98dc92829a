"""Faults in designs of other architecture: first port and clock, by the command and by a bench that needs no Python."""

import math
import re
import shutil
import subprocess

import numpy as np
import pytest

from testbench.golden.bundles import bundle, wrap
from testbench.golden.check import rtl_run
from tests.testbench.golden.test_foreign import DESIGNED, DESIGNS, choice, installed

# Design: (file, text, other text, port that differs first, cause that is named; None: none is)
FAULTS = {
    "pi_core": (
        ("pi_core.sv", "62'sd8388608", "62'sd0", "y", "rounding"),
        ("pi_core.sv", "? HI : out_t", "? HI - 36'sd1 : out_t", "y", "limit"),
        ("pi_core.sv", "kp_e = KP * error_i", "kp_e = -KP * error_i", "y", "sign"),
    ),
    "dac_master": (
        ("dac_master.v", "? held[index]", "? held[0]", "sdin", None),
        ("dac_master.v", "(count == 1) pending", "(count == 2) pending", "ldac_n", "early"),
        ("dac_master.v", "count <= total; held", "count <= total - 1; held", "sdin", None),
        ("dac_master.v", "load_n <= 1; end\n    else if", "load_n <= 0; end\n    else if", "ldac_n", "reset"),
    ),
    "dds_piped": (
        ("dds_piped.v", "phase + offsets[143:96]", "phase - offsets[143:96]", "sense_sine", "sign"),
        ("dds_piped.v", "phase + offsets[47:0]", "phase + offsets[95:48]", "sense_ref", "operand"),
        ("dds_piped.v", "phase + increment", "phase + increment + 48'd1", "drive_sine", "constant"),
    ),
    "cordic_unrolled": (
        ("cordic_unrolled.sv", "x[STEPS] + 35'sd128", "x[STEPS] + 35'sd0", "magnitude", "rounding"),
        ("cordic_unrolled.sv", "re < 0 ? 32'sh80000000", "re < 0 ? 32'sh40000000", "phase", None),
        ("cordic_unrolled.sv", "wait_clocks <= 5'd25", "wait_clocks <= 5'd24", "magnitude", None),
        ("cordic_unrolled.sv", "a[STEPS] + 32'sd128", "a[STEPS] + 32'sd0", "phase", "rounding"),
    ),
    "modulator_vhdl": (
        ("dsp/rounding.vhd", "half(shift - 1) := '1'", "half(shift - 1) := '0'", "out", "rounding"),
        ("dsp/rounding.vhd", "return hi;", "return hi - 1;", "out", "limit"),
        ("modulator_core.vhd", "codes(0), codes(1));", "codes(1), codes(0));", "out", "early"),
        ("dsp/multiplier.vhd", "p <= a * b", "p <= a * (-b)", "out", None),
    ),
}
ALL = [(name, k) for name, faults in FAULTS.items() for k in range(len(faults))]


def test_three_faults_of_each_design():
    assert set(FAULTS) == set(DESIGNED)
    assert min(map(len, FAULTS.values())) >= 3


def column(golden, name):
    """Rows of an input, or of a register, of a bundle."""
    names = [p["name"] for p in golden.manifest["inputs"]]
    if name in names:
        return golden.stim[:, names.index(name)]
    return golden.exp[:, [p["name"] for p in golden.manifest["registers"]].index(name)]


def rate_clock(golden, half, above):
    """First clock at which y differs if `half` is added before the shift, and `above` is taken beyond hi."""
    params = {p["name"]: p["raw"] for p in golden.manifest["params"]}
    total = (column(golden, "prop") + column(golden, "acc") + half) >> 24
    word = np.where(total > params["hi"], params["hi"] + above, np.maximum(total, params["lo"]))
    wrong = np.where(column(golden, "rst") == 1, 0, word)[:-1]
    return 1 + int(np.flatnonzero(wrong != column(golden, "y")[1:])[0])


def phase_clock(golden, port, offset, factor):
    """First clock at which an output of the DDS differs that adds another offset, in a design one clock later."""
    wrong = (column(golden, "phase") + factor * column(golden, offset)) % (1 << 48)
    reset = column(golden, "rst")
    differs = (wrong[:-1] != column(golden, port)[1:]) & (reset[:-1] == 0) & (reset[1:] == 0)
    return 2 + int(np.flatnonzero(differs)[0])


# Clocks from the rows of the bundle and the fault alone
CLOCKS = {
    ("pi_core", 0): lambda golden: rate_clock(golden, 0, 0),
    ("pi_core", 1): lambda golden: rate_clock(golden, 1 << 23, -1),
    ("dds_piped", 0): lambda golden: phase_clock(golden, "sense_sine", "off_sense_sine", -1),
    ("dds_piped", 1): lambda golden: phase_clock(golden, "sense_ref", "off_drive_ref", 1),
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "k"), ALL)
def test_a_fault_is_found_at_its_port_and_clock(bundles, tmp_path, name, k):
    case, level, listed, *_ = DESIGNED[name]
    stem, _, case = case.partition("/")
    file, old, new, port, cause = FAULTS[name][k]
    sim = "ghdl" if file.endswith("vhd") else "icarus"
    installed(sim)
    own, out = tmp_path / name, tmp_path / "w"
    shutil.copytree(DESIGNS / name, own)
    text = (own / file).read_text()
    assert text.count(old) == 1
    (own / file).write_text(text.replace(old, new))
    folder = bundles(stem) / case
    found = rtl_run.check(folder, own, choice=choice(name, level, listed, tmp_path)).to_dict()
    assert (found["passed"], found["first"]["name"]) == (False, port)
    assert found["first"]["kind"] == level[:-1]
    assert [entry["cause"] for entry in found["diagnosis"][:1]] == ([cause] if cause else [])
    if (name, k) in CLOCKS:
        assert found["first"]["clock"] == CLOCKS[name, k](bundle.read(folder))
    late = own / "latency.toml"
    wrap.wrap(folder, own / "map.toml", level, out, late if late.is_file() else None)
    top = listed or f"{name}{'.sv' if (own / f'{name}.sv').is_file() else '.v'}"
    goals = ["make", "-s", "-C", str(out), "check", f"SIM={sim}", f"RTL={own}", f"FILES={top}"]
    done = subprocess.run(goals, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2, done.stdout
    row, first = re.search(r"^row (\d+): [ro]_(\w+): expected", done.stdout, re.M).groups()
    assert (int(row), first) == (found["first"]["clock"], port), done.stdout


def test_half_an_lsb_less_is_no_fault_of_the_cordic():
    """127 for 128 before the shift by 8 shows at a low byte of 128 alone: every angle is odd, a sum of 24 angles
    whose own sum is odd, plus or minus each."""
    words = [round(math.atan(2.0**-i) / math.tau * 2**32) for i in range(24)]
    assert sum(words) % 2 == 1
    for seed in range(100):
        rng = np.random.default_rng(seed)
        angle = int(rng.integers(2)) * 2**31 + sum(int(rng.choice((-1, 1))) * word for word in words)
        assert (angle + 128) >> 8 == (angle + 127) >> 8
