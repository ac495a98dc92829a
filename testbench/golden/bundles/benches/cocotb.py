"""cocotb test, its own runner, and the Verilog top that sets the parameters of the case.

Source  docs/golden.md (using a bench in your own flow)
"""

from testbench.golden.bundles.benches.layout import HALF_PS, PARTS, SHOWN, inputs_of, results
from testbench.golden.bundles.benches.verilog import instance, span


def cocotb_top(block, case):
    """The design with the case's parameters, as the top level of cocotb."""
    ports = ["    input wire clk", *(f"    input wire {span(p.width)}{n}" for n, p in inputs_of(block))]
    ports += [f"    output wire {span(p.width)}{n}" for n, p in results(block)]
    return f"""// {block.stem}/{case} with its parameters set
`timescale 1ps/1ps
module cocotb_{block.stem} (
{("," + chr(10)).join(ports)}
);
    `include "params.vh"

{instance(block, case, lambda name: name)}
endmodule
"""


def cocotb_test(block, case):
    """cocotb test (1.9 and 2) that is its own runner: RTL=folder SIM=icarus|verilator python3 test_<block>.py."""
    title, found = f"{block.stem}/{case}", results(block)
    return f'''"""cocotb test of {title}: RTL=folder SIM=icarus|verilator python3 test_{block.stem}.py."""

import json
import os
import sys
from pathlib import Path

BLOCK = "{block.stem}"
TITLE = "{title}"
HERE = Path(__file__).resolve().parent
SOURCES = {(*PARTS.get(block.stem, ()), block.stem)!r}
HALF_PS = {HALF_PS}

try:
    import cocotb
    from cocotb.triggers import Timer
except ImportError:
    sys.exit("cocotb is not installed: pip install cocotb")


def rows(name, ports):
    """Packed words of a hex file as one list of unsigned values per row."""
    for line in (HERE / name).read_text().split():
        word, values = int(line, 16), []
        for port in reversed(ports):
            values.append(word & ((1 << port["width"]) - 1))
            word >>= port["width"]
        yield values[::-1]


def differs(text, want, care):
    """Whether a compared bit is not what it should be; x and z never are."""
    if set(text) <= set("01"):
        return (int(text, 2) ^ want) & care != 0
    return any(care >> k & 1 and bit != str(want >> k & 1) for k, bit in enumerate(reversed(text)))


@cocotb.test()
async def golden(dut):
    manifest = json.loads((HERE / "manifest.json").read_text())
    inputs = manifest["inputs"]
    results = manifest["registers"] + manifest["outputs"]
    names = ["r_" + port["name"] for port in manifest["registers"]] + ["o_" + p["name"] for p in manifest["outputs"]]
    drive = [getattr(dut, port["name"]) for port in inputs]
    sense = [getattr(dut, name) for name in names]
    dut.clk.value = 0
    for pin in drive:
        pin.value = 0
    dut.rst.value = 1
    for _ in range(manifest["reset"]["cycles"]):
        await Timer(HALF_PS, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    wrong, first = 0, None
    vectors = zip(rows("stim.hex", inputs), rows("exp.hex", results), rows("mask.hex", results))
    for n, (stim, expected, mask) in enumerate(vectors):
        for pin, value in zip(drive, stim):
            pin.value = value
        await Timer(HALF_PS - 1, "ps")
        before = wrong
        for name, pin, want, care in zip(names, sense, expected, mask):
            text = str(pin.value)
            if differs(text, want, care):
                wrong = before + 1
                first = n if first is None else first
                if wrong <= {SHOWN}:
                    got = f"{{int(text, 2):x}} (hex)" if set(text) <= set("01") else f"{{text}} (binary)"
                    print(f"row {{n}}: {{name}}: expected {{want:x}}, got {{got}}", flush=True)
        await Timer(1, "ps")
        dut.clk.value = 1
        await Timer(HALF_PS, "ps")
        dut.clk.value = 0
    if wrong:
        print(f"FAIL {{TITLE}}: {{wrong}} of {{manifest['n']}} rows differ, the first is row {{first}}", flush=True)
    assert wrong == 0


def main():
    try:
        from cocotb_tools.runner import get_runner
    except ImportError:
        from cocotb.runner import get_runner
    rtl, sim = os.environ.get("RTL", ""), os.environ.get("SIM") or "icarus"
    if not rtl:
        print(f"NO DESIGN {{TITLE}}: no design was given")
        return
    sources = [Path(rtl).resolve() / f"{{stem}}.v" for stem in SOURCES]
    if not sources[-1].is_file():
        sys.exit(f"FAIL {{TITLE}}: no design {{sources[-1]}}")
    build = HERE / "build" / f"cocotb-{{sim}}"
    runner = get_runner(sim)
    top = f"cocotb_{{BLOCK}}"
    files = [HERE / f"{{top}}.v", *(path for path in sources if path.is_file())]
    more = ["-Wno-fatal", "-Wno-lint", "-Wno-style", "-CFLAGS", "-O0"] if sim == "verilator" else []
    runner.build(sources=files, includes=[HERE], hdl_toplevel=top, build_dir=build, build_args=more, always=True)
    (build / "results.xml").unlink(missing_ok=True)
    done = runner.test(hdl_toplevel=top, test_module=Path(__file__).stem, build_dir=build, test_dir=HERE,
                       results_xml=str(build / "results.xml"), extra_env={{"PYTHONDONTWRITEBYTECODE": "1"}})
    text = Path(done).read_text()
    if "<failure" in text or "<error" in text or "<testcase" not in text:
        sys.exit(1)
    print(f"PASS {{TITLE}}: {{sum(1 for _ in open(HERE / 'stim.hex'))}} rows, {len(found)} ports")


if __name__ == "__main__":
    main()
'''
