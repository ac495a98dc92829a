"""Properties of a design proven with the SAT solvers of yosys, for any number of clocks: by induction, else by PDR.

    rtl/formal/BLOCK.v   module prove_BLOCK: the properties, as labelled assertions over ports of the block
    proof                design and properties side by side, with the parameters of a golden case
    level                ports that it does not judge are free inputs; what depends on one is not proven
    base case            no property fails within k clocks of reset
    induction step       k clocks without a failure from any state, reachable or not, are followed by another
    PDR                  of what no induction proves: an invariant, or a failure later than k clocks from reset

Values are those of two-valued logic: a register without reset may begin at anything. The k that was needed is reported.
An asynchronous reset counts from the edge on: a proof has no instants between edges.
Source  docs/rtl.md; yosys manual, `sat -tempinduct`; Een, Sorensson 2003; Een, Mishchenko, Brayton, FMCAD 2011 (PDR)
"""

import re
import shutil
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import design_entry
from testbench.golden.bundles.benches import layout
from testbench.golden.foreign import adapter, design_map, rtl_sources
from testbench.golden.foreign.choice import AS_OURS
from testbench.golden.stimulus import blocks, levels
from testbench.tool import run_tool

# Block: cases whose parameters are proven, all with lo <= 0 <= hi
CASES = {
    "dds": ("default",),
    "modulator": ("dac16", "dac20", "dac16_frames1", "dac20_frames2", "narrow"),
    "pi": ("rate", "frequency"),
    "spi_dac": ("dac8811", "ad5791", "dac82002"),
    "spi_adc": ("default",),
    "spi_slave": ("default",),
    "axi_slave": ("default",),
    "registers": ("default",),
    "host_bus": ("default", "narrow"),
    "sequencer": ("quick",),
}
PROPERTIES = Path(__file__).resolve().parents[2] / "rtl" / "formal"
MAX_STEPS, TIMEOUT_S = 12, 300
AIGER = "techmap; opt_clean; dffunmap; setundef -undriven -anyseq; aigmap; opt_clean; write_aiger -zinit proof.aig"
INVARIANT = f"read_aiger proof.aig; fold; scorr; pdr -T {TIMEOUT_S}"
TOP = "proof"
SYNC_RESET = """(* techmap_celltype = "$adff" *)
module sync_reset #(parameter WIDTH = 1, CLK_POLARITY = 1, ARST_POLARITY = 1, ARST_VALUE = 0) (
    input CLK, ARST, input [WIDTH-1:0] D, output [WIDTH-1:0] Q
);
    wire [WIDTH-1:0] next = ARST == ARST_POLARITY ? ARST_VALUE : D;
    \\$dff #(.WIDTH(WIDTH), .CLK_POLARITY(CLK_POLARITY)) _TECHMAP_REPLACE_ (.CLK(CLK), .D(next), .Q(Q));
endmodule
"""


class Proof(NamedTuple):
    """Outcome for a block and case: `steps` of the induction that were needed, or in which the base case failed.

    properties  those that were tried;  unseen  those that speak of ports that the level does not judge
    invariant   those that PDR has proven
    """

    block: str
    case: str
    properties: tuple
    proven: bool
    steps: int
    why: str
    seconds: float
    level: str = "registers"
    unseen: tuple = ()
    invariant: tuple = ()

    def text(self):
        count = f"{len(self.properties)} properties"
        if self.unseen:
            count = f"{len(self.properties)} of {len(self.properties) + len(self.unseen)} properties"
        head = f"{self.block}/{self.case}: {count}{f' at level {self.level}' * (self.level != 'registers')}"
        if self.proven:
            pdr_text = f"; PDR: {', '.join(self.invariant)}" if self.invariant else ""
            return f"PROVEN {head}, any number of clocks (induction over {self.steps}{pdr_text}), {self.seconds:.1f} s"
        return f"FAIL {head}: {self.why}, {self.seconds:.1f} s"


def labels(text):
    """Names of the properties of a checker."""
    return tuple(re.findall(r"\b(\w+): assert\b", text))


def _checker_ports(text):
    """[(name, width)] of the ports of a checker."""
    port_matches = re.findall(r"^\s*input\s+wire\s+(?:signed\s+)?(?:\[(\d+):0\]\s*)?(\w+)", text, re.M)
    return [(name, int(high or 0) + 1) for high, name in port_matches]


class _Design(NamedTuple):
    """What is proven: sources, ports that the level judges, and a wrapper (module, text) if the names are its own."""

    sources: rtl_sources.Sources
    ports: tuple
    module: str
    wrapper: str


def _design(block, case, rtl, choice):
    """`_Design` in a folder; FileError or ConfigError with one line."""
    level = choice.level or "registers"
    manifest = {"block": block.stem, "case": case, **design_entry.interface(block, case), "sha256": {}}
    ports = tuple(name for name, _ in levels.compared_ports(manifest, level))
    port_map = None
    if choice.map is not None or choice.top is not None:
        port_map = design_map.read(choice.map, manifest, level, choice.top)
        if port_map.style == "none":
            raise ConfigError(f"{choice.map}: reset.style: 'none' is not allowed: the induction begins with a reset")
    if choice.files is not None:
        candidate_sources = [rtl_sources.read_source_list(choice.files)]
    else:
        candidate_sources = rtl_sources.folder_sources(rtl, block.stem) or (
            rtl_sources.folder_sources(rtl, port_map.top) if port_map else []
        )
    candidate_sources = [source_set for source_set in candidate_sources if source_set.language == "verilog"]
    if not candidate_sources:
        raise FileError(f"{choice.files or rtl}: no {block.stem}.v or .sv; a proof reads Verilog")
    if port_map is None:
        return _Design(candidate_sources[0], ports, block.module, "")
    return _Design(candidate_sources[0], ports, adapter.adapter_name(manifest), adapter.verilog(manifest, port_map))


def _top(block, case, checker, design):
    """Verilog: design and properties, both with the parameters of the case, over free inputs."""
    settings = [(name, fmt.width, raw & ((1 << fmt.width) - 1)) for name, raw, fmt in layout.set_params(block, case)]
    declared = set(re.findall(r"\bparameter\s+(?:signed\s+)?(?:\[\d+:0\]\s*)?(\w+)", checker))
    inputs = [("clk", 1), *((p.name, p.width) for p in block.columns)]
    result_ports = [(name, p.width) for name, p in layout.result_port_pairs(block)]
    widths = dict(inputs + result_ports)
    for name, width in _checker_ports(checker):
        if widths.get(name) != width:
            raise FileError(f"{block.stem}: the properties need a port {name} of {width} bits, which is missing")

    def instance_text(module, label, names, parameters):
        values = ", ".join(f".{name}({width}'h{raw:x})" for name, width, raw in parameters)
        ports = ", ".join(f".{name}({name})" for name in names)
        return f"    {module} #({values}) {label} ({ports});" if values else f"    {module} {label} ({ports});"

    unseen = [(name, width) for name, width in result_ports if name not in design.ports]
    ports = ", ".join(f"input wire [{width - 1}:0] {name}" for name, width in inputs + unseen)
    lines = [f"module {TOP} ({ports});"]
    lines += [f"    wire [{width - 1}:0] {name};" for name, width in result_ports if name in design.ports]
    lines.append(instance_text(design.module, "dut", [name for name, _ in inputs] + list(design.ports), settings))
    used = [name for name, _ in _checker_ports(checker)]
    lines.append(instance_text(f"prove_{block.stem}", "properties", used, [g for g in settings if g[0] in declared]))
    return "\n".join([*lines, "endmodule"]) + "\n", [name for name, _ in unseen]


def _script(design, unseen, proof_command):
    """Commands for yosys: read, flatten, take out what speaks of an unseen port, prove."""
    source = design.sources
    options = "".join(f" -I{folder}" for folder in source.includes) + "".join(f" -D{macro}" for macro in source.defines)
    lines = [f"read_verilog -defer{' -sv' * (path.suffix == '.sv')}{options} {path}" for path in source.files]
    lines += ["read_verilog -defer wrapper.v"] if design.wrapper else []
    lines += [
        "read_verilog -formal checker.v",
        "read_verilog top.v",
        f"hierarchy -check -top {TOP}",
        "proc; flatten",
        *(f"chformal -assert -remove i:{name} %co*" for name in unseen),
        "tee -q -o tried.txt select -list t:$assert",
        "techmap -map sync_reset.v; memory_map; opt -nodffe -nosdff; check -assert",
        "chformal -cover -remove",
    ]
    return [*lines, proof_command]


def prove(stem, case, rtl, only=None, steps=MAX_STEPS, base_only=False, folder=None, choice=AS_OURS):
    """`Proof` of a block of the design in folder `rtl`.

    only       names of the properties to prove; all if None
    steps      clocks of the longest induction
    base_only  look for a failure within `steps` clocks of reset alone: not proven, whatever the outcome
    choice     level, files, top and map of a design that was not written from ours
    Raises ConfigError for a missing tool or an unknown name, FileError for a missing file or what yosys says.
    """
    if shutil.which("yosys") is None:
        raise ConfigError("yosys: not installed; the proofs need its solver")
    if case not in CASES.get(stem, ()):
        raise ConfigError(f"{stem}/{case}: has no proof; known: {', '.join(CASES)}")
    block, checker = blocks.BLOCKS[stem], (PROPERTIES / f"{stem}.v").read_text()
    design = _design(block, case, rtl, choice)
    properties = labels(checker)
    selected = properties if only is None else tuple(only)
    for name in selected:
        if name not in properties:
            raise ConfigError(f"{stem}: has no property {name}; known: {', '.join(properties)}")
    reduced = re.sub(r"\b(\w+): assert\b", lambda m: m[0] if m[1] in selected else f"{m[1]}: cover", checker)
    text, unseen = _top(block, case, checker, design)
    proof_command = (
        f"sat -tempinduct{'-baseonly' if base_only else ''} -prove-asserts -set-assumes -maxsteps {steps} "
        f"-timeout {TIMEOUT_S} {TOP}"
    )
    began, invariant = time.perf_counter(), ()
    with tempfile.TemporaryDirectory(prefix="gyro-formal-") as temporary:
        work = Path(folder or temporary)
        script = "\n".join(_script(design, unseen, proof_command)) + "\n"
        files = {"checker.v": reduced, "top.v": text, "wrapper.v": design.wrapper, "sync_reset.v": SYNC_RESET}
        for name, file_text in {**files, "proof.ys": script}.items():
            (work / name).write_text(file_text)
        yosys_log = _run_yosys(work, f"{rtl}: {stem}/{case}")
        tried = re.findall(r"properties\.(\w+)$", (work / "tried.txt").read_text(), re.M)
        tried = tuple(name for name in selected if name in tried)
        proven, reached, why = _verdict(yosys_log)
        if why.startswith("no failure") and not base_only and len(tried) == 1 and shutil.which("yosys-abc"):
            (work / "proof.ys").write_text("\n".join(_script(design, unseen, AIGER)) + "\n")
            _run_yosys(work, f"{rtl}: {stem}/{case}")
            proven, why = _invariant(work, why)
            invariant = tried * proven
    level = choice.level or "registers"
    if not tried:
        raise ConfigError(f"level: no property of {stem} uses only ports of level {level}")
    if why.startswith("no failure") and not base_only and len(tried) > 1:
        # the others may stand without it
        property_proofs = [prove(stem, case, rtl, [name], steps, choice=choice) for name in tried]
        proven, invariant = all(p.proven for p in property_proofs), sum((p.invariant for p in property_proofs), ())
        broken = next((p for p in property_proofs if p.why.startswith("a property fails")), None)
        open_ones = ", ".join(p.properties[0] for p in property_proofs if not p.proven)
        why = f"{why} of {open_ones}; all others are proven" if open_ones else ""
        why = f"{broken.why}: {broken.properties[0]}" if broken else why
    untried = tuple(name for name in selected if name not in tried)
    return Proof(stem, case, tried, proven, reached, why, time.perf_counter() - began, level, untried, invariant)


def _run_yosys(work, what):
    """What yosys says; FileError with its one line of error, or where it has cut a port of the design."""
    try:
        yosys_log = run_tool(["yosys", "proof.ys"], work, what)
    except FileError as problem:
        error_match = re.search(r".*ERROR: .*", str(problem))
        if error_match is None:
            raise
        raise FileError(f"{what}: yosys: {error_match[0].replace(f'{work}/', '')}") from None
    cut = re.search(r"Resizing cell port \w+\.\w+\.(\w+) from (\d+) bits to (\d+) bits", yosys_log)
    if cut:
        raise FileError(f"{what}: port {cut[1]} of the design has {cut[3]} bits, not {cut[2]}")
    return yosys_log


def _verdict(yosys_log):
    """(proven, steps, why not) from what `sat` said."""
    reached = max(map(int, re.findall(r"\[(?:base case|induction step) (\d+)\]", yosys_log)), default=0)
    if "Induction step proven: SUCCESS!" in yosys_log:
        return True, reached, ""
    if "model found for base case: FAIL" in yosys_log:
        return False, reached, f"a property fails {reached} clocks after power-on"
    if "Timeout" in yosys_log or "timeout" in yosys_log:
        return False, reached, f"no answer within {TIMEOUT_S} s"
    return False, reached, f"no failure within {reached} clocks, and no proof"


def _invariant(work, why):
    """(proven, why not) by property-directed reachability; `why` where it has no answer either."""
    abc_output = run_tool(["yosys-abc", "-c", INVARIANT], work, "proof")
    failure_match = re.search(r"asserted in frame (\d+)", abc_output)
    if failure_match:
        return False, f"a property fails {failure_match[1]} clocks after power-on"
    return ("Property proved" in abc_output, "" if "Property proved" in abc_output else why)
