"""Scorer of a sealed run: opens the envelopes, and counts, with 95 % Clopper-Pearson intervals.

    class       causes of a verdict named, confounded or candidate; `same_as` are other names of a cause
    right       the class holds the truth;   false   a class without it, and any class where nothing was hidden
    detected    a class, or unexplained

Source    docs/sealed.md
"""

import hashlib
import json
from typing import NamedTuple

from testbench.errors import FileError
from testbench.tracing.noise.power import clopper_pearson
from tests.sealed import coverage, sheet_size
from tests.sealed.strata import INSIDE, NULLS

CLASSES = ("named", "confounded", "candidate")
QUIET = ("none", "noise-model")
DETECTED = (*CLASSES, "unexplained")
HOLDS = {None: "", True: "yes", False: "**no**"}
MOST_CPU_S = 45
SMALL = 3  # members of a class that still counts
Z = 1.959964


class Scored(NamedTuple):
    """A record whose envelope is open."""

    number: int
    kind: str
    truth: dict | None
    verdict: str
    causes: tuple  # of frozensets of names
    right: bool
    listed: bool  # any effect at all, partial ones too
    pull: float | None  # (found - hidden) / sd where the truth is in the class
    cpu_s: float
    intervals: tuple = ()  # deviations in sds of what a trace from a data sheet has found of a board without effect
    d_sheet: float | None = None  # sigmas of the truth beside the parameters of a data sheet


def _names(cause):
    """Each law of a cause with its other names."""
    return [{e["law"], *e.get("same_as", ())} for e in cause["effects"]]


def _pull(cause, truth):
    for effect in cause["effects"]:
        if effect["law"] == truth["name"] and effect["sd"]:
            return (effect["value"] - truth["value"]) / effect["sd"]
    return None


def scored(number, envelope, result, sheet_sizes=None):
    """`Scored` of a record; FileError if the envelope is not the one that was sealed.

    sheet_sizes  `sheet_size.sizes` if it was traced from a data sheet
    """
    found = hashlib.sha256(envelope.encode()).hexdigest()
    if found != result["envelope_sha256"]:
        raise FileError(f"envelope {number:03d}: sha256 {found[:12]}, sealed was {result['envelope_sha256'][:12]}")
    sealed = json.loads(envelope)
    truth, cpu = sealed["effect"], sum(result["cpu_s"].values())
    d_sheet = None
    if sheet_sizes and truth and truth["name"] in sheet_sizes:
        d_sheet = round(sheet_sizes[truth["name"]] * abs(truth["value"]), 2)
    if "error" in result:
        return Scored(number, sealed["kind"], truth, "error", (), False, False, None, cpu, (), d_sheet)
    said = result["result"]
    causes = said["causes"] if said["verdict"] in CLASSES else []
    right, pull = False, None
    for cause in causes:
        names = _names(cause)
        if truth and len(names) == 1 and truth["name"] in names[0]:
            right, pull = True, _pull(cause, truth)
    listed = bool(said["effects"] or causes)
    sets = tuple(frozenset(cause["laws"]) for cause in causes)
    offs = () if truth or not sheet_sizes else tuple(round(x, 3) for x in coverage.offs(sealed, said).values())
    return Scored(number, sealed["kind"], truth, said["verdict"], sets, right, listed, pull, cpu, offs, d_sheet)


def kept(run, rows, wide=()):
    """Text of what was counted: the line of the ledger, then one of JSON for each `Scored`."""
    told = [
        r._asdict() | {"causes": [sorted(c) for c in r.causes], "wide": again}
        for again, some in ((False, rows), (True, wide))
        for r in some
    ]
    return "".join(json.dumps(line) + "\n" for line in (run, *told))


def read(text):
    """(line of the ledger, `Scored`s, those with a data sheet's priors) of such a text."""
    run, *told = map(json.loads, text.splitlines())
    both = {False: [], True: []}
    for r in told:
        sets = {"causes": tuple(map(frozenset, r["causes"])), "intervals": tuple(r.get("intervals", ()))}
        both[r.pop("wide")].append(Scored(**(r | sets)))
    return run, both[False], both[True]


def rate(k, n):
    """Text of k in n with its interval."""
    if not n:
        return "0 of 0"
    low, high = clopper_pearson(k, n)
    return f"{k} of {n} [{100 * low:.1f} .. {100 * high:.1f} %]"


def criteria(rows):
    """[(what, k, n, limit, holds)] of a list of `Scored`; limits are those of a whole run, as shares."""

    def of(*kinds):
        return [r for r in rows if r.kind in kinds]

    null, clear, inside, outside = of(*NULLS), of("clear"), of(*INSIDE), of("outside")
    classes = [r for r in rows if r.causes]
    named = [r for r in classes if r.verdict == "named"]
    pulls = [r.pull for r in rows if r.pull is not None]
    found = []

    def count(what, some, true, limit="", holds=None):
        k, n = sum(map(true, some)), len(some)
        found.append((what, k, n, limit, holds and holds(k, n)))

    count("false causes, of all records", rows, false, "at most 2 of 300", lambda k, n: k <= 2 * n / 300)
    count("false causes, of all classes", classes, false, "at most 2 %", lambda k, n: k <= 0.02 * n)
    count("false causes, of single names", named, false, "at most 2 %", lambda k, n: k <= 0.02 * n)
    count("clear: named right", clear, lambda r: r.right and r.verdict == "named", "at least 85 %", _least(0.85))
    small = "inside: right, in a class of at most 3"
    count(small, inside, lambda r: r.right and len(r.causes) <= SMALL, "at least 70 %", _least(0.7))
    count("inside: detected", inside, lambda r: r.verdict in DETECTED, "at least 118 of 120", _least(118 / 120))
    count("inside: unexplained", inside, lambda r: r.verdict == "unexplained")
    count("outside: unexplained", outside, lambda r: r.verdict == "unexplained")
    count("nulls: alarm or listed effect", null, rang, "at most 1 of 100", lambda k, n: n > 0 and k <= n / 100)
    count("white nulls: noise-model", of("null_white"), lambda r: r.verdict == "noise-model")
    covered = "90 .. 99 %, 100 or more"
    count("sizes in their 95 % intervals", pulls, lambda p: abs(p) < Z, covered, _covered)
    count("tracebacks", rows, lambda r: r.verdict == "error", "none", lambda k, n: k == 0)
    return found


def wide_criteria(rows, wide, disguises, least_d):
    """The same for records that were traced again with the priors of a data sheet; both lists by number.

    least_d  sigmas from which on an effect is to be found, beside the parameters of the sheet too
    """
    narrow = {r.number: r for r in rows}
    both = [(narrow[r.number], r) for r in wide if r.number in narrow]
    new = [w for n, w in both if not false(n)]
    named = [(n, w) for n, w in both if n.verdict == "named" and n.right and n.truth["name"] not in disguises]
    k, again = sum(map(false, new)), [w.right and len(w.causes) <= SMALL for _, w in named]
    large = [same for same, (_, w) in zip(again, named) if (w.d_sheet or 0.0) >= least_d]
    offs = [x for r in wide for x in r.intervals]
    return [
        ("data sheet: new false causes", k, len(new), "none", k == 0),
        (f"data sheet: of those named and still of {least_d:g} sigmas, the same in a class of at most 3", sum(large),
         len(large), "at least 80 %", _least(0.8)(sum(large), len(large))),
        ("data sheet: of all named, the same in a class of at most 3", sum(again), len(again), "", None),
        ("data sheet: 95 % intervals of boards without effect", sum(abs(x) < Z for x in offs), len(offs), "91 .. 99 %",
         bool(offs) and 0.91 <= sum(abs(x) < Z for x in offs) / len(offs) <= 0.99),
        ("data sheet: tracebacks", sum(w.verdict == "error" for w in wide), len(wide), "none",
         not any(w.verdict == "error" for w in wide)),
    ]  # fmt: skip


def false(r):
    """True for a class without the truth."""
    return bool(r.causes) and not r.right


def rang(r):
    """True for a null with an alarm or anything listed."""
    return r.verdict not in QUIET or r.listed


def _least(share):
    return lambda k, n: n > 0 and k >= share * n


def _covered(k, n):
    return n >= 100 and 0.90 <= k / n <= 0.99


def table(rows, wide=(), disguises=(), least_d=0.0):
    """Markdown of the criteria, then of the verdicts in each stratum, then the mean of the CPU time.

    wide  `Scored` of records that were traced again with the priors of a data sheet
    """
    lines = ["| what | records | limit | holds |", "|---|---|---|---|"]
    for what, k, n, limit, holds in criteria(rows) + (wide_criteria(rows, wide, disguises, least_d) if wide else []):
        lines.append(f"| {what} | {rate(k, n)} | {limit} | {HOLDS[holds if n else None]} |")
    lines += ["", "| stratum | records | right | false | verdicts |", "|---|---|---|---|---|"]
    for kind in (*NULLS, *INSIDE, "outside"):
        some = [r for r in rows if r.kind == kind]
        if some:
            verdicts = [r.verdict for r in some]
            said = ", ".join(f"{v} {verdicts.count(v)}" for v in sorted(set(verdicts)))
            right, wrongly = sum(r.right for r in some), sum(map(false, some))
            lines.append(f"| {kind} | {len(some)} | {right} | {wrongly} | {said} |")
    mean = sum(r.cpu_s for r in rows) / max(1, len(rows))
    lines += ["", f"CPU time of a record, mean: {mean:.1f} s, limit {MOST_CPU_S} s."]
    if wide:
        lines.append(f"With the priors of a data sheet: {sum(r.cpu_s for r in wide) / len(wide):.1f} s.")
    return "\n".join(lines)


def wrong(rows):
    """One line for each record that counts against the tracer."""
    for r in rows:
        bad = false(r) or r.verdict == "error" or (r.kind in INSIDE and not r.right)
        if bad or (r.kind in NULLS and rang(r)):
            causes = " | ".join(" + ".join(sorted(c)) for c in r.causes)
            yield f"{r.number:03d} {r.kind}: {_hidden(r.truth)}: {r.verdict}: {causes}"


def beside(wide, rest):
    """One line for each false law of a data sheet: what is left of the truth beside it, with `sheet_size.left`."""
    for r in wide:
        for cause in r.causes if r.truth and not r.right else ():
            for law in cause:
                if law in rest:
                    sigmas = sheet_size.beside(rest, r.truth["name"], r.truth["value"], law)
                    yield f"{r.number:03d} {_hidden(r.truth)}: {law}: {sigmas:.1f} sigmas left beside it and the sheet"


def _hidden(truth):
    if not truth:
        return "nothing hidden"
    said = f"{truth['name']} {truth['value']:.3g}, d {truth['d']:.1f}"
    return f"{said}, {truth['apart']:.1f} beside {truth['rival']}"
