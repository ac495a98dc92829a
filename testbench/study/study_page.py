"""What `gyro study` prints and writes: tables of predictions and runs, the verdict, the page, one object for machines.

Source    docs/word_lengths.md
"""

from testbench.console.markdown import markdown
from testbench.console.text_table import Table
from testbench.storage.files import atomic_outputs, write_text
from testbench.study import prediction, study

COSTS = ("registers", "multipliers", "tables")


def _keeps(p, s):
    if s.locked < s.runs:
        return f"{s.runs - s.locked} not locked"
    return "no" if not s.keeps else "yes" if p["holds"] else "yes*"


def _verdict(result):
    """Table: the limits that were fixed before the run, and what came of them."""
    rows = list(result.rows)
    rule_rows = [row for row in rows if row[1]["holds"]]
    share = max((row[3].arw_share for row in rows), default=0.0)
    lines = [
        (
            "designs for which the rule holds",
            f"{len(rule_rows)} of {len(rows)}",
            "at least half",
            "yes" if 2 * len(rule_rows) >= len(rows) else "no",
        ),
        ("standard error of the ARW", f"{100 * share:.2f} %", "3 %", "yes" if share < 0.03 else "no"),
    ]
    texts = {
        "arw": ("ARW", 100, "%"),
        "noise": ("noise of the rate word", 100, "%"),
        "spur_db": ("largest line", 1, "dB"),
    }
    for name, (text, factor, unit) in texts.items():
        worst = max(rule_rows, key=lambda row: abs(getattr(row[4], name)), default=None)
        if worst:
            value, limit = getattr(worst[4], name), getattr(study.LIMITS, name)
            verdict = "yes" if abs(value) <= limit else "no"
            lines.append(
                (f"{text}, worst: {worst[0]}", f"{factor * value:+.2f} {unit}", f"{factor * limit:g} {unit}", verdict)
            )
    older = result.written.utc <= result.started_utc
    lines.append(("predictions written", result.written.utc, f"before {result.started_utc}", "yes" if older else "no"))
    note = (
        f"SHA-256 of the predictions: {result.written.sha256}. The rule holds if the input noise of ADC, force DAC and "
        f"frequency word is {prediction.RULE_LSB:g} LSB or more."
    )
    return Table("Limits fixed before the run", ("what", "value", "limit", "met"), lines, note, (1, 2))


def _comparison_table(result):
    heads = (
        "design",
        "rule",
        "ARW",
        "pred.",
        "%",
        "noise LSB",
        "pred.",
        "%",
        "line dBc",
        "pred.",
        "dB",
        "n",
        "pred. n",
    )
    rows = [
        (
            case,
            "yes" if p["holds"] else "no",
            f"{s.arw_deg_per_rt_h:.4f}",
            f"{p['arw_deg_per_rt_h']:.4f}",
            f"{100 * d.arw:+.1f}",
            f"{s.noise_lsb:.1f}",
            f"{p['noise_lsb']:.1f}",
            f"{100 * d.noise:+.1f}",
            f"{s.spur_dbc:.1f}",
            f"{p['spur_dbc']:.1f}",
            f"{d.spur_db:+.1f}",
            str(s.spur_harmonic),
            str(p["spur_harmonic"]),
        )
        for case, p, _, s, d in result.rows
    ]
    note = (
        "rule: whether the rule holds. ARW in deg/sqrt(h), 0.5 to 5 Hz. pred.: prediction, and the difference from it. "
        "n: harmonic of the drive frequency that is the largest line of the drive DAC."
    )
    return Table("Noise and lines: simulation and prediction", heads, rows, note, tuple(range(2, len(heads))))


def _figures(result):
    heads = ("design", "keeps", "ARW %", "adev %", "scale ppm", "pred.", "bandwidth Hz", "pred.", "bias deg/s",
             "pred.", "quadrature mdeg/s", "registers", "multipliers", "tables")  # fmt: skip
    first = next(iter(result.rows))[1]
    rows = [
        (
            case,
            _keeps(p, s),
            f"{100 * s.arw_rise:+.2f}",
            f"{100 * s.adev_rise:+.2f}",
            f"{s.scale_ppm:+.0f}",
            f"{1e6 * (p['scale_lsb_per_dps'] / first['scale_lsb_per_dps'] - 1):+.0f}",
            f"{s.bandwidth_hz:.2f}",
            f"{p['bandwidth_hz']:.2f}",
            f"{s.bias_dps:.4f}",
            f"{p['bias_dps']:.4f}",
            f"{1e3 * s.quadrature_dps:+.4f}",
            str(c.registers),
            str(c.multipliers),
            str(c.tables),
        )
        for case, p, c, s, _ in result.rows
    ]
    note = (
        f"ARW and Allan deviation (adev) at {study.TAU_S:g} s: rise over the first design with the same noise. keeps: "
        f"both rise by at most {100 * study.KEEP_SHARE:g} %, the scale factor changes by at most {study.KEEP_PPM:g} "
        f"ppm, the bandwidth by at most {study.KEEP_HZ:g} Hz. *: the rule does not hold; a loop may rest in a "
        "dead band and appear quiet."
    )
    return Table("Figures and cost", heads, rows, note, tuple(range(2, len(heads))))


def _fronts(result):
    rows = [row for row in result.rows if row[1]["holds"]]
    lines = []
    for kind in COSTS:
        price = [getattr(row[2], kind) for row in rows]
        for text, loss in (
            ("ARW rise", [max(row[3].arw_rise, 0.0) for row in rows]),
            ("scale factor", [abs(row[3].scale_ppm) for row in rows]),
        ):
            best = study.front(price, loss)
            lines.append((kind, text, "; ".join(f"{rows[k][0]} ({price[k]})" for k in best)))
        unchanged_rows = [row for row in rows if row[3].keeps]
        if unchanged_rows:
            least = min(unchanged_rows, key=lambda row: getattr(row[2], kind))
            lines.append((kind, "smallest that keeps the figures", f"{least[0]} ({getattr(least[2], kind)})"))
    return Table(
        "Pareto fronts", ("cost in bits of", "loss", "designs"), lines, "Only designs for which the rule holds.", ()
    )


def tables(result):
    """Tables for the terminal and the page."""
    return [_verdict(result), _comparison_table(result), _figures(result), _fronts(result)]


def as_json(result):
    """One object with every number."""
    return {
        "predictions_sha256": result.written.sha256,
        "predictions_utc": result.written.utc,
        "started_utc": result.started_utc,
        "designs": {
            case: {
                "predicted": p,
                "cost": c._asdict(),
                "simulated": {**s._asdict(), "keeps": s.keeps},
                "deviation": d._asdict(),
            }
            for case, p, c, s, d in result.rows
        },
    }


def write(result, folder):
    """NAME.html in `folder`, tables and pictures; the tables alone as Markdown beside it."""
    from testbench.console import report
    from testbench.study import study_pictures

    pictures = [
        (
            "Dash: prediction. Disk: simulation. Hollow disk: simulation of a design for which the rule does not hold.",
            study_pictures.prediction_comparison(result),
        ),
        (
            "Loss of each design over its bits. The steps are the Pareto front: no design is better in both.",
            study_pictures.fronts(result),
        ),
    ]
    notes = [
        f"{row[0]}: the rule does not hold; the ARW differs from the prediction by {100 * row[4].arw:+.1f} %"
        for row in result.rows
        if not row[1]["holds"]
    ]
    page_tables = tables(result)
    text = "\n\n".join(f"## {table.title}\n\n{markdown(table)}\n\n{table.note}" for table in page_tables)
    path = folder / f"{result.name}.html"
    with atomic_outputs():
        write_text(folder / f"{result.name}.md", text + "\n")
        report.write_html(path, "Word lengths", page_tables, pictures, notes or ("The rule holds for all designs.",))
    return path
