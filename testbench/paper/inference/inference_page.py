"""`gyro report infer` as a page: what the data carry, what they contradict, what would decide. Tables of plain data.

Source    docs/inference.md
"""

from testbench.console.report import BLUE, GREY, VERMILION, make_axes, name_axes, write_html
from testbench.console.text_table import Table
from testbench.paper.inference import inference_study

NOTHING = 1e-12  # what rounding leaves of a difference
YES = {True: "yes", False: "no"}


def _text(value, digits=4):
    if value is None:
        return "-"
    return "0" if abs(value) < NOTHING else f"{value:.{digits}g}"


def summary(results):
    """Sentences: chi2 before and after, coverage, decided assumptions, contradicted classes, the measurement."""
    before, after = results["chi2"]["all"]
    inside = sum(r["inside"] for r in results["held_out"])
    sure = [
        f"{c['name']} = {value}" for c in results["choices"] for value, p in c["probability"].items()
        if p > 1 - inference_study.EXCLUDED
    ]  # fmt: skip
    wrong = [f"{c['group']} ({c['fold']})" for c in results["classes"] if c["verdict"] == "contradicted"]
    best, turned = results["measurements"][0], results["other_sign"]
    signs = ", ".join(f"{c['p']:.2f} ({c['fold']}, {c['verdict']})" for c in turned)
    return [
        f"chi2 of 19 fitted rows: {before:.4g} for the default board, {after:.3g} for the most probable board.",
        f"{inside} of {len(results['held_out'])} held-out predictions are within their 90 % interval.",
        f"Assumptions with a probability above {1 - inference_study.EXCLUDED:g}: {', '.join(sure)}.",
        f"Contradicted classes, with p below 0.01: {', '.join(wrong)}.",
        *([f"With a minus sign before the bias at 50 degC, p of the bias would be {signs}."] if turned else []),
        f"{results['open_bits']:.2f} bits about the discrete assumptions are undecided. The best measurement is "
        f"expected to give {best['mode_bits']:.2f} of them: {best['name']}.",
    ]


def modes_table(results):
    names = list(results["modes"][0]["choices"])
    rows = [
        (f"{m['weight']:.3f}", f"{m['chi2']:.1f}", *(str(m["choices"][n]) for n in names)) for m in results["modes"]
    ]
    note = "Probability from Laplace's approximation; chi2 of 19 rows."
    return Table("Modes", ("probability", "chi2", *names), rows, note, tuple(range(len(names) + 2)))


def choices_table(results):
    rows = [
        (c["name"], value, f"{p:.4f}", "excluded" if p < inference_study.EXCLUDED else "", c["why"])
        for c in results["choices"]
        for value, p in c["probability"].items()
    ]
    return Table(
        "Discrete assumptions", ("assumption", "choice", "posterior", "result", "meaning"), rows, numeric=(1, 2)
    )


def numbers_table(results):
    rows = [
        (n["name"], n["unit"], *(_text(x) for x in (*n["prior"], *n["posterior"])), f"{n['shift']:+.2f}",
         f"{n['width']:.2f}", n["verdict"], n["why"])
        for n in results["numbers"]
    ]  # fmt: skip
    note = (
        "Shift and width are in standard deviations of the prior. carried: the rows determine the number, width below "
        f"{inference_study.INFORMED_WIDTH:g}; strained: shift beyond {inference_study.STRAINED:g}; open: the rows say "
        "little about the number."
    )
    heads = (
        "number",
        "unit",
        "prior 5 %",
        "95 %",
        "posterior 5 %",
        "50 %",
        "95 %",
        "shift",
        "width",
        "verdict",
        "reason for the prior",
    )
    return Table("Assumed numbers: posterior against prior", heads, rows, note, tuple(range(2, 9)))


def rows_table(results):
    rows = []
    for r in results["rows"]:
        model_values = r["before"], r["after"]
        pulls = [f"{(value - r['paper']) / r['sigma']:+.1f}" for value in model_values]
        cells = (_text(r["before"], 5), pulls[0], _text(r["after"], 5), pulls[1], YES[r["fitted"]])
        rows.append((r["name"], r["unit"], f"{r['paper']:g}", _text(r["sigma"], 2), *cells))
    note = (
        "Pull: model minus paper, over the paper's standard uncertainty. Both boards are computed with the phase "
        "budget and the linear loops."
    )
    heads = ("row", "unit", "paper", "sigma", "default", "pull", "most probable", "pull", "fitted")
    return Table("Rows of the default and of the most probable board", heads, rows, note, tuple(range(2, 8)))


def heldout_rows_table(results):
    rows = [
        (
            r["fold"],
            r["name"],
            f"{r['paper']:g}",
            *(_text(r[k], 5) for k in ("low", "middle", "high")),
            YES[r["inside"]],
        )
        for r in results["held_out"]
    ]
    inside = sum(r["inside"] for r in results["held_out"])
    heads = ("left out", "row", "paper", "5 %", "50 %", "95 %", "inside")
    return Table(
        "Held-out rows", heads, rows, f"{inside} of {len(rows)} rows are inside their 90 % interval.", (2, 3, 4, 5)
    )


def classes_table(results):
    rows = [
        (c["fold"], c["group"], f"{c['distance']:.3g}", str(c["count"]), f"{c['p']:.3f}",
         _text(c["width"], 2), c["verdict"]) for c in results["classes"]
    ]  # fmt: skip
    note = (
        "D^2: squared distance from the mean prediction, scaled by the predicted covariance. p: share of predictions "
        "at least as far away. width: largest predicted standard deviation over the paper's. covered: not "
        "contradicted, but the prediction is too wide to be informative."
    )
    heads = ("left out", "class", "D^2", "rows", "p", "width", "verdict")
    return Table("Held-out classes", heads, rows, note, (2, 3, 4, 5))


def changes_table(results):
    wrong = {c["group"] for c in results["classes"] if c["verdict"] == "contradicted" and c["fold"] == "steps"}
    rows = [
        (c["group"], f"{c['name']} ({c['unit']})", _text(c["before"]), _text(c["after"]), f"{c['moved']:+.2f}",
         f"{c['without']:.3g}", f"{c['together']:.3g}") for c in results["changes"] if c["group"] in wrong
    ]  # fmt: skip
    note = "The change that writing a register would have to cause. moved: in standard deviations of the prior."
    heads = ("class", "number", "before", "after", "moved", "chi2 without", "chi2 with")
    return Table(
        "Contradicted changes between cases: the smallest change of a number that would explain them",
        heads,
        rows,
        note,
        (2, 3, 4, 5, 6),
    )


def heldout_changes_table(results):
    rows = [
        (m["fold"], m["group"], f"{m['name']} ({m['unit']})", _text(m["before"]), _text(m["after"]),
         f"{m['moved']:+.2f}", f"{m['without']:.3f}", f"{m['together']:.3f}") for m in results["changes_at_temperature"]
    ]  # fmt: skip
    note = (
        "The smallest change of a number, only at the temperature that is left out, with which no class is "
        "contradicted there. moved: in standard deviations of the prior."
    )
    heads = ("left out", "class", "number", "before", "after", "moved", "p without", "p with")
    return Table(
        "Contradicted at a temperature that is left out: the smallest change that would explain it",
        heads,
        rows,
        note,
        range(3, 8),
    )


def sign_table(results):
    rows = [
        (c["fold"], c["group"], f"{c['p_as_printed']:.3f}", f"{c['p']:.3f}", f"{c['distance']:.3g}",
         _text(c["width"], 2), c["verdict"]) for c in results["other_sign"]
    ]  # fmt: skip
    note = "The same comparison with a minus sign before the bias at 50 degC. The paper prints it without one."
    heads = ("left out", "class", "p as printed", "p with minus sign", "D^2", "width", "verdict")
    return Table("With a minus sign before the bias at 50 degC", heads, rows, note, range(2, 6))


def measurements_table(results):
    rows = [
        (m["name"], m["unit"], _text(m["sigma"], 2), _text(m["predicted"]), _text(m["spread"], 2),
         f"{m['mode_bits']:.2f}", f"{m['number_bits']:.1f}") for m in results["measurements"]
    ]  # fmt: skip
    note = f"{results['open_bits']:.2f} bits about the discrete assumptions are undecided."
    heads = ("measurement", "unit", "error", "predicted", "+-", "bits about assumptions", "bits about the quantity")
    return Table("Measurements that would decide", heads, rows, note, (2, 3, 4, 5, 6))


TABLES = (classes_table, changes_table, heldout_changes_table, sign_table, measurements_table, choices_table,
          modes_table, rows_table, heldout_rows_table, numbers_table)  # fmt: skip


def widths_picture(results):
    """Posterior of each number in standard deviations of its prior: mean and 90 %, on the prior's own."""
    figure, axes = make_axes("Posterior against prior, in standard deviations of the prior", 9.5)
    axis, numbers = axes[0, 0], results["numbers"][::-1]
    axis.axvspan(-1.645, 1.645, color="#e8eef2", label="prior, 90 %")
    for k, n in enumerate(numbers):
        color = {"carried": BLUE, "strained": VERMILION, "open": GREY}[n["verdict"]]
        axis.errorbar(n["shift"], k, xerr=1.645 * n["width"], fmt="o", color=color, capsize=3)
    axis.set_yticks(range(len(numbers)), [n["name"] for n in numbers])
    axis.set_ylim(-1, len(numbers))
    name_axes(axis, "blue: carried, the rows determine it; red: strained; grey: open", "", "lower right")
    return figure


def pulls_picture(results):
    """Pulls of the fitted rows, default and most probable board."""
    figure, axes = make_axes("Fitted rows: model minus paper", 6.5)
    axis = axes[0, 0]
    fitted = [r for r in results["rows"] if r["fitted"]][::-1]
    for name, color, mark in (("before", GREY, "s"), ("after", BLUE, "o")):
        pulls = [(r[name] - r["paper"]) / r["sigma"] for r in fitted]
        label = {"before": "default board", "after": "most probable board"}[name]
        axis.plot(pulls, range(len(fitted)), mark, color=color, label=label)
    axis.axvspan(-2, 2, color="#e8eef2")
    axis.set_xscale("symlog", linthresh=3)
    axis.set_yticks(range(len(fitted)), [r["name"] for r in fitted])
    name_axes(axis, "standard uncertainties of the paper's number; band: 2", "", "upper left")
    return figure


def write(results, path):
    """Write the page; returns its path."""
    pictures = [
        ("Fitted rows of the default and of the most probable board", pulls_picture(results)),
        ("Numbers that the rows determine", widths_picture(results)),
    ]
    title = "Which board gave the paper's numbers"
    return write_html(path, title, [table(results) for table in TABLES], pictures, summary(results))
