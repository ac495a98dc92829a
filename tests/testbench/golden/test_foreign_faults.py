"""Faults in designs of other architecture: first port and clock, by the command and by a bench that needs no Python."""

import math
import re
import shutil
import subprocess

import numpy as np
import pytest

from testbench.golden.bundles import adapted_bundle, bundle
from testbench.golden.check import rtl_run
from tests.testbench.golden.test_foreign import DESIGNED, DESIGNS, choice, installed

# Design: (file, text, other text, port that differs first, cause that is named; None: none is)
FAULTS = {
    "loop_filter": (
        ("loop_filter.sv", "62'sd8388608", "62'sd0", "y", "rounding"),
        ("loop_filter.sv", "wide_t'(limit(62'(acc_q) + 62'(i), LO, HI))", "acc_q + i", "y", "wrap"),
        ("gain_stage.sv", "wide_t'(KP) * wide_t'(err_i)", "wide_t'(KP) * $signed({1'b0, err_i})", "y", "signedness"),
    ),
    "dac_link": (
        ("dac_link.v", "NBITS - 5'd1 : index - sck", "5'd0 : index + sck", "sdin", "bit_order"),
        ("dac_link.v", "ahead == LAST + 1)", "ahead == LAST)", "ldac_n", "early"),
        ("dac_link.v", "<= 4'b1010", "<= 4'b1000", "ldac_n", "reset"),
        ("dac_link.v", "go ? tx_word : hold}", "tx_word}", "sdin", None),
    ),
    "nco": (
        ("nco.v", "tune_h + carry", "tune_h", "drive_sine", None),
        ("nco.v", "shifts[48*k +: 48]", "shifts[48*(k ^ (k == 3)) +: 48]", "sense_ref", "operand"),
        ("nco.v", "acc_l} + tune[23:0]", "acc_l} + tune[23:0] + 24'd1", "drive_sine", "constant"),
        ("half_adder48.v", "high + add_h + c", "high + add[47:24] + c", "drive_sine", None),
    ),
    "polar": (
        ("polar.v", "zs[24] + 32'd128", "zs[24]", "phase", "rounding"),
        ("rotation.v", "dy = (y + HALF)", "dy = y", "magnitude", "rounding"),
        ("include/atan.vh", "32'h051111d4", "32'h051111d5", "phase", "constant"),
        ("rotation.v", "v && !kill", "v", "magnitude", None),
    ),
    "amp_mod": (
        ("dsp/fx.vhd", "n - 1) + 1", "n - 1)", "out", "rounding"),
        ("dsp/fx.vhd", "return hi;", "return hi - 1;", "out", "limit"),
        ("amp_mod.vhd", "elsif out_ce", "elsif mul_ce", "out", "condition"),
        ("dsp/mult24x18.vhd", "signed('0' & a(16", "signed(a(16) & a(16", "out", None),
    ),
}
ALL = [(name, k) for name, faults in FAULTS.items() for k in range(len(faults))]


def test_three_faults_of_each_design():
    assert set(FAULTS) == set(DESIGNED)
    assert min(map(len, FAULTS.values())) >= 3


def column(golden, name):
    """Rows of an input, a register or a pin of a bundle."""
    names = [p["name"] for kind in ("inputs", "registers", "outputs") for p in golden.manifest[kind]]
    return np.column_stack([golden.stim, golden.exp])[:, names.index(name)]


def rate_clock(golden):
    """First clock at which y differs if half an LSB is not added before the shift, in a design one clock later."""
    params = {p["name"]: p["raw"] for p in golden.manifest["params"]}
    total = (column(golden, "prop") + column(golden, "acc")) >> 24
    wrong = np.where(column(golden, "rst") == 1, 0, np.clip(total, params["lo"], params["hi"]))[:-1]
    return 2 + int(np.flatnonzero(wrong != column(golden, "y")[1:])[0])


def phase_clock(golden, port, offset, carries):
    """First clock at which a phase differs with another offset, or without carries from bit 23 of the accumulator.

    In a design one clock later, in the longest part without a reset, from the state of reset on.
    """
    reset = np.flatnonzero(np.r_[1, column(golden, "rst"), 1])
    row = int(reset[np.argmax(np.diff(reset))])
    word, added, right = (column(golden, name).tolist() for name in ("word", offset, port))
    low, high, half = 0, 0, 1 << 24
    while ((high << 24) + low + added[row]) % half**2 == right[row + 1]:
        low, high = low + word[row] % half, high + word[row] // half
        low, high, row = low % half, (high + carries * (low // half)) % half, row + 1
    return row + 2


def bit_clock(golden):
    """First clock at which SDIN differs if the last bit of a word of 24 goes first."""
    load, word, right, sent = (column(golden, name).tolist() for name in ("load", "word", "sdin", "rst"))
    held = 0
    for row, bit in enumerate(right):
        if bit != held & 1:
            return row
        held = 0 if sent[row] else word[row] if load[row] else held >> 1
    return None


def angle_clock(golden):
    """First clock at which the phase of the CORDIC differs if half an LSB is not added."""
    done = np.flatnonzero((column(golden, "done") == 1) & (column(golden, "x") != 0))
    wrong = column(golden, "angle")[done] >> 8
    return int(done[np.flatnonzero(wrong != column(golden, "phase")[done])[0]])


def code_clock(golden, half, above):
    """First clock at which the output of the modulator, of two codes before, differs with another half or upper end."""
    params = {p["name"]: p["raw"] for p in golden.manifest["params"]}
    product, take, right, reset = (column(golden, name).tolist() for name in ("product", "en_code", "out", "rst"))
    codes = [0, 0, 0]
    for row, code in enumerate(right):
        if code != codes[2]:
            return row
        scaled = (product[row] + half * (1 << params["shift"] - 1)) >> params["shift"]
        new = params["hi"] + above if scaled > params["hi"] else max(scaled, params["lo"])
        codes = [0, 0, 0] if reset[row] else [new, *codes[:2]] if take[row] else codes
    return None


# Clocks from the rows of the bundle and the fault alone
CLOCKS = {
    ("loop_filter", 0): rate_clock,
    ("dac_link", 0): bit_clock,
    ("nco", 0): lambda golden: phase_clock(golden, "drive_sine", "off_drive_sine", 0),
    ("nco", 1): lambda golden: phase_clock(golden, "sense_ref", "off_drive_ref", 1),
    ("polar", 0): angle_clock,
    ("amp_mod", 0): lambda golden: code_clock(golden, 0, 0),
    ("amp_mod", 1): lambda golden: code_clock(golden, 1, -1),
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
    part = adapted_bundle.write_adapted_bundle(folder, own / "map.toml", level, out, late if late.is_file() else None)
    goals = ["make", "-s", "-C", str(out), "check", f"SIM={sim}", f"RTL={own}", f"FILES={listed or file}"]
    done = subprocess.run(goals, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2, done.stdout
    row, first = re.search(r"^row (\d+): [ro]_(\w+): expected", done.stdout, re.M).groups()
    assert (part.first + int(row), first) == (found["first"]["clock"], port), done.stdout


def test_half_an_lsb_less_is_no_fault_of_the_cordic():
    """127 for 128 before the shift by 8 shows at a low byte of 128 alone: every angle is odd, a sum of 24 angles
    whose own sum is odd, plus or minus each."""
    words = [round(math.atan(2.0**-i) / math.tau * 2**32) for i in range(24)]
    assert sum(words) % 2 == 1
    for seed in range(100):
        rng = np.random.default_rng(seed)
        angle = int(rng.integers(2)) * 2**31 + sum(int(rng.choice((-1, 1))) * word for word in words)
        assert (angle + 128) >> 8 == (angle + 127) >> 8
