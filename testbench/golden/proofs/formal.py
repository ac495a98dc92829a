"""Properties of the reference RTL proven with the SAT solver of yosys: by induction, so for any number of clocks.

    rtl/formal/BLOCK.v   module prove_BLOCK: the properties, as labelled assertions over ports of the block
    proof                block and properties side by side, with the parameters of a golden case
    base case            no property fails within k clocks of reset
    induction step       k clocks without a failure from any state, reachable or not, are followed by another

Values are those of two-valued logic: a register without reset may begin at anything. The k that was needed is reported.
Source  docs/rtl.md; yosys manual, `sat -tempinduct`; Een, Sorensson 2003
"""

import re
import shutil
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import benches
from testbench.golden.stimulus import blocks
from testbench.tool import run_tool

# Block: cases whose parameters are proven, all with lo <= 0 <= hi
CASES = {
    "dds": ("default",),
    "modulator": ("dac16", "dac20", "dac16_frames1", "dac20_frames2", "narrow"),
    "pi": ("rate", "frequency"),
    "spi_dac": ("dac8811", "ad5791", "dac82002"),
    "spi_adc": ("default",),
    "sequencer": ("quick",),
}
FOLDER = "formal"
MAX_STEPS, TIMEOUT_S = 12, 300
TOP = "proof"


class Proof(NamedTuple):
    """Outcome for a block and case: `steps` of the induction that were needed, or in which the base case failed."""

    block: str
    case: str
    properties: tuple
    proven: bool
    steps: int
    why: str
    seconds: float

    def text(self):
        head = f"{self.block}/{self.case}: {len(self.properties)} properties"
        if self.proven:
            return f"PROVEN {head}, any number of clocks (induction over {self.steps}), {self.seconds:.1f} s"
        return f"FAIL {head}: {self.why}, {self.seconds:.1f} s"


def labels(text):
    """Names of the properties of a checker."""
    return tuple(re.findall(r"\b(\w+): assert\b", text))


def _ports(text):
    """[(name, width)] of the ports of a checker."""
    found = re.findall(r"^\s*input\s+wire\s+(?:signed\s+)?(?:\[(\d+):0\]\s*)?(\w+)", text, re.M)
    return [(name, int(high or 0) + 1) for high, name in found]


def _top(block, case, checker):
    """Verilog: the block and its properties, both with the parameters of the case, over free inputs."""
    given = [(name, fmt.width, raw & ((1 << fmt.width) - 1)) for name, raw, fmt in blocks.params_of(block, case)]
    known = set(re.findall(r"\bparameter\s+(?:signed\s+)?(?:\[\d+:0\]\s*)?(\w+)", checker))
    inputs = [("clk", 1), *((p.name, p.width) for p in block.columns)]
    found = [(name, p.width) for name, p in benches.results(block)]
    widths = dict(inputs + found)
    for name, width in _ports(checker):
        if widths.get(name) != width:
            raise FileError(f"{block.stem}: the properties speak of a port {name} of {width} bits; there is none")

    def instance(module, label, names, parameters):
        values = ", ".join(f".{name}({width}'h{raw:x})" for name, width, raw in parameters)
        ports = ", ".join(f".{name}({name})" for name in names)
        return f"    {module} #({values}) {label} ({ports});" if values else f"    {module} {label} ({ports});"

    ports = ", ".join(f"input wire [{width - 1}:0] {name}" for name, width in inputs)
    lines = [f"module {TOP} ({ports});", *(f"    wire [{width - 1}:0] {name};" for name, width in found)]
    lines.append(instance(block.module, "dut", widths, given))
    used = [name for name, _ in _ports(checker)]
    lines.append(instance(f"prove_{block.stem}", "properties", used, [g for g in given if g[0] in known]))
    return "\n".join([*lines, "endmodule"]) + "\n"


def prove(stem, case, rtl, only=None, steps=MAX_STEPS, base_only=False, folder=None):
    """`Proof` of a block of the design in folder `rtl`, whose properties stand in the folder formal there.

    only       names of the properties to prove; all if None
    steps      clocks of the longest induction
    base_only  look for a failure within `steps` clocks of reset alone: not proven, whatever the outcome
    Raises ConfigError for a missing tool or an unknown name, FileError for a missing file or what yosys says.
    """
    if shutil.which("yosys") is None:
        raise ConfigError("yosys: not installed; it holds the solver")
    if case not in CASES.get(stem, ()):
        raise ConfigError(f"{stem}/{case}: has no proof; known: {', '.join(CASES)}")
    rtl, block = Path(rtl).resolve(), blocks.BLOCKS[stem]
    paths = [rtl / f"{name}.v" for name in (*benches.PARTS.get(stem, ()), stem)] + [rtl / FOLDER / f"{stem}.v"]
    for path in paths:
        if not path.is_file():
            raise FileError(f"{path}: no such file; the proof of {stem} needs it")
    checker = paths[-1].read_text()
    properties = labels(checker)
    wanted = properties if only is None else tuple(only)
    for name in wanted:
        if name not in properties:
            raise ConfigError(f"{stem}: has no property {name}; known: {', '.join(properties)}")
    kept = re.sub(r"\b(\w+): assert\b", lambda m: m[0] if m[1] in wanted else f"{m[1]}: cover", checker)
    script = [
        *(f"read_verilog -defer {path}" for path in paths[:-1]),
        "read_verilog -formal checker.v",
        "read_verilog top.v",
        f"hierarchy -check -top {TOP}",
        "proc; flatten; memory_map; opt -nodffe -nosdff; check -assert",
        "chformal -cover -remove",
        f"sat -tempinduct{'-baseonly' if base_only else ''} -prove-asserts -set-assumes -maxsteps {steps} "
        f"-timeout {TIMEOUT_S} {TOP}",
    ]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="gyro-formal-") as temporary:
        work = Path(folder or temporary)
        (work / "checker.v").write_text(kept)
        (work / "top.v").write_text(_top(block, case, checker))
        (work / "proof.ys").write_text("\n".join(script) + "\n")
        said = run_tool(["yosys", "proof.ys"], work, f"{stem}/{case}")
    proven, reached, why = _verdict(said)
    return Proof(stem, case, wanted, proven, reached, why, time.perf_counter() - began)


def _verdict(said):
    """(proven, steps, why not) from what `sat` said."""
    reached = max(map(int, re.findall(r"\[(?:base case|induction step) (\d+)\]", said)), default=0)
    if "Induction step proven: SUCCESS!" in said:
        return True, reached, ""
    if "model found for base case: FAIL" in said:
        return False, reached, f"a property fails {reached} clocks after power-on"
    if "Timeout" in said or "timeout" in said:
        return False, reached, f"no answer within {TIMEOUT_S} s"
    return False, reached, f"no failure within {reached} clocks, and no proof"
