"""Rates of random trials of tracing: python -m tests.testbench.measured.loop_rates 100 --keep trials.jsonl

Trials that the file lacks are run, one line of JSON each; the table of all is printed, and with --write stored in
docs/results/tracing_trials.json.
Source    docs/measured.md
"""

import argparse
import json
from pathlib import Path

import numpy as np

from testbench.console.markdown import markdown
from testbench.console.results import write_results
from testbench.console.text_table import Table
from testbench.measured.closed_loop import loop_runs
from testbench.tracing.noise.power import clopper_pearson
from tests.testbench.measured.loop_trials import KINDS, QUICK, Bank, kinds, trial

FLOOR_FACTOR = 1.06


def rate(k, n):
    """Text of k in n with its 95 % Clopper-Pearson interval."""
    low, high = clopper_pearson(k, n)
    return f"{k} of {n} [{100 * low:.0f} .. {100 * high:.0f} %]"


def pooled(trials):
    """(held-out rms after / floor over all rows of trials, its 95 % bootstrap over trials, the ratio of each row)."""
    ratios = [[(row[2] / row[0]) ** 2 for key, row in t["heldout"].items() if row[0]] for t in trials if t["heldout"]]
    rows = np.array([np.mean(r) for r in ratios])
    draws = rows[np.random.default_rng(1).integers(len(rows), size=(2000, len(rows)))].mean(axis=1)
    every = np.sqrt(np.concatenate(ratios))
    low, high = np.sqrt(np.quantile(draws, [0.025, 0.975]))
    return float(np.sqrt(rows.mean())), (float(low), float(high)), every


def pulls_of(trials):
    """(found - hidden) / sd of every law that was hidden and found."""
    out = []
    for t in trials:
        found = {law: (value, sd) for law, value, sd, _ in t["found"]}
        out += [(found[law][0] - value) / found[law][1] for law, value, _ in t["truth"] if law in found]
    return np.array(out)


def _named(t):
    return t["right"] and t["verdict"] == "named"


def false_effect(t):
    """True if a class does not hold what was hidden; where nothing was, if a law is listed at all."""
    return bool(t["found"]) if t["kind"] in ("none", "flicker") else t["false_name"]


def table(trials):
    """What was hidden and what the verdicts said, with 95 % Clopper-Pearson intervals."""
    heads = ("hidden", "right verdict", "detected", "named right, of detected", "false cause", "verdicts")
    rows = []
    for kind in KINDS:
        some = [t for t in trials if t["kind"] == kind]
        if some:
            seen = [t for t in some if t["detected"]]
            n, verdicts = len(some), [t["verdict"] for t in some]
            first = rate(sum(_named(t) for t in seen), len(seen)) if seen and kind in ("one", "two", "in") else ""
            said = ", ".join(f"{v} {verdicts.count(v)}" for v in sorted(set(verdicts)))
            false = rate(sum(false_effect(t) for t in some), n)
            rows.append((kind, rate(sum(t["right"] for t in some), n), rate(len(seen), n), first, false, said))
    sigma = np.array([t["numerical"] for t in trials if t["numerical"] is not None and t["kind"] != "out"])
    held = rate(int(np.sum(sigma < 0.5)), len(sigma))
    lines = [
        f"Numerical certificate, all but `out`: median {np.median(sigma):.2f} sigma, largest {sigma.max():.2f}, below "
        f"0.5 in {held}.",
    ]
    named = [t for t in trials if t["verdict"] == "named"]
    if named:
        middle, (low, high), every = pooled(named)
        below = rate(int(np.sum(every <= FLOOR_FACTOR)), len(every))
        lines.append(
            f"Held-out rms / floor where named: {middle:.3f} [{low:.3f} .. {high:.3f}] over {len(named)} trials; "
            f"single observables {np.median(every):.3f}, 90 % of them {np.quantile(every, 0.05):.3f} .. "
            f"{np.quantile(every, 0.95):.3f}, at most {FLOOR_FACTOR} in {below}."
        )
    pulls = pulls_of(trials)
    if len(pulls) > 1:
        inside = rate(int(np.sum(np.abs(pulls) < 1.96)), len(pulls))
        lines.append(
            f"Coefficients of what was hidden and found: (found - hidden) / sd has an sd of {pulls.std():.2f}; "
        )
        lines[-1] += f"95 % intervals hold {inside}."
    took = np.array([t["seconds"] for t in trials])
    lines.append(f"Seconds of a trial: median {np.median(took):.0f}, largest {took.max():.0f}.")
    return Table("", heads, rows, "\n".join(lines), ())


def kept(path):
    """Trials that a file already holds."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def main(argv=None):
    """Run the trials that are missing in a file, one line each, then the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--keep", type=Path, required=True, help="file of finished trials")
    parser.add_argument("--write", action="store_true", help="store the table in docs/results/tracing_trials.json")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--threads", type=int, default=loop_runs.THREADS)
    given = parser.parse_args(argv)
    done = kept(given.keep)
    known, todo = {(t["kind"], t["seed"]) for t in done}, []
    for k, kind in enumerate(kinds(given.count)):
        if (kind, given.first + k) not in known:
            todo.append((kind, given.first + k))
    if todo:
        bank = Bank(QUICK, threads=given.threads)
        blank = bank.blank()
        given.keep.parent.mkdir(parents=True, exist_ok=True)
    for kind, seed in todo:
        row, _ = trial(bank, blank, kind, seed)
        done.append(row)
        with given.keep.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(kind, seed, row["truth"], row["verdict"], row["found"], "right" if row["right"] else "WRONG", flush=True)
    rates = table(done)
    print(markdown(rates), rates.note, sep="\n\n")
    if given.write:
        options = f"{given.count} --first {given.first} --keep {given.keep} --write"
        write_results("tracing_trials", f"python -m tests.testbench.measured.loop_rates {options}", [rates])


if __name__ == "__main__":
    main()
