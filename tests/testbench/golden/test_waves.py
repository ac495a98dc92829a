"""Dumps of real simulators and broken files: what was in the design is what the columns hold, just before each edge."""

import shutil
import subprocess
from pathlib import Path

import pytest

from fpga_model.fixed import Fmt, bits, signed_bits
from testbench.errors import FileError
from testbench.golden.check import vcd_log
from testbench.golden.check.waves import Map, check, read_log, read_map

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"
REGISTERS = ("phase", "drive_sine", "sense_sine", "drive_ref", "sense_ref")


def needs(*tools):
    absent = [name for name in tools if shutil.which(name) is None]
    return pytest.mark.skipif(bool(absent), reason=f"not installed: {', '.join(absent)}")


# Hand-written dumps ---------------------------------------------------------------------------------------------------

# clk rises at 5, 15, 25, 35; q changes at the very instant of the edge, as registers without delay do
VCD = """$date today $end
$timescale 1 ns $end
$scope module tb $end
$var wire 1 ! clk $end
$var wire 1 " rst $end
$scope module dut $end
$var reg 4 # q [3:0] $end
$var real 64 $ level $end
$upscope $end
$upscope $end
$enddefinitions $end
#0
$dumpvars
0! 1" bx # r0.5 $
$end
#5
1!
b0 #
#10
0! 0"
#15
1!
b1 #
#20
0!
#25
1!
b1110 #
#30
0!
#35
1!
bz0 #
"""


def vcd(tmp_path, text=VCD):
    path = tmp_path / "a.vcd"
    path.write_text(text)
    return path


def asked(**more):
    return Map({"q": "tb.dut.q"}, "tb.clk", True, None, 0)._replace(**more)


def test_a_row_is_what_was_there_before_the_edge(tmp_path):
    found = read_log(vcd(tmp_path), asked(), {"q": signed_bits(4)})["q"]
    assert found.valid.tolist() == [False, True, True, True]
    assert found.values.tolist()[1:] == [0, 1, -2]


def test_reset_finds_row_0(tmp_path):
    found = read_log(vcd(tmp_path), asked(reset=("tb.rst", 1)), {"q": bits(4)})["q"]
    assert found.values.tolist() == [0, 1, 14]


def test_first_edge_and_the_falling_edge(tmp_path):
    found = read_log(vcd(tmp_path), asked(first_edge=2), {"q": bits(4)})["q"]
    assert found.values.tolist() == [1, 14]
    found = read_log(vcd(tmp_path), asked(rising=False), {"q": bits(4)})["q"]
    assert found.values.tolist() == [0, 1, 14]


def test_a_slice_of_a_signal(tmp_path):
    signals = asked(ports={"high": "tb.dut.q[3:1]", "low": "tb.dut.q[0]"})
    found = read_log(vcd(tmp_path), signals, {"high": signed_bits(3), "low": bits(1)})
    assert found["high"].values.tolist()[1:] == [0, 0, -1]
    assert found["low"].values.tolist()[1:] == [0, 1, 0]


def test_several_changes_of_the_clock_at_one_time_are_one(tmp_path):
    text = VCD.replace("#20\n0!\n", "#20\n0!\n1!\n0!\n")
    assert len(read_log(vcd(tmp_path, text), asked(), {"q": bits(4)})["q"].values) == 4


@pytest.mark.parametrize(
    ("text", "signals", "fmt", "said"),
    [
        ("nonsense", asked(), bits(4), "no $enddefinitions"),
        (VCD.replace("$var reg 4 #", "$var reg four #"), asked(), bits(4), "malformed $var"),
        (VCD.replace("#20", "#2"), asked(), bits(4), "is malformed or earlier"),
        (VCD.replace("b1110 #", "q1110 #"), asked(), bits(4), "not a VCD value"),
        (VCD + "b1", asked(), bits(4), "ends inside a value"),
        (VCD, asked(ports={"q": "tb.q"}), bits(4), "no signal tb.q; similar: tb.dut.q"),
        (VCD, asked(ports={"q": "tb.dut.level"}), bits(4), "is a real"),
        (VCD, asked(ports={"q": "tb.dut.q[5:2]"}), bits(4), "bit 5 of a signal of 4"),
        (VCD, asked(ports={"q": "tb.dut.q[0:3]"}), bits(4), "high bit 0 is below low bit 3"),
        (VCD, asked(), bits(5), "4 bits in the dump, 5 in the manifest"),
        (VCD, asked(clock="tb.dut.q"), bits(4), "the clock has 4 bits"),
        (VCD, asked(clock="tb.rst"), bits(4), "no rising edge"),
        (VCD, asked(clock=""), bits(4), "no clock.signal"),
        (VCD, asked(reset=("tb.rst", 0)), bits(4), "never 0 and later 1 at a clock edge"),
        (VCD, asked(first_edge=9), bits(4), "after the last clock edge"),
        (VCD, asked(ports={"z": "tb.dut.q"}), bits(4), "port z is not in the manifest"),
    ],
)
def test_a_broken_dump_or_map_is_one_clear_line(tmp_path, text, signals, fmt, said):
    with pytest.raises(FileError) as problem:
        read_log(vcd(tmp_path, text), signals, {"q": fmt})
    assert said in str(problem.value)


def test_csv_in_decimal_and_hex(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("row, q, code\n0,1,-3\n1,0xe,0x7fffd\n2,x,5\n")
    found = read_log(path, Map({"q": "q", "c": "code"}, "", True, None, 0), {"q": signed_bits(4), "c": Fmt(1, 18, 0)})
    assert found["q"].values.tolist()[:2] == [1, -2]
    assert found["q"].valid.tolist() == [True, True, False]
    assert found["c"].values.tolist() == [-3, -3, 5]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("q\n", "at least one row"),
        ("q,q\n1,1\n", "duplicate column q"),
        ("q,r\n1\n", "row 0: 1 cells"),
        ("r\n1\n", "no column q"),
        ("q\n1.5\n", "'1.5' is not an integer"),
        ("q\n16\n", "does not fit 4 bits"),
    ],
)
def test_a_broken_csv_is_one_clear_line(tmp_path, text, said):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(FileError) as problem:
        read_log(path, asked(ports={"q": "q"}), {"q": bits(4)})
    assert said in str(problem.value)


@pytest.mark.parametrize("name", ["a.vcd", "a.csv", "a.fst", "a.ghw", "a.txt"])
def test_a_missing_or_foreign_file_is_one_clear_line(tmp_path, name):
    with pytest.raises(FileError, match=name):
        read_log(tmp_path / name, asked(), {"q": bits(4)})


@pytest.mark.parametrize(
    ("first", "kind"),
    [(b"\0" + (329).to_bytes(8, "big"), ".fst"), (bytes([254]), ".fst"), (b"GHDLwave\n", ".ghw")],
)
def test_the_content_of_a_dump_decides_what_it_is(tmp_path, first, kind):
    path = tmp_path / "a.vcd"
    path.write_bytes(first + bytes(100))
    with pytest.raises(FileError, match=f"the content is that of a {kind} file; rename it"):
        read_log(path, asked(), {"q": bits(4)})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("$var reg 4 #", "$var reg 99999999 #", "port q: its signal has 99999999 bits, above the limit 4096"),
        ("#20", "#" + "9" * 5000, "is malformed or earlier"),
        ("b0 #", "b #", "a value without bits"),
        ("b0 #", "x" * 3_000_000, "a word has more than 65536 characters"),
        ("b0 #", "\udcff", "is not ASCII"),
    ],
)
def test_hostile_values_in_a_dump_are_one_line(tmp_path, old, new, said):
    path = tmp_path / "a.vcd"
    path.write_text(VCD.replace(old, new), errors="surrogateescape")
    with pytest.raises(FileError, match=said):
        read_log(path, asked(), {"q": bits(4)})


def test_a_dump_is_read_in_pieces(tmp_path, monkeypatch):
    whole = read_log(vcd(tmp_path), asked(), {"q": bits(4)})["q"]
    for size in (1, 7, 64):
        monkeypatch.setattr(vcd_log, "BLOCK_BYTES", size)
        found = read_log(vcd(tmp_path), asked(), {"q": bits(4)})["q"]
        assert found.values.tolist() == whole.values.tolist()


def test_a_damaged_fst_is_one_line(tmp_path):
    pytest.importorskip("pywellen")
    path = tmp_path / "a.fst"
    path.write_bytes(b"\0" + (329).to_bytes(8, "big") + bytes(400))
    with pytest.raises(FileError, match="is not a readable FST file"):
        read_log(path, asked(), {"q": bits(4)})


GOOD = 'schema = "gyro-map/1.0"\n[clock]\nsignal = "tb.clk"\n[ports]\nq = "tb.dut.q"\n'


def test_a_map_is_read(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(GOOD + '[reset]\nsignal = "tb.rst"\nactive = 0\n')
    assert read_map(path) == asked(reset=("tb.rst", 0))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD.replace("1.0", "9"), "schema"),
        ("x = 1\n" + GOOD, "key: 'x'"),
        ("first_edge = -1\n" + GOOD, "first_edge"),
        (GOOD.replace("[clock]", '[clock]\nedge = "up"'), "clock.edge"),
        (GOOD.replace("[clock]", "[clock]\nfoo = 1"), "clock key"),
        (GOOD + "[reset]\nactive = 1\n", "reset.signal"),
        (GOOD + '[reset]\nsignal = "r"\nactive = 2\n', "reset.active"),
        (GOOD.replace('q = "tb.dut.q"', ""), "ports"),
        ("[", "is not TOML"),
    ],
)
def test_a_broken_map_is_one_clear_line(tmp_path, text, said):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(FileError) as problem:
        read_map(path)
    assert said in str(problem.value)


# Real simulators, real designs ----------------------------------------------------------------------------------------


def run(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]} {done.stderr[-2000:]}"


def write_map(path, registers, prefix):
    ports = "".join([f'{name} = "{prefix}.{name_of}"\n' for name, name_of in registers.items()])
    path.write_text(
        f'schema = "gyro-map/1.0"\n[clock]\nsignal = "{prefix}.clk"\n[reset]\nsignal = "{prefix}.rst"\n[ports]\n{ports}'
    )
    return path


def icarus(folder, tmp_path, block, registers, change=("", ""), kind="vcd"):
    """Report on the RTL, changed in one place, under its own bench, whose dump a second top module asks for."""
    text = (RTL / f"{block}.v").read_text()
    assert change[0] in text
    (tmp_path / "dut.v").write_text(text.replace(*change, 1) if change[0] else text)
    dump = tmp_path / f"a.{kind}"
    (tmp_path / "dump.v").write_text(
        f'module dump; initial begin $dumpfile("{dump}"); $dumpvars(0, tb_{block}); end endmodule\n'
    )
    tops = ("-s", f"tb_{block}", "-s", "dump")
    program = str(tmp_path / "a.vvp")
    run(folder, "iverilog", "-g2005", "-I.", *tops, "-o", program, f"tb_{block}.v", *map(str, tmp_path.glob("d*.v")))
    run(folder, "vvp", "-n", program, *(["-fst"] if kind == "fst" else []))
    signals = write_map(tmp_path / "map.toml", {name: f"r_{name}" for name in registers}, f"tb_{block}.dut")
    return check(folder, dump, signals)


@needs("iverilog")
@pytest.mark.parametrize("kind", ["vcd", "fst"])
def test_the_reference_rtl_passes_from_its_dump(bundles, tmp_path, kind):
    if kind == "fst":
        pytest.importorskip("pywellen")
    report = icarus(bundles("dds") / "default", tmp_path, "dds", REGISTERS, kind=kind)
    assert report.passed, report.text()
    assert report.rows >= report.golden_rows - 1
    assert report.missing == ()


CASES = {
    "offset subtracted": ("dds", "default", "r_phase + off_sense_ref", "r_phase - off_sense_ref", "sign"),
    "word doubled": ("dds", "default", "r_phase + word", "r_phase + {word[46:0], 1'b0}", "gain"),
    "reset value": ("dds", "default", "r_sense_ref  <= {DDS_BITS{1'b0}}", "r_sense_ref  <= 48'd1", "reset"),
    "limit": ("pi", "rate", "(rounded > Y_HI) ? hi", "(rounded >= Y_HI) ? hi - 36'sd1", "limit"),
    "saturated value": ("pi", "rate", "(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi - 36'sd1", "limit"),
    "wraps": ("pi", "rate", "(rounded < Y_LO) ? lo : (rounded > Y_HI) ? hi : rounded", "rounded", "wrap"),
    "no rounding": ("pi", "odd", " + HALF_Y;", ";", "rounding"),
    "half down": ("pi", "rate", " + HALF_Y;", " + HALF_Y - 62'sd1;", "rounding"),
}
FAST = ("offset subtracted", "limit", "no rounding")


@needs("iverilog")
@pytest.mark.parametrize("name", [n if n in FAST else pytest.param(n, marks=pytest.mark.slow) for n in CASES])
def test_a_fault_in_real_rtl_is_named(bundles, tmp_path, name):
    block, case, old, new, cause = CASES[name]
    registers = REGISTERS if block == "dds" else ("prop", "acc", "y")
    report = icarus(bundles(block) / case, tmp_path, block, registers, (old, new))
    assert not report.passed
    assert report.diagnosis[0].cause == cause, report.text()


@needs("ghdl")
@pytest.mark.parametrize("kind", [pytest.param("vcd", marks=pytest.mark.slow), "fst", "ghw"])
def test_a_dump_of_ghdl_passes(bundles, tmp_path, kind):
    """With one map: GHDL leaves the top out of the paths of an FST, and only there."""
    if kind == "fst":
        pytest.importorskip("pywellen")
    folder, dump = bundles("dds") / "default", tmp_path / f"a.{kind}"
    work = ("--std=08", f"--workdir={tmp_path}")
    run(folder, "ghdl", "-a", *work, "params_pkg.vhd", str(RTL / "dds.vhd"), "tb_dds.vhd")
    run(folder, "ghdl", "-e", *work, "-o", str(tmp_path / "tb"), "tb_dds")
    run(folder, "ghdl", "-r", *work, "tb_dds", f"--{'wave' if kind == 'ghw' else kind}={dump}")
    signals = write_map(tmp_path / "map.toml", {name: f"r_{name}" for name in REGISTERS}, "tb_dds.given.dut")
    report = check(folder, dump, signals)
    assert report.passed, report.text()
    assert report.rows >= report.golden_rows - 1


@needs("verilator")
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["vcd", "fst"])
def test_a_dump_of_verilator_passes(bundles, tmp_path, kind):
    """With the map of any other simulator: TOP, which Verilator puts above, may be left out."""
    if kind == "fst":
        pytest.importorskip("pywellen")
    folder, dump = bundles("dds") / "default", tmp_path / f"a.{kind}"
    flags = ("-Wno-fatal", "-Wno-lint", "-Wno-style", "-I.", "--Mdir", str(tmp_path / "built"), "-o", "sim")
    trace = "--trace-fst" if kind == "fst" else "--trace"
    run(folder, "verilator", "--binary", "--timing", trace, f'-DVCD_FILE="{dump}"', *flags, "--top-module", "tb_dds",
        "tb_dds.v", str(RTL / "dds.v"))  # fmt: skip
    run(folder, str(tmp_path / "built" / "sim"))
    for prefix in ("tb_dds.dut", "TOP.tb_dds.dut"):
        signals = write_map(tmp_path / "map.toml", {name: f"r_{name}" for name in REGISTERS}, prefix)
        report = check(folder, dump, signals)
        assert report.passed, report.text()


NAMES = """`timescale 1ns/1ps
module part (input clk, input rst, output reg [3:0] \\q.a[0] , output reg \\b[1] , output reg [3:0] \\sp-ace );
    reg m [0:1];
    reg [0:0] one;
    genvar g;
    generate
        for (g = 0; g < 2; g = g + 1) begin : gen
            reg [1:0] r;
            always @(posedge clk) r <= rst ? 0 : r + 1 + g;
        end
    endgenerate
    always @(posedge clk) begin
        \\q.a[0] <= rst ? 0 : \\q.a[0] + 1;
        \\b[1] <= rst ? 0 : ~\\b[1] ;
        \\sp-ace <= rst ? 0 : \\sp-ace + 3;
        m[0] <= rst ? 0 : \\b[1] ;
        m[1] <= rst ? 0 : \\q.a[0] [1] ;
        one <= rst ? 0 : \\q.a[0] [2] ;
    end
endmodule
module tb;
    reg clk, rst;
    wire [3:0] q, s;
    wire b;
    part \\in.st-ance (clk, rst, q, b, s);
    initial begin
        $dumpfile("names.vcd");
        $dumpvars(0, tb, \\in.st-ance .m[0], \\in.st-ance .m[1]);
        clk = 0;
        rst = 1;
        repeat (2) begin #5 clk = 1; #5 clk = 0; end
        rst = 0;
        repeat (20) begin #5 clk = 1; #5 clk = 0; end
        $finish;
    end
endmodule
""".replace("\\\\", "\\")
ESCAPED = {"q.a[0]": 4, "sp-ace": 4, "gen[0].r": 2, "gen[1].r": 2, "m[0]": 1, "m[1]": 1, "one": 1}


@needs("iverilog")
@pytest.mark.parametrize("kind", ["vcd", "fst"])
def test_escaped_names_arrays_and_generate_blocks_are_found(tmp_path, kind):
    """Icarus writes the backslash of an escaped name, pywellen takes names apart: the map may have it or not."""
    if kind == "fst":
        pytest.importorskip("pywellen")
    (tmp_path / "a.v").write_text(NAMES)
    run(tmp_path, "iverilog", "-g2012", "-s", "tb", "-o", "a.vvp", "a.v")
    run(tmp_path, "vvp", "-n", "a.vvp", *(["-fst"] if kind == "fst" else []))
    dump = (tmp_path / "names.vcd").rename(tmp_path / f"a.{kind}")
    for slash in ("", "\\"):
        ports = {
            f"p{k}": f"tb.{slash}in.st-ance.{slash if name[0] in 'qs' else ''}{name}" for k, name in enumerate(ESCAPED)
        }
        fmts = {f"p{k}": bits(width) for k, width in enumerate(ESCAPED.values())}
        found = read_log(dump, Map(ports, "tb.clk", True, ("tb.rst", 1), 0), fmts)
        got = dict(zip(ESCAPED, (column.values.tolist() for column in found.values())))
        n = range(len(got["one"]))
        assert len(n) == 20
        assert got["q.a[0]"] == [k % 16 for k in n]
        assert got["sp-ace"] == [3 * k % 16 for k in n]
        assert got["gen[1].r"] == [2 * k % 4 for k in n]
        assert got["m[0]"] == [0, *[k % 2 for k in n][:-1]]
        assert got["m[1]"] == [0, *[k >> 1 & 1 for k in n][:-1]]
        assert got["one"] == [0, *[k >> 2 & 1 for k in n][:-1]]


def test_two_signals_of_one_name_are_not_guessed(tmp_path):
    text = VCD.replace("$var real 64 $ level $end", "$var reg 4 % \\q [3:0] $end")
    with pytest.raises(FileError, match=r"duplicate signal tb\.dut\.q"):
        read_log(vcd(tmp_path, text), asked(), {"q": bits(4)})
