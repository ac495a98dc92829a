"""Mutation score of a bundle: what share of small faults in a design its vectors see.

    read, flatten        yosys, with the parameters of the case; registers as plain flip-flops, enables as multiplexers
    choose               `mutate -list`: evenly over the netlist, by seed; every fault switched on by one input
    run                  `aig`, 64 faults at a time: fault 0 (none) must pass, each fault to the first row that differs
    judge the survivors  `mutant_judge`: equivalent (proved), alive (a trace that shows it), or undecided

    score = killed / (mutants - equivalent)

Each run begins in the reset state of the sound design. Faults on clock pins are left out: vectors have one clock.
Source  docs/golden.md; yosys manual, `mutate`
"""

import json
import re
import shutil
import tempfile
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import benches, bundle, design_entry
from testbench.golden.mutation import aig, mutant_judge
from testbench.golden.mutation.miter import compact
from testbench.golden.ranges import ranges
from testbench.golden.stimulus import blocks
from testbench.storage.files import write_text
from testbench.tool import run_tool

COUNT, SEED = 150, 1
MOST_UNDECIDED = 0.02  # of the faults
MAX_COUNT = 10_000
SURPLUS = 3  # faults asked for per fault wanted: those on clock pins are dropped
SELECT = "gyro_mutant"
CLOCK_PINS = (" -port CLK", " -port clk")  # of cells, of the blocks in the whole design
TOOLS = mutant_judge.TOOLS


class Mutant(NamedTuple):
    """A fault: its number, the yosys options that make it, and where in the RTL it sits."""

    number: int
    options: str
    source: str


class Outcome(NamedTuple):
    """What became of the faults of a bundle; `survivors` are dictionaries, ready for JSON."""

    block: str
    case: str
    seed: int
    mutants: int
    killed: int
    equivalent: int
    undecided: int
    survivors: list

    @classmethod
    def from_verdicts(cls, block, case, seed, mutants, alive, verdicts):
        """From the faults tried, those that no vector killed, and the judge's verdicts on these."""
        survivors = [
            {"mutant": m.number, "fault": m.options, "source": m.source, **verdict._asdict()}
            for m, verdict in zip(alive, verdicts, strict=True)
        ]
        kinds = [s["verdict"] for s in survivors]
        unseen = kinds.count("equivalent"), kinds.count("undecided")
        return cls(block, case, seed, len(mutants), len(mutants) - len(alive), *unseen, survivors)

    @property
    def score(self):
        """Killed over those not proved equivalent; 1 when there is none."""
        real = self.mutants - self.equivalent
        return self.killed / real if real else 1.0

    @property
    def passed(self):
        """No fault is alive, and few are undecided: killed are all of which it is known that they can be."""
        alive = self.mutants - self.killed - self.equivalent - self.undecided
        return not alive and self.undecided <= MOST_UNDECIDED * self.mutants

    def to_dict(self):
        return {**self._asdict(), "score": self.score}

    def text(self):
        title = f"{self.block}/{self.case}: {self.mutants} mutants, seed {self.seed}: {self.killed} killed, "
        title += f"{self.equivalent} equivalent, {self.undecided} undecided; score {100 * self.score:.2f} %"
        rows = [f"  {s['verdict']}: {s['fault']} at {s['source']}: {s['why']}" for s in self.survivors]
        return "\n".join([title, *(row for row, s in zip(rows, self.survivors) if s["verdict"] != "equivalent")])


def sources(manifest, rtl):
    """Files of the design: parts first, the block last; raises FileError if one is missing."""
    stem = manifest["block"]
    source_paths = []
    for name in (*benches.PARTS.get(stem, ()), stem):
        path = Path(rtl).resolve() / f"{name}.v"
        if not path.is_file():
            raise FileError(f"{path}: no such file; the design of {stem} needs it")
        source_paths.append(path)
    return source_paths


def parameters(manifest):
    """[(name, width, raw bits)] of the case, and keys of its design."""
    case_parameters = [(name, 32, value) for name, value in design_entry.rtl_parameters(manifest)]
    for entry in manifest["params"]:
        width = sum(entry["fmt"])
        case_parameters.append((entry["name"], width, entry["raw"] & ((1 << width) - 1)))
    return case_parameters


def prepare(folder, manifest, files, work):
    """Write base.il: the design of the case, flat, with `$dff` and multiplexers alone."""
    stem = manifest["block"]
    for path in files:
        # this front end takes no text as a parameter from outside: the table's name is put in place of the empty one
        text = path.read_text()
        for rom in sorted((folder / "rom").glob("*.hex")) if (folder / "rom").is_dir() else ():
            text = text.replace('ROM_FILE = ""', f'ROM_FILE = "{rom.resolve()}"')
        (work / path.name).write_text(text)
    parameter_options = "".join(f" -chparam {name} {width}'h{raw:x}" for name, width, raw in parameters(manifest))
    *parts, top = (path.name for path in files)
    steps = [f"read_verilog {name}" for name in parts]
    steps += [
        f"read_verilog -defer {top}",
        f"hierarchy -check -top gyro_{stem}{parameter_options}",
        "proc; flatten; opt -nodffe -nosdff; memory -nomap -nordff; opt -full -nodffe -nosdff; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr t:$aldff t:$sdff t:$dffe t:$sdffe t:$sdffce",
        "rename -top mutable",
        "write_ilang base.il",
    ]
    run_tool(["yosys", "-q", "-p", "; ".join(steps)], work, f"{stem}: the design")


def choose(work, count, seed, what, module=""):
    """`count` faults of base.il, or of the cells of one of its modules; or all there are. None on a clock pin."""
    steps = f"read_ilang base.il; mutate -list {SURPLUS * count} -seed {seed} -o list.txt {module}"
    run_tool(["yosys", "-q", "-p", steps], work, what)
    mutants, chosen_options = [], set()
    for line in (work / "list.txt").read_text().splitlines():
        options = re.sub(r"^mutate | -(src|wire|wirebit) \S+", "", line).strip()
        if any(pin in options for pin in CLOCK_PINS) or options in chosen_options or f"-module {module}" not in options:
            continue
        chosen_options.add(options)
        source_locations = re.findall(r"-src (\S+)", line)
        mutants.append(Mutant(len(mutants) + 1, options, source_locations[-1] if source_locations else "?"))
        if len(mutants) == count:
            break
    return mutants


# ---- simulation ----------------------------------------------------------------------------------------------------


def ctrl_lines(mutants, bits):
    """Commands of yosys that build the faults in, each switched on by its number at the input SELECT."""
    lines = [f"mutate -ctrl {SELECT} {bits} {m.number} {m.options}" for m in mutants]
    return lines or [f"mutate -mode none -ctrl {SELECT} {bits} 1"]


def insert_faults(mutants, work, what, more=""):
    """`aig.Graph` of base.il with all faults in it; `more` are further steps of yosys after they are built in."""
    bits = max((m.number for m in mutants), default=1).bit_length()
    script = ["read_ilang base.il", *ctrl_lines(mutants, bits), f"{more}{aig.STEPS} design.aag"]
    (work / "mutants.ys").write_text("\n".join(script) + "\n")
    run_tool(["yosys", "-q", "mutants.ys"], work, what)
    return compact(aig.read(work / "design.aag"))


def simulate(folder, manifest, graph, numbers):
    """({number: first row that differs, or -1}, reset state); FileError if the design fails without a fault."""
    vectors = bundle.read(folder)
    input_columns = [(port["name"], port["width"]) for port in manifest["inputs"]]
    output_columns = [(f"r_{port['name']}", port["width"]) for port in manifest["registers"]]
    output_columns += [(f"o_{port['name']}", port["width"]) for port in manifest["outputs"]]
    stim = aig.expand_bits(vectors.stim, input_columns, graph.inputs, graph.in_count)
    exp, mask = (aig.expand_bits(rows, output_columns, graph.outputs, len(graph.out_literals)) for rows in vectors[2:4])
    reset = manifest["reset"]
    first, initial_state = aig.run(graph, stim, exp, mask, SELECT, [0, *numbers], reset["name"], reset["cycles"])
    if first[0] >= 0:
        what = f"{manifest['block']}/{manifest['case']}: the design differs from the bundle at row {first[0]}"
        raise FileError(f"{what}: a failing design has no score")
    return first, initial_state


def proven_register_ranges(manifest):
    """{port: (signed, lo, hi)} of the registers as the model is proven to keep them; empty for a foreign block."""
    stem, case = manifest["block"], manifest["case"]
    if "design" in manifest or stem not in blocks.BLOCKS or case not in blocks.BLOCKS[stem].cases:
        return {}
    return {f"r_{r.name}": (r.fmt.s == 1, *r.proven) for r in ranges.analyse_case(stem, case).registers if r.proven}


# ---- all together --------------------------------------------------------------------------------------------------


def score_bundle(folder, rtl, count=COUNT, seed=SEED, keep=None):
    """Outcome of a bundle for the design in the folder `rtl`.

    count  faults wanted; a small design may have fewer
    seed   of the choice, >= 0
    keep   folder for the intermediate files, or None
    Raises ConfigError for a bad number or a missing tool, FileError for a bad bundle, a missing or a failing design.
    """
    if not 1 <= count <= MAX_COUNT:
        raise ConfigError(f"count: {count} is outside 1 .. {MAX_COUNT} mutants")
    if not 0 <= seed < 1 << 31:
        raise ConfigError(f"seed: {seed} is outside 0 .. 2**31 - 1")
    for name in TOOLS:
        if shutil.which(name) is None:
            raise ConfigError(f"{name}: not installed; a mutation score needs {', '.join(TOOLS)}")
    folder = Path(folder)
    manifest = bundle.verify(folder)
    files = sources(manifest, rtl)
    what = f"{manifest['block']}/{manifest['case']}"
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(keep or temporary).resolve()
        work.mkdir(parents=True, exist_ok=True)
        prepare(folder, manifest, files, work)
        mutants = choose(work, count, seed, what)
        graph = insert_faults(mutants, work, what)
        first, initial_state = simulate(folder, manifest, graph, [m.number for m in mutants])
        alive = [m for m in mutants if first[m.number] < 0]
        fault_judge = mutant_judge.Judge(
            graph, SELECT, initial_state, manifest["block"], work, lambda: proven_register_ranges(manifest)
        )
        verdicts = [fault_judge.verdict(m.number) for m in alive]
    return Outcome.from_verdicts(manifest["block"], manifest["case"], seed, mutants, alive, verdicts)


def record(folder, outcome):
    """Write the outcome into the provenance of the bundle's manifest, which no hash covers."""
    path = Path(folder) / bundle.MANIFEST
    manifest = bundle.verify(folder)
    outcome_entries = {k: v for k, v in outcome.to_dict().items() if k not in ("block", "case")}
    manifest["provenance"]["mutation"] = outcome_entries
    write_text(path, json.dumps(manifest, indent=1, ensure_ascii=True) + "\n")
