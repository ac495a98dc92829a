"""Sealed records of a second plant: python -m tests.sealed bank|run|score|beside [--kind development] [--minutes M]

    bank    measures what effects do, in minutes, once for a second plant; prints what can be drawn in which stratum
    run     goes on where the run of this source was; every run is a line of tests/sealed/ledger.jsonl; --wide does the
            first records again with the priors of a data sheet
    score   opens the envelopes of what is done and prints the rates; --keep writes what was counted of a sealed run
            into tests/sealed/going.jsonl, so that another machine can go on; --page writes it into scored.jsonl, and
            the rates of a whole run, which a test makes again; its records are written into tests/sealed/published
    beside  for each false law of a data sheet in scored.jsonl, how many sigmas could have refused it

Source    docs/sealed.md
"""

import argparse
import json
import sys
import time
from pathlib import Path

from testbench.console.markdown import ROOT
from testbench.storage.files import write_text
from tests.sealed import again, draw, ledger, score, sheet_size, strata
from tests.sealed.bank import Bank, Space
from tests.sealed.records import Run, Tracing

SCORED, GOING = (Path(__file__).with_name(f"{name}.jsonl") for name in ("scored", "going"))


def counted(own, paths=(SCORED, GOING)):
    """{wide: {number: `score.Scored`}} of what has been kept of a run."""
    out = {False: {}, True: {}}
    for path in paths:
        line, *both = score.read(path.read_text()) if path.exists() else ({"run": ""}, [], [])
        same = {False: line["run"] == own["run"]}
        same[True] = same[False] and line["wide_sha256"] == own["wide_sha256"]
        for wide, rows in zip((False, True), both):
            out[wide] |= {r.number: r for r in rows if same[wide]}
    return out


def rows_of(run, sizes=None):
    """`score.Scored` of all records of a run that have a result.

    sizes  function that gives `sheet_size.sizes`: those that were traced from a data sheet
    """
    out, wide, left = [], sizes is not None, None
    for n in run.done(wide):
        if n in run.counted[wide]:
            out.append(run.counted[wide][n])
            continue
        envelope = run.path("envelopes", n).read_text()
        if wide and left is None:
            left = sizes()
        out.append(score.scored(n, envelope, json.loads(run.path(run.parts[wide], n).read_text()), left))
    return out


def play(run, first, minutes, path, wide=False):
    """Records without a result, in their order, until the time is over; the ledger has each as it comes.

    What another process is at is left to it: several may run at once.
    """
    until, of = time.monotonic() + 60 * minutes, min(first, len(run.kinds))
    ledger.noted(path, run)
    for n in range(of):
        if time.monotonic() > until:
            return
        with run.claimed(n) as mine:
            if not mine or n in run.done(wide):
                continue
            out = run.one(n, wide)
        ledger.noted(path, run)
        said = out.get("error") or out["result"]["sentence"]
        print(f"{n:03d} {out['cpu_s']} {said}", flush=True)


def choices(tables, space):
    """Markdown: what can be drawn in each stratum, between which d, beside which law."""
    lines = ["| stratum | effect | d | most similar law | sine |", "|---|---|---|---|---|"]
    for kind in (*strata.INSIDE, "outside"):
        for effect, low, high, rival in draw.choices(tables, space, kind):
            _, sine = space.rival(effect.name, [e.name for e in tables.inside])
            lines.append(f"| {kind} | {effect.name} | {low:.0f} .. {high:.0f} | {rival} | {sine:.3f} |")
    return "\n".join(lines)


def main(argv=None):
    """Exit code 0, or 1 where a limit of a whole run does not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=("bank", "run", "score", "beside"))
    parser.add_argument("--kind", choices=ledger.KINDS, default=ledger.SEALED)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "sealed")
    parser.add_argument("--first", type=int, default=10**6, help="only the first records of the order")
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no record later")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--kept", action="store_true", help="development: only effects whose column is in its file")
    parser.add_argument("--wide", action="store_true", help="trace again with the priors of a data sheet")
    parser.add_argument("--keep", action="store_true", help="write what was counted into tests/sealed/going.jsonl")
    parser.add_argument("--page", action="store_true", help="publish the run: the site shows its rates")
    given = parser.parse_args(argv)
    if given.kept and given.kind == ledger.SEALED:
        parser.error("--kept is for development: a sealed run draws from all effects")
    tables = strata.read()
    if given.what == "beside":
        rest = sheet_size.left(Bank(tables, given.out / "bank"), (*tables.inside, *tables.outside))
        print("\n".join(score.beside(score.read(SCORED.read_text())[2], rest)))
        return 0
    own = ledger.identity(given.kind, tables)
    if given.what != "score":
        bank = Bank(tables, given.out / "bank")
        effects = [e for e in (*tables.inside, *tables.outside) if not given.kept or bank.has(e)]
        space = Space(bank, effects, print)
    if given.what == "bank":
        print(choices(tables, space))
        return 0
    if given.what == "run":
        run = Run(tables, space, own, given.out, Tracing(given.threads), counted(own))
        first = min(given.first, tables.wide["records"]) if given.wide else given.first
        play(run, first, given.minutes, ledger.FILE, given.wide)
    run = Run(tables, None, own, given.out, counted=counted(own))
    rows, wide = rows_of(run), rows_of(run, lambda: sheet_size.sizes(Bank(tables, given.out / "bank"), tables.inside))
    text = score.table(rows, wide, tables.wide["disguises"], tables.effect["d"][0])
    print(text)
    print("\n".join(score.wrong(rows)))
    whole = given.kind == ledger.SEALED and len(rows) == len(run.kinds)
    if given.page and not whole:
        sys.exit(f"{own['run']}: {len(rows)} of {len(run.kinds)} records are done, or it is not sealed: no page")
    if given.page:
        again.write_run(run, again.FOLDER / f"{own['run']}.json")
    if (given.keep and given.kind == ledger.SEALED) or given.page:
        write_text(SCORED if given.page else GOING, score.kept(own, rows, wide))
    if given.page:
        GOING.unlink(missing_ok=True)
    return int(whole and any(holds is False for *_, holds in score.criteria(rows)))


if __name__ == "__main__":
    sys.exit(main())
