"""First row and ports in which a design differs from its bundle, by a bench of the tests: nothing of the comparison.

The bench reads one file of values for each port of the bundle, drives just behind the falling edge, compares every port
just before the rising edge, and ends in the first row that differs. What is unknown differs. A register at the falling
edge reads what stood before it.
"""

import json
import subprocess
from pathlib import Path

from testbench.golden.bundles.design_entry import rtl_parameters


def text(manifest, folder, ports):
    """The bench, with a design `gyro_BLOCK`. `ports` are RTL ports with their widths."""
    given = [(p["name"], p["width"]) for p in manifest["inputs"]]
    unused = manifest.get("unused_params", ())
    values = [f".{name}({value})" for name, value in rtl_parameters(manifest)]
    for p in manifest["params"]:
        if p["name"] not in unused:
            width = sum(p["fmt"])
            sign = "s" * p["fmt"][0]
            values.append(f".{p['name']}({width}'{sign}h{p['raw'] % (1 << width):x})")
    values += [f'.ROM_FILE("{rom}")' for rom in sorted(Path(folder, "rom").glob("*.hex"))]
    held = "\n".join(f"reg [{w - 1}:0] m_{n} [0:{manifest['n'] - 1}]; reg [{w - 1}:0] s_{n};" for n, w in given)
    held += "\n".join(f"\nreg [{w - 1}:0] m_{n} [0:{manifest['n'] - 1}]; wire [{w - 1}:0] w_{n};" for n, w in ports)
    read = "\n".join(f'$readmemh("{folder}/ports/{n}.hex", m_{n});' for n, _ in [*given, *ports])
    first = " ".join(f"s_{n} = m_{n}[0];" for n, _ in given)
    drive = " ".join(f"s_{n} = m_{n}[k];" for n, _ in given)
    compare = "\n".join(f'if (w_{n} !== m_{n}[k]) begin $display("%0d {n}", k); bad = 1; end' for n, _ in ports)
    joined = ", ".join([f".{n}(s_{n})" for n, _ in given] + [f".{n}(w_{n})" for n, _ in ports])
    return f"""module first_row;
reg clk = 0;
integer k;
reg bad = 0;
{held}
gyro_{manifest["block"]} {f"#({', '.join(values)})" if values else ""} dut (.clk(clk), {joined});
initial begin
{read}
{first} s_rst = 1;
repeat ({manifest["reset"]["cycles"]}) begin #5 clk = 1; #5 clk = 0; end
for (k = 0; k < {manifest["n"]} && !bad; k = k + 1) begin
#1
{drive}
#4
{compare}
clk = 1; #5 clk = 0;
end
$finish;
end
endmodule
"""


def first(folder, design, level="registers"):
    """(row, {ports}) of the first difference, or (None, empty). `design` is a folder with the files of the design."""
    folder = Path(folder).resolve()
    manifest = json.loads((folder / "manifest.json").read_text())
    ports = [(f"r_{p['name']}", p["width"]) for p in manifest["registers"]]
    ports += [(f"o_{p['name']}", p["width"]) for p in manifest["outputs"]]
    if level != "registers":
        ports = [p for p in ports if p[0] in manifest["levels"][level]]
    bench = Path(design, "first_row.sv")
    bench.write_text(text(manifest, folder, ports))
    files = [str(path) for path in Path(design).glob("*.v")]
    built = str(bench.with_suffix(".vvp"))
    subprocess.run(["iverilog", "-g2012", "-s", "first_row", "-o", built, *files, str(bench)], check=True)
    bench.unlink()
    said = subprocess.run(["vvp", "-n", built], check=True, capture_output=True, text=True, timeout=120).stdout
    rows = [line.split() for line in said.splitlines() if line[:1].isdigit()]
    return (int(rows[0][0]) if rows else None), {name for _, name in rows}
