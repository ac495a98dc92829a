"""A trace as one self-contained page: verdict, held-out table, pictures, certificates, null and power.

`html(result, figures)` takes any {name: (caption, Figure)}; `figures(tracer)` are the core's own.
"""

import base64
import html as escape
import io
import json

from testbench.console.report import CSS
from testbench.tracing.fit.heldout import FLOOR_FACTOR
from testbench.tracing.problem.result import plain
from testbench.tracing.verdict import MOST_NUMERICAL


def figures(tracer):
    """{name: (caption, Figure)} of a `trace.Tracer` that has run."""
    from testbench.tracing.figures import all_figures

    return all_figures(tracer)


def number(x, digits=4):
    """Text of a number, or a dash."""
    return "-" if x is None else f"{x:.{digits}g}" if isinstance(x, (int, float)) else str(x)


def _table(heads, rows, title, note=""):
    if not rows:
        return ""
    text = escape.escape
    head = "".join(f"<th>{text(h)}</th>" for h in heads)
    body = "".join("<tr>" + "".join(f"<td>{text(str(c))}</td>" for c in row) + "</tr>" for row in rows)
    below = f'<p class="note">{text(note)}</p>' if note else ""
    return f"<h2>{text(title)}</h2>\n<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{below}"


def png(figure, alt="", dpi=100):
    """<img> with a matplotlib figure inside."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">'


def _picture(caption, figure):
    text = escape.escape(caption)
    return f"<figure>{png(figure, text)}<figcaption>{text}</figcaption></figure>"


def _interval(ci):
    return f"[{number(ci[0])}, {number(ci[1])}]"


def _effects(result):
    heads = ("law", "port", "value", "sd", "unit", "d", "P", "status", "what it is")
    rows = [
        (e["law"], e["port"], number(e["value"], 6), number(e["sd"], 2), e["unit"], number(e["d"], 3))
        + (number(e["p"], 4), e["status"], e["text"])
        for e in result.effects
    ]
    note = (
        "d: size in sigmas after the nuisances have taken their part. P: posterior probability that the law takes part."
    )
    return _table(heads, rows, "Effects", note)


def _heldout(result):
    heads = ("observable", "unit", "floor", "before", "95 %", "after one law", "after", "95 %", "fall, 95 %", "removed")
    rows = []
    for name, h in result.heldout.items():
        # of an error that was at the floor before no share can be told
        share = h["excess_removed"] if h["floor"] and h["before"] > FLOOR_FACTOR * h["floor"] else None
        rows.append(
            (name, h["unit"], number(h["floor"]), number(h["before"]), _interval(h["before_ci"]))
            + (number(h["after_one_law"]), number(h["after"]), _interval(h["after_ci"]), _interval(h["gain_ci"]))
            + ("-" if share is None else f"{100 * share:.1f} %",)
        )
    chi2 = result.heldout_chi2
    note = (
        f"rms of single repeats; floor: their own repeatability. chi2 / rows {number(chi2.get('before'))} before, "
        f"{number(chi2.get('after'))} after, 99 % limit {number(chi2.get('limit'))}. Intervals are simulated, with "
        "twelve groups and more a paired block bootstrap; removed: share of the power above the floor."
    )
    return _table(heads, rows, "Error before and after, on data that no fit has seen", note)


def _models(result):
    rows = [
        (" + ".join(m["laws"]) or "none", number(m["p"]), number(m["log_z"], 6), number(m["bic"], 6))
        + ("yes" if m["refitted"] else "linear",)
        for m in result.models
        if "failed" not in m
    ][:10]
    failed = "; ".join(f"{' + '.join(m['laws'])}: {m['failed']}" for m in result.models if "failed" in m)
    note = f"Never ranked, as the fit failed: {failed}" if failed else ""
    return _table(("laws", "P", "ln Z", "BIC", "refitted"), rows, "Explanations", note)


def _confounded(result):
    rows = [
        (" + ".join(c["laws"]), number(c["p"]), c.get("instead_of", ""), number(c.get("cosine")))
        + (number(c.get("d_to_separate"), 3), number(c.get("vuong"), 3))
        for c in result.confounded
    ]
    return _table(
        ("laws", "P", "instead of", "cosine", "d for 3 sigma apart", "V"),
        rows,
        "Confounded set (95 %)",
        "V: how clearly worse (2.3: 1 %), where nothing is adequate.",
    )


def _alike(result):
    rows = [(a["law"], a["instead_of"], number(a["chi2"], 2), number(a["value"]), a["unit"]) for a in result.alike]
    return _table(
        ("law of the grammar", "instead of", "chi2 more", "value", "unit"),
        rows,
        "Laws that would do as well",
        "By the linear model; odds below 20. The catalogue's law is named, as its physics is known.",
    )


def _next(result):
    rows = []
    for r in result.next_experiment[:8]:
        condition = ", ".join(f"{k} {number(v)}" for k, v in r["condition"].items())
        rows.append((r["group"], condition, r["repeats"], number(r["separation"], 3), f"x{number(r['gain'], 3)}"))
        rows[-1] += (number(r["gain_per_hour"], 3), " / ".join(r["pair"]))
    heads = ("segment", "condition", "repeats", "sigmas apart then", "gain", "gain per hour", "hardest pair")
    return _table(heads, rows, "What to measure next", "Sigmas by which rivals would differ, all fitted again.")


def _alarms(result):
    rows = []
    for name, test in result.alarms.items():
        if test:
            least = min(test["p"], key=test["p"].get)
            rows.append((name, number(test["p_global"], 3), test["draws"], least, number(test["p"][least], 3)))
    note = f"p of the trace {number(result.p_global, 3)}; laws looked at {result.looks.get('laws', '-')}."
    return _table(("alarm", "global p", "null draws", "loudest statistic", "its own p"), rows, "Alarms", note)


def _nuisances(result):
    rows = [
        (n["name"], n["unit"], number(n["prior"], 6), number(n["prior_sd"], 3), number(n["before"], 8))
        + (number(n["after"], 8), number(n["sd"], 2))
        for n in result.nuisances
    ]
    words = [d["words"] for d in result.identifiability.get("directions", ()) if d["fixed_by"] != "data"]
    note = "; ".join(words) or "The data fix every nuisance better than its prior."
    return _table(("nuisance", "unit", "prior", "prior sd", "before", "after", "sd"), rows, "Nuisances", note)


def _power(result):
    limits = result.null.get("limits", {})
    rows = []
    for k, v in sorted(result.power_d90.items()):
        bounds = limits.get(k)
        text = f"[{number(bounds['low'], 3)}, {number(bounds['high'], 3)}]" if bounds else ""
        rows.append((k, number(v["d"], 3), number(v["value"], 3), v["unit"], text))
    rate, check = result.null.get("null"), result.null.get("check")
    note = ""
    if rate:
        note = f"Simulated nulls: {rate['rang']} of {rate['trials']} ring at {number(rate['alpha'])}"
        note += f" {_interval(rate['ci'])}."
    if check:
        note += f" {check['law']} at its d_90: {check['rang']} of {check['trials']} ring {_interval(check['ci'])}."
    heads = ("law", "d_90", "value", "unit", "95 % limits if nothing was found")
    return _table(heads, rows, "Smallest effect this record would have shown with 90 %", note)


def _numerical(certificate):
    """Line on the error of the model that was fitted, if the problem states one."""
    if certificate.get("sigma") is None:
        return ""
    holds = "holds" if certificate["sigma"] < MOST_NUMERICAL else "DOES NOT HOLD"
    text = f"Numerical error of the fitted model: {number(certificate['sigma'], 2)} sigma, {MOST_NUMERICAL} allowed"
    engines = f" ({escape.escape(certificate['engines'])})" if "engines" in certificate else ""
    return f"<p>{text}: {holds}{engines}.</p>"


def html(result, figures):
    """Page of a `Result`; pictures in the order of `figures`."""
    title = escape.escape(f"Trace of {result.problem}: {result.verdict}")
    parts = [f"<h1>{title}</h1>", f"<p><b>{escape.escape(result.sentence)}</b></p>"]
    parts.append(_numerical(result.certificates.get("numerical") or {}))
    if result.notes:
        parts.append("<ul>" + "".join(f"<li>{escape.escape(n)}</li>" for n in result.notes) + "</ul>")
    sections = (_heldout, _effects, _confounded, _alike, _next, _models, _alarms, _nuisances, _power)
    tables = [section(result) for section in sections]
    parts += tables[:4]
    parts += [_picture(*figure) for figure in figures.values()]
    parts += tables[4:]
    for head, data in (
        ("What is known about the rest", result.unexplained),
        ("Discovery", result.discovery),
        ("Certificates", result.certificates),
        ("Hashes and options", {"hashes": result.hashes, "options": result.options}),
    ):
        if data:
            text = json.dumps(plain(data), indent=1, sort_keys=True)
            parts.append(f"<details><summary>{head}</summary><pre>{escape.escape(text)}</pre></details>")
    body = "\n".join(part for part in parts if part)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>'
        f"<style>{CSS}</style></head>\n<body>\n{body}\n</body></html>\n"
    )
