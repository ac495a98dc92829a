"""Everything that shows that a design is right, one part after the other, with the time that each took: `make rtl`.

    bundles    every block and the whole design against their golden vectors, under Icarus and Verilator
    loop       the analog plant on the design's pins, every register compared at every edge
    proofs     the properties of blocks, by induction
    synthesis  both boards: no latch, no undriven net; ECP5 and iCE40 of the default one
    mutation   scores of the bundles, written into their manifests, and into OUT/mutation.json

    python -m testbench.golden.rtl_verification [PART ...] [--rtl DIR] [--out DIR] [--seconds S] [--count N]
                                                [--only BLOCK ..]

Exit code 0 if every part passed. Source  docs/rtl.md
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, design_bundle, export
from testbench.golden.bundles import scores as measured
from testbench.golden.loop import library
from testbench.golden.loop import run as loop
from testbench.golden.mutation import mutate, mutate_top
from testbench.golden.proofs import formal, synthesis
from testbench.golden.recording import recording
from testbench.golden.stimulus import blocks
from testbench.storage.files import write_text

SIMULATORS = ("icarus", "verilator")
COUNT, SEED = 150, 1
# The case of each block whose vectors are scored: that with the widest parameters, or the quickest times
SCORED = {
    "delay": "depth3",
    "references": "align2_retimed",
    "modulator": "dac20",
    "pi": "rate",
    # the limits of the default one are 22,000 frames from reset
    "frequency_tracker": "narrow",
    "spi_dac": "ad5791",
    # slow poles keep the codes of the default one far from their limits
    "digital_sid": "delay0",
    "lock_monitor": "quick",
    "fault_monitor": "quick",
    "sequencer": "quick",
}


def cpu_s():
    """Time of processors so far (s), of this process and of those that it has waited for."""
    return sum(os.times()[:4])


def echo(text):
    print(text, flush=True)


def bundles(rtl, out, options):
    """Export all bundles, then `make check` of each block under each simulator; True if all passed."""
    export.export("all", out)
    passed = True
    for stem in (*blocks.BLOCKS, "top"):
        for sim in SIMULATORS:
            began = time.perf_counter()
            command = ["make", "-C", out / stem, "check", f"SIM={sim}", f"RTL={rtl}"]
            process = subprocess.run(command, capture_output=True, text=True)
            output_lines = (process.stdout + process.stderr).splitlines()
            count = sum(line.startswith("PASS ") for line in output_lines)
            good = process.returncode == 0 and count == len(list((out / stem).glob("*/manifest.json")))
            echo(f"  {'PASS' if good else 'FAIL'} {stem}: {count} cases, {sim}, {time.perf_counter() - began:.1f} s")
            for line in () if good else output_lines[-8:]:
                echo(f"    {line}")
            passed &= good
    return passed


def check_loop(rtl, out, options):
    """The story around the design; True without a difference."""
    outcome = loop.run(loop.story(options.seconds), rtl)
    echo("  " + outcome.text().replace("\n", "\n  "))
    return outcome.difference is None


def proofs(rtl, out, options):
    """Every proof; True if all came off."""
    passed = True
    for stem, cases in formal.CASES.items():
        for case in cases:
            proof = formal.prove(stem, case, rtl)
            echo(f"  {proof.text()}")
            passed &= proof.proven
    return passed


def netlists(rtl, out, options):
    """Both boards, and both families; a refusal is raised."""
    for name in synthesis.BOARDS:
        echo(f"  {synthesis.synthesise(rtl, None, name).text()}")
    for family in synthesis.MAPPERS:
        echo(f"  {synthesis.synthesise(rtl, family).text()}")
    return True


def _score_block(stem, rtl, out, count):
    """(outcome, {case: hash of its vectors}, files of the design) of a block's bundle, noted in its manifest."""
    case = SCORED.get(stem, next(iter(blocks.BLOCKS[stem].cases)))
    folder = out / stem / case
    if not folder.is_dir():
        export.export(stem, out)
    outcome = mutate.score_bundle(folder, rtl, count, SEED)
    mutate.record(folder, outcome)
    manifest = bundle.verify(folder)
    return outcome, {case: measured.vectors(manifest)}, mutate.sources(manifest, rtl)


def _score_wiring(rtl, out, count):
    """As `_score_block`, of the wiring, over its recordings."""
    outcome = mutate_top.score_wiring(rtl, count=count)
    for case in mutate_top.CASES:
        if (out / design_bundle.STEM / case).is_dir():
            mutate.record(out / design_bundle.STEM / case, outcome)
    vectors = {case: recording.sha256(recording.load(case)) for case in mutate_top.CASES}
    return outcome, vectors, library.sources(rtl)


def scores(rtl, out, options):
    """Mutation score of a case of every block and of the wiring; True if all that are measured have passed."""
    stems, all_passed = [*blocks.BLOCKS, design_bundle.STEM], True
    for stem in options.only:
        if stem not in stems:
            raise ConfigError(f"--only: {stem!r} is not one of {', '.join(stems)}")
    entries = {e["block"]: e for e in measured.missing_scores(out)} if options.only else {}
    for stem in options.only or stems:
        began = cpu_s()
        outcome, vectors, files = (
            _score_wiring(rtl, out, options.count)
            if stem == design_bundle.STEM
            else _score_block(stem, rtl, out, options.count)
        )
        took = cpu_s() - began
        echo("  " + outcome.text().replace("\n", "\n  ") + f"; {took:.1f} s of CPU time")
        entries[stem] = measured.entry(outcome, vectors, measured.design(files), took)
        write_text(out / measured.MUTATION, json.dumps([entries[s] for s in stems if s in entries], indent=1) + "\n")
        all_passed &= outcome.passed
    return all_passed


PARTS = {"bundles": bundles, "loop": check_loop, "proofs": proofs, "synthesis": netlists, "mutation": scores}


def main(arguments=None):
    """Run the parts that are named, or all; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m testbench.golden.rtl_verification", description=__doc__.split("\n")[0]
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(PARTS)}; default: all")
    parser.add_argument("--rtl", type=Path, default=synthesis.RTL, help="folder of the design")
    parser.add_argument("--out", type=Path, default=Path("out/golden"), help="folder for the bundles")
    parser.add_argument("--seconds", type=float, default=loop.SECONDS, help="simulated seconds of the loop")
    parser.add_argument("--count", type=int, default=COUNT, help="mutants of each block")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="BLOCK", help="mutation: score only these; keep the other scores"
    )
    options = parser.parse_args(arguments)
    rtl, out = options.rtl.resolve(), options.out.resolve()
    try:
        invalid_parts = [name for name in options.parts if name not in PARTS]
        if invalid_parts:
            raise ConfigError(f"part: {invalid_parts[0]!r} is not one of {', '.join(PARTS)}")
        took = {}
        for name in options.parts or PARTS:
            echo(name)
            began, before = time.perf_counter(), cpu_s()
            passed = bool(PARTS[name](rtl, out, options))
            seconds = round(time.perf_counter() - began, 1)
            took[name] = {"passed": passed, "seconds": seconds, "cpu_s": round(cpu_s() - before, 1)}
            if not options.only:  # the time of one block is not that of all
                write_text(out / measured.TIMES, json.dumps(took, indent=1) + "\n")
            echo(f"  {'PASS' if passed else 'FAIL'} {name}: {took[name]['seconds']:.1f} s")
    except (ConfigError, FileError) as problem:
        print(f"gyro: {problem}", file=sys.stderr)
        return 2
    echo("")
    for name, part_result in took.items():
        echo(f"{'PASS' if part_result['passed'] else 'FAIL'}  {name:10}{part_result['seconds']:9.1f} s")
    echo(f"      {'all':10}{sum(part_result['seconds'] for part_result in took.values()):9.1f} s")
    return 0 if all(part_result["passed"] for part_result in took.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
