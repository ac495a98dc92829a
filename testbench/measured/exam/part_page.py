"""Trace of one part and its page: JSON, table, and pictures of the residuals on held-out data before and after.

A problem says `most_laws` if its laws are many and small: they are then added one after the other (`add_in_stages`).
Figures are SVG in the page; they are drawn from the held-out groups alone.
"""

import html
import re
from typing import NamedTuple

import numpy as np

from testbench.console import report
from testbench.measured.exam.staged import ALPHA, absorb, add_in_stages
from testbench.tracing.trace import Options, Tracer
from testbench.tracing.trace_report import number

SHUFFLES = 199
UNEXPLAINED_FLOORS = 1.5  # floors, from which a held-out error is not explained
WIDE = 20.0  # floors of the largest residual, from which a picture is logarithmic beyond three of them
POINTS = 3000  # of one line of a picture; more are thinned
STYLE = """body{font:15px/1.45 sans-serif;max-width:1050px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.6em 0}td,th{border-bottom:1px solid #ccc;padding:.2em .7em;text-align:left}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}img{max-width:100%}figcaption{color:#555;margin-bottom:1em}
h2{margin-top:2em;border-top:2px solid #888;padding-top:.6em}.bad{color:#a00}.good{color:#060}
.part{color:#a60}code{background:#eee}"""


class Residual(NamedTuple):
    """Measured less predicted of one observable of one segment."""

    role: str
    unit: str
    floor: float | None
    before: np.ndarray
    after: np.ndarray


def run(problem, options=None, progress=None):
    """(JSON, {observable: (measured, before, after) of held-out rows}, caption data) of a part's problem."""
    options = options or Options(ALPHA)
    law_search = add_in_stages(problem, options, problem.most_laws, progress)
    rows = residuals(problem, law_search)
    judging = {key: row for key, row in rows.items() if row.role == "validate"}
    return in_part(law_search.json | {"left": [describe_residual(problem, key, rows) for key in judging]}), judging


def is_unexplained(row):
    """True if a row of `heldout` is not explained: its error is above UNEXPLAINED_FLOORS floors in the end."""
    return bool(row.get("floor")) and row["after"] > UNEXPLAINED_FLOORS * row["floor"]


def segment_words(name):
    """Name of a held-out segment in words."""
    blocks = re.fullmatch(r"run_(.+)_(even|odd)", name)
    if blocks:
        return f"{blocks[2]} blocks of run {blocks[1]}"
    return f"run {name[4:]}" if name.startswith("run_") else name


def in_part(data):
    """A report whose laws leave a held-out error above UNEXPLAINED_FLOORS floors is "named in part", and says where."""
    unexplained = [(segment_words(name), r) for name, r in data["heldout"].items() if is_unexplained(r)]
    texts = [f"{name} {r['after'] / r['floor']:.2g}" for name, r in unexplained]
    if data["verdict"] not in ("named", "candidate") or not texts:
        return data
    words = f"{data['sentence'].rstrip('. ')}. Held-out errors that are not explained, in floors: {', '.join(texts)}."
    verdict = "named in part" if data["verdict"] == "named" else data["verdict"]
    return data | {"verdict": verdict, "sentence": words}


def residuals(problem, law_search):
    """{(segment, observable): `Residual`} of all groups, at the fits without and with the laws."""
    names = [r.law for r in law_search.rounds if r.kept]
    quick = Options(n_null=199, max_laws=1, power=False, experiments=False)
    fits = []
    for now in (problem, absorb(problem, names)):
        tracer = Tracer(now, quick, None, None)
        fits.append((now, tracer.base.fit if tracer.calibrate() else None))
    out = {}
    for k, segment in enumerate(problem.segments):
        if any(fit is None for _, fit in fits):
            continue
        y, floor = problem.observed_features(k), problem.repeatability_rms(k)
        misfits = []
        for now, fit in fits:
            misfits.append(y - now.predict([(fit.point.theta, dict(zip(fit.model.names, fit.point.c)))], [k])[0][0])
        for o in segment.observables:
            rms = floor.get(o.name)
            out[segment.name, o.name] = Residual(segment.role, o.unit, rms, misfits[0][o.rows], misfits[1][o.rows])
    return out


def describe_residual(problem, key, rows):
    """What the rest on held-out data looks like, for one observable of one segment: numbers for a sentence.

    neighbours  correlation of neighbouring rows along the abscissa, p of it by shuffling: is the rest a curve?
    drift       the same in the order of recording, where that is another: does it change with time?
    tenth       largest share of the rest's power in a tenth of the rows: is it in one place? and where
    shared      correlation with the rest of the fitted segments, where rows match: is it the part, or this recording?
    """
    row = rows[key]
    x, label = problem.axis(*key) or (np.arange(len(row.after)), "row")
    order = np.argsort(x, kind="stable")
    e = row.after[order]
    rng = np.random.default_rng(0)

    def neighbours(v):
        return float(np.corrcoef(v[1:], v[:-1])[0, 1])

    def permutation_p(v):
        return (sum(neighbours(rng.permutation(v)) >= neighbours(v) for _ in range(SHUFFLES)) + 1) / (SHUFFLES + 1)

    sorted_in_time = np.array_equal(order, np.arange(len(order)))
    width = max(1, len(e) // 10)
    power = np.convolve(e * e, np.ones(width), "valid") / np.sum(e * e)
    at = int(np.argmax(power))
    twins = [
        float(np.corrcoef(row.after, other.after)[0, 1])
        for (_, name), other in rows.items()
        if other.role == "fit" and name == key[1] and len(other.after) == len(row.after)
    ]
    has_matching_rows = problem.same_rows and twins
    return {
        "segment": key[0],
        "observable": key[1],
        "neighbours": neighbours(e),
        "p": permutation_p(e),
        "drift": None if sorted_in_time else neighbours(row.after),
        "drift_p": None if sorted_in_time else permutation_p(row.after),
        "tenth": float(power[at]),
        "tenth_from": float(x[order][at]),
        "tenth_to": float(x[order][at + width - 1]),
        "axis": label,
        "shared": float(np.mean(twins)) if has_matching_rows else None,
    }


def png(figure):
    """<img> with a matplotlib figure inside."""
    import matplotlib.pyplot as plt

    image = report.png(figure, dpi=80)
    plt.close(figure)
    return image


def picture(problem, rows, most=9):
    """Figure of the held-out residuals before and after, one panel per observable, the floor as a band."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = {key: row for key, row in rows.items() if row.role == "validate"}
    panel_keys, observable_names = [], set()
    for key in rows:  # the last segment of each observable, if all are too many
        observable_names.add(key[1])
    for name in sorted(observable_names):
        panel_keys.append([key for key in rows if key[1] == name][-1])
    panel_keys = list(rows) if len(rows) <= most else panel_keys[:most]
    columns = 1 if len(panel_keys) <= 2 else 3
    lines = -(-len(panel_keys) // columns)
    figure, panels = plt.subplots(lines, columns, figsize=(11, 2.6 * lines + 0.6), squeeze=False, layout="constrained")
    for panel in panels.ravel()[len(panel_keys) :]:
        panel.axis("off")
    for panel, key in zip(panels.ravel(), panel_keys):
        _, unit, floor, before, after = rows[key]
        x, label = problem.axis(*key) or (np.arange(len(before)), "row")
        order = np.argsort(x, kind="stable")[:: max(1, len(x) // POINTS)]
        style = "-" if len(x) > 400 else "."
        panel.plot(x[order], before[order], style, ms=3, lw=0.7, color="#c05030", label="before")
        panel.plot(x[order], after[order], style, ms=3, lw=0.7, color="#205090", label="after")
        if floor and np.max(np.abs(before)) > WIDE * floor:
            panel.set_yscale("symlog", linthresh=3 * floor)
        if floor:
            panel.axhspan(-floor, floor, color="#888888", alpha=0.25, label="floor, 1 sd")
        panel.set_title(f"{key[1]}, {key[0]}", fontsize=9)
        panel.set_xlabel(label, fontsize=8)
        panel.set_ylabel(f"measured - predicted ({unit})", fontsize=8)
        panel.tick_params(labelsize=8)
    panels[0, 0].legend(fontsize=7)
    return png(figure)


def table(head, rows, numeric=()):
    """HTML table; cells are text."""
    mark = [' class="n"' if i in numeric else "" for i in range(len(head))]
    cells = "".join(f"<th{m}>{html.escape(h)}</th>" for m, h in zip(mark, head))
    body = "".join(
        "<tr>" + "".join(f"<td{m}>{html.escape(str(c))}</td>" for m, c in zip(mark, row)) + "</tr>" for row in rows
    )
    return f"<table><tr>{cells}</tr>{body}</table>"


def effects_table(data):
    """Table of what was found."""
    rows = [
        (e["law"], e["port"], number(e["value"], 5), number(e.get("sd"), 2), e["unit"], number(e.get("d"), 3))
        + (e.get("kind", ""), e.get("status", ""), e.get("text", ""))
        for e in data["effects"]
    ]
    head = ("law", "port", "value", "sd", "unit", "d", "kind", "status", "description")
    return table(head, rows, (2, 3, 5)) if rows else "<p>No effect is named.</p>"


def heldout_table(data):
    """Error before and after on held-out data beside the floor."""
    rows = []
    for name, h in data["heldout"].items():
        ratio = None if not h.get("floor") else h["after"] / h["floor"]
        rows.append(
            (
                segment_words(name),
                h["unit"],
                number(h.get("floor")),
                number(h["before"]),
                number(h.get("after_one_law")),
            )
            + (number(h["after"]), number(ratio, 3))
        )
    head = ("held out", "unit", "floor", "before", "after one law", "after", "after / floor")
    return table(head, rows, (2, 3, 4, 5, 6))


def rounds_table(data):
    """What was tried, in order."""
    rows = [
        (r["law"], "kept" if r["kept"] else "not kept", number(r["d"], 3), number(r["chi2_gain"], 3))
        + (", ".join(r["rivals"][:4]),)
        for r in data.get("rounds", [])
    ]
    head = ("law", "", "d on fitted data", "chi2 decrease on held-out data", "cannot be distinguished from")
    return table(head, rows, (2, 3)) if rows else ""


def part_section(title, data, image=""):
    """One part of the page."""
    mark = "good" if data["verdict"] in ("named", "none") else "part"
    words = [
        f"<h3>{html.escape(title)}</h3><p><b class='{mark}'>{html.escape(data['verdict'])}</b>: "
        f"{html.escape(data['sentence'])}</p>",
        heldout_table(data),
        effects_table(data),
    ]
    if image:
        words.append(
            f"<figure>{image}<figcaption>Residual on held-out data, before and after. The grey band is "
            "the floor. Where the residual before is far above it, the scale is logarithmic beyond three "
            "floors.</figcaption></figure>"
        )
    residual_rows = [
        (r["observable"], r["segment"], number(r["neighbours"], 2), number(r["p"], 2), f"{100 * r['tenth']:.0f} %")
        + (f"{number(r['tenth_from'])} .. {number(r['tenth_to'])}", number(r["shared"], 2))
        for r in data.get("left", [])
    ]
    if residual_rows:
        head = (
            "residual of",
            "segment",
            "correlation of neighbours",
            "p",
            "power in the worst tenth",
            "range of that tenth",
            "correlation with fitted segments",
        )
        words.append(
            "<details><summary>remaining residual: a curve, at one place, or in this recording only?</summary>"
        )
        words.append(table(head, residual_rows, (2, 3, 4, 6)) + "</details>")
    lost = data.get("not_carried_over", [])
    if lost:
        words.append(
            f"<p>These laws fit well, but held-out data do not support them: {html.escape(', '.join(lost))}.</p>"
        )
    if data.get("rounds"):
        words.append(f"<details><summary>all laws that were tried</summary>{rounds_table(data)}</details>")
    return "".join(words)


def page(title, body):
    """Self-contained HTML."""
    name = html.escape(title)
    head = f"<meta charset=utf-8><title>{name}</title><style>{STYLE}</style>"
    return f"<!doctype html><html lang=en>{head}<h1>{name}</h1>{body}</html>"
