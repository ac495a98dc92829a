"""How often the diagnosis of the whole design is right: faults planted in its blocks, each in the loop until it shows.

    python -m tests.testbench.golden.top_score --rules first --per-rule 3 --seed 1

The faults are those of `diagnosis.rtl_faults` that change one statement, all in one build; the package of a difference
is that of `gyro golden loop --out`. Prints a line for each fault that is not named right, and a table of kinds. Exit
code 1 if a certain name is wrong. With --level pins the design shows its pins alone.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from fpga_model import wiring
from testbench.engines import chips
from testbench.golden import divergence
from testbench.golden.loop import library, run
from tests.testbench.golden import loop_faults, pin_tops
from tests.testbench.golden.diagnosis import rtl_faults, score
from tests.testbench.golden.loop_score import scenario

LEFT_OUT = ("notch", "digital_sid")  # not in the analog board


def planted(rules, per_rule, seed):
    """[(loop_faults.Fault, rtl_faults.Fault)], at most one to a line."""
    stems = [stem for stem in rtl_faults.CASES if stem not in LEFT_OUT]
    found, taken = [], set()
    for fault in rtl_faults.drawn(rules, per_rule, seed, stems):
        before, after = rtl_faults.source(fault.stem).splitlines(), fault.text.splitlines()
        lines = [k for k, (a, b) in enumerate(zip(before, after)) if a != b]
        if len(before) != len(after) or len(lines) != 1 or (fault.stem, lines[0]) in taken:
            continue
        for pattern in (loop_faults.STATEMENT, loop_faults.CONDITION):
            a, b = pattern.match(before[lines[0]]), pattern.match(after[lines[0]])
            if a and b and (a[1], a[3]) == (b[1], b[3]):
                taken.add((fault.stem, lines[0]))
                found.append((loop_faults.Fault(fault.kind, f"{fault.stem}.v", lines[0], a[2], b[2]), fault))
                break
    return found


def registers_of(fault):
    """Names that the registers and pins of a fault have in the whole design."""
    stems = {path: module.__name__.rpartition(".")[2] for path, module in wiring.nested_blocks(run.fpga.State)}
    paths = [path.replace(".", "_") for path, stem in stems.items() if stem == fault.stem]
    names = {f"{path}_{name}" for path in paths for name in fault.registers}
    return (
        names
        | {name.replace("_dac_", "_") for name in names}
        | ({"*"} & set(fault.registers))
        | {"refs"} & {name.rpartition("_")[2] for name in fault.registers if fault.stem == "references"}
    )


def judged(config, firmware, path, fault, folder, face=None, rtl="."):
    """`score.Judged` of the fault that is selected; `face` of a design that shows its pins alone."""
    with library.Design(path, face, rtl) as design:
        difference = run.run_lockstep(config, design, firmware).difference
    if difference is None:
        return score.Judged(fault, "not seen", [], 0.0)
    start = time.process_time()
    causes = list(divergence.write(folder, difference).diagnosis)
    named = fault._replace(registers=tuple(registers_of(fault)))
    return score.Judged(fault, score.verdict(named, causes), causes, time.process_time() - start)


def built(place, config, firmware, faults, level):
    """(folder, library, face or None) of a design with all faults."""
    if level == "registers":
        rtl = loop_faults.write_registers(place / "rtl", faults)
        return rtl, library.build(rtl, firmware, place / "built", 1), None
    rtl = loop_faults.write(place / "rtl", firmware, faults)
    face = library.pin_face(pin_tops.TOP, firmware, chips.parts(chips.dac_chips(config.design)))
    listed = library.user_sources(rtl, face.top, rtl / "all.f")
    return rtl, library.build(rtl, firmware, place / "built", 1, face, listed), face


def scored(rules, per_rule, seed, say, level="registers"):
    """[`score.Judged`] of the faults drawn; `say` is called with each."""
    config, firmware = scenario()
    faults, results = planted(rules, per_rule, seed), []
    with tempfile.TemporaryDirectory(prefix="gyro-score-") as place:
        rtl, path, face = built(Path(place), config, firmware, [of for of, _ in faults], level)
        for number, (_, fault) in enumerate(faults, 1):
            loop_faults.select(rtl, number)
            package = Path(place) / f"package{number}"
            results.append(judged(config, firmware, path, fault, package, face, rtl))
            say(results[-1])
    return results


def said(one):
    """Print a fault that is not named right."""
    if one.verdict != "right":
        f, text = one.fault, "; ".join(cause.text() for cause in one.causes[:2])
        print(f"{one.verdict}: {f.kind} ({f.cause}), {f.stem}, {f.edit!r}: {text}", flush=True)


def main(words):
    options = argparse.ArgumentParser()
    options.add_argument("--rules", default="first", choices=("first", "second"))
    options.add_argument("--per-rule", type=int, default=3)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--level", default="registers", choices=("pins", "registers"))
    given = options.parse_args(words)
    results = scored(getattr(rtl_faults, given.rules.upper()), given.per_rule, given.seed, said, given.level)
    print(score.table(results))
    print(f"longest package {max(one.cpu_s for one in results):.1f} s of CPU")
    return any(one.verdict == "wrong" for one in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
