"""A trace as one self-contained page: verdict, held-out table, pictures, certificates, null and power.

`html(result, figures)` takes any {name: (caption, Figure)}; `figures.all_figures(tracer)` are the core's own.
"""

import html as escape
import json

from testbench.console.report import folded_html, page_html, picture_html
from testbench.tracing.fit.causes import AS_GOOD, ODDS
from testbench.tracing.fit.heldout import FLOOR_FACTOR, REFUSED
from testbench.tracing.problem.result import plain_value
from testbench.tracing.verdict import MOST_NUMERICAL


def number(x, digits=4):
    """Text of a number, or a dash."""
    return "-" if x is None else f"{x:.{digits}g}" if isinstance(x, (int, float)) else str(x)


def _table(title, items, columns, note=""):
    """<table> of dictionaries. A column is its head, a key or function of an item, and the digits of numbers."""
    if not items:
        return ""
    text = escape.escape
    head = "".join(f"<th>{text(head)}</th>" for head, *_ in columns)
    rows = [
        [number(of(item) if callable(of) else item.get(of), *digits) for _, of, *digits in columns] for item in items
    ]
    body = "".join("<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    note_html = f'<p class="note">{text(note)}</p>' if note else ""
    return f"<h2>{text(title)}</h2>\n<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{note_html}"


def _interval(ci, digits=4):
    return f"[{number(ci[0], digits)}, {number(ci[1], digits)}]"


def _join_laws(row):
    return " + ".join(row["laws"])


def _effects(result):
    columns = (
        ("law", "law"), ("port", "port"), ("value", "value", 6), ("sd", "sd", 2), ("unit", "unit"), ("d", "d", 3),
        ("P", "p"), ("status", "status"), ("description", "text"),
    )  # fmt: skip
    note = (
        "d: size of the effect in sigmas, with all nuisance parameters fitted. "
        "P: posterior probability that the effect is present."
    )
    return _table("Effects", result.effects, columns, note)


def _removed_share(row):
    """Share of the power above the floor that is gone; of an error that was at the floor before none can be told."""
    is_measurable = row["floor"] and row["before"] > FLOOR_FACTOR * row["floor"] and row["excess_removed"] is not None
    return f"{100 * row['excess_removed']:.1f} %" if is_measurable else None


def _heldout(result):
    columns = (
        ("observable", "name"), ("unit", "unit"), ("floor", "floor"), ("before", "before"),
        ("95 %", lambda row: _interval(row["before_ci"])), ("after one law", "after_one_law"), ("after", "after"),
        ("95 %", lambda row: _interval(row["after_ci"])), ("decrease, 95 %", lambda row: _interval(row["gain_ci"])),
        ("removed", _removed_share),
    )  # fmt: skip
    chi2 = result.heldout_chi2
    note = (
        f"Errors are the rms of single repeats; the floor is their repeatability. chi2 / rows: "
        f"{number(chi2.get('before'))} before, {number(chi2.get('after'))} after, {100 * (1 - REFUSED):g} % limit "
        f"{number(chi2.get('limit'))}. Intervals are simulated; with twelve groups or more they come from a paired "
        "block bootstrap. Removed: share of the power above the floor."
    )
    rows = [{"name": name} | row for name, row in result.heldout.items()]
    return _table("Error on held-out data, before and after", rows, columns, note)


def _models(result):
    columns = (
        ("laws", lambda m: _join_laws(m) or "none"), ("P", "p"), ("ln Z", "log_z", 6), ("BIC", "bic", 6),
        ("refitted", lambda m: "yes" if m["refitted"] else "linear"),
    )  # fmt: skip
    ranked = [m for m in result.models if "failed" not in m]
    failed = "; ".join(f"{_join_laws(m)}: {m['failed']}" for m in result.models if "failed" in m)
    note = f"Not ranked, because the fit failed: {failed}" if failed else ""
    return _table("Explanations", ranked[:10], columns, note)


def _causes(result):
    columns = (
        ("cause", _join_laws), ("chi2 above the best", "chi2", 2), ("P", "p"),
        ("sizes", lambda c: ", ".join(f"{number(e['value'])} {e['unit']}" for e in c["effects"])),
        ("cosine", "cosine"), ("d to separate by 3 sigma", "d_to_separate", 3),
    )  # fmt: skip
    note = (
        f"These conditions cannot distinguish the causes: chi2 differs by less than {AS_GOOD:.0f}, or the odds are "
        f"below {ODDS:g}. Each cause was refitted."
    )
    return _table(
        "Class of causes that the data cannot distinguish",
        result.causes if len(result.causes) > 1 else (),
        columns,
        note,
    )


def _rivals_table(result):
    columns = (("laws", _join_laws), ("instead of", "instead_of"), ("V", "vuong", 3))
    note = "No set is adequate. V: Vuong statistic against the listed set; above 2.3 a set is worse at the 1 % level."
    return _table("Sets that are not significantly worse", result.rivals, columns, note)


def _unphysical(result):
    columns = (
        ("law", "law"),
        ("value", "value"),
        ("sd", "sd", 2),
        ("unit", "unit"),
        ("chi2", "chi2", 4),
        ("why", "why"),
    )
    note = "These laws explain as much, but only with coefficients that physics forbids; they are never named."
    return _table("Laws with physically impossible coefficients", result.unphysical, columns, note)


def _next(result):
    columns = (
        ("segment", "group"),
        ("condition", lambda r: ", ".join(f"{k} {number(v)}" for k, v in r["condition"].items())),
        ("repeats", "repeats"), ("separation (sigma)", "separation", 3), ("gain", lambda r: f"x{number(r['gain'], 3)}"),
        ("gain per hour", "gain_per_hour", 3), ("pair hardest to separate", lambda r: " / ".join(r["pair"])),
    )  # fmt: skip
    note = "Separation: difference of the rivals after this measurement, with all parameters fitted again."
    return _table("What to measure next", result.next_experiment[:8], columns, note)


def _alarms(result):
    rows = []
    for name, test in result.alarms.items():
        if test:
            least = min(test["p"], key=test["p"].get)
            rows.append(test | {"name": name, "least": least, "own": test["p"][least], "draws": str(test["draws"])})
    columns = (
        ("alarm", "name"), ("global p", "p_global", 3), ("null draws", "draws"), ("smallest p of", "least"),
        ("its p", "own", 3),
    )  # fmt: skip
    note = f"p of the whole trace: {number(result.p_global, 3)}. Laws tested: {result.looks.get('laws', '-')}."
    return _table("Alarms", rows, columns, note)


def _nuisances(result):
    columns = (
        ("parameter", "name"), ("unit", "unit"), ("prior", "prior", 6), ("prior sd", "prior_sd", 3),
        ("before", "before", 8), ("after", "after", 8), ("sd", "sd", 2),
    )  # fmt: skip
    words = [d["words"] for d in result.identifiability.get("directions", ()) if d["fixed_by"] != "data"]
    note = "; ".join(words) or "The data determine every nuisance parameter better than its prior."
    return _table("Nuisance parameters", result.nuisances, columns, note)


def _power_table(result):
    limits = result.null.get("limits", {})
    rows = []
    for law, smallest_effect in sorted(result.power_d90.items()):
        bounds = limits.get(law)
        text = _interval((bounds["low"], bounds["high"]), 3) if bounds else ""
        rows.append(smallest_effect | {"law": law, "limits": text})
    columns = (
        ("law", "law"), ("d_90", "d", 3), ("value", "value", 3), ("unit", "unit"),
        ("95 % limits if no effect was found", "limits"),
    )  # fmt: skip
    rate, check = result.null.get("null"), result.null.get("check")
    note = ""
    if rate:
        note = f"Alarms in {rate['trials']} simulated records without an effect at level {number(rate['alpha'])}: "
        note += f"{rate['rang']}, rate {_interval(rate['ci'])}."
    if check:
        note += (
            f" In {check['trials']} with {check['law']} at its d_90: {check['rang']}, rate {_interval(check['ci'])}."
        )
    return _table("Smallest effect that this record detects with 90 % probability", rows, columns, note)


def _numerical(certificate):
    """Line on the error of the model that was fitted, if the problem states one."""
    if certificate.get("sigma") is None:
        return ""
    holds = "passed" if certificate["sigma"] < MOST_NUMERICAL else "FAILED"
    text = f"Numerical error of the fitted model: {number(certificate['sigma'], 2)} sigma, limit {MOST_NUMERICAL} sigma"
    engines = f" ({escape.escape(certificate['engines'])})" if "engines" in certificate else ""
    return f"<p>{text}: {holds}{engines}.</p>"


def html(result, figures):
    """Page of a `Result`; pictures in the order of `figures`."""
    title = f"Trace of {result.problem}: verdict {result.verdict}"
    parts = [f"<h1>{escape.escape(title)}</h1>", f"<p><b>{escape.escape(result.sentence)}</b></p>"]
    parts.append(_numerical(result.certificates.get("numerical") or {}))
    if result.notes:
        parts.append("<ul>" + "".join(f"<li>{escape.escape(n)}</li>" for n in result.notes) + "</ul>")
    parts += [section(result) for section in (_heldout, _effects, _causes, _rivals_table, _unphysical)]
    parts += [picture_html(figure, caption) for caption, figure in figures.values()]
    parts += [section(result) for section in (_next, _models, _alarms, _nuisances, _power_table)]
    for head, data in (
        ("The unexplained remainder", result.unexplained),
        ("Discovery of laws beyond the catalogue", result.discovery),
        ("Certificates", result.certificates),
        ("Hashes and options", {"hashes": result.hashes, "options": result.options}),
    ):
        if data:
            parts.append(folded_html(head, json.dumps(plain_value(data), indent=1, sort_keys=True)))
    return page_html(title, parts)
