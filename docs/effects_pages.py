"""Pages of the catalogue, and their indices: python docs/effects_pages.py [NAME ...]

A page that is missing is made; of one that exists, what the module says is renewed and all else stays. The table shows
what the effect changes, measured: the default gyroscope in the baseband engine at 5 um, off and on with the same noise:
frequency, drive word, bias, scale factor, V_q.
"""

import re
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import pages  # noqa: E402

from analog_frontend.effects import catalogue  # noqa: E402
from analog_frontend.parts import device  # noqa: E402
from testbench import config  # noqa: E402
from testbench.console.markdown import replace_part  # noqa: E402
from testbench.measured.closed_loop import loop_runs  # noqa: E402
from testbench.measured.closed_loop.loop_runs import FAST, Model, Run  # noqa: E402
from testbench.measured.closed_loop.loop_tangents import disable_retiming  # noqa: E402
from testbench.measured.record.recording_plan import Condition  # noqa: E402
from testbench.storage.files import write_text  # noqa: E402

FOLDER = ROOT / "docs" / "effects"
SETTLE_S, DWELL_S, RATE_DPS, SEED = 1.5, 1.0, 50.0, 3
ROWS = (
    ("drive frequency", "mHz", "rest", 1e3, 3),
    ("drive word", "ppm", "rest", 1e6, 2),
    ("bias", "deg/h", "rest", 3600.0, 3),
    ("scale factor", "ppm", "both", 1e6, 2),
    ("V_q squared", "V^2", "rest", 1.0, 6),
)


def conditions(temp_degc):
    """At rest and at RATE_DPS."""
    return [Condition(f"at {r:g}", 5.0, r, r, temp_degc, settle_s=SETTLE_S, seconds=DWELL_S) for r in (0.0, RATE_DPS)]


def read(features, condition):
    """{observable: mean over the dwell} of a feature vector."""
    widths = np.diff(loop_runs.bins(condition))
    table = features.reshape(len(loop_runs.NAMES), -1) @ widths / widths.sum()
    return dict(zip(loop_runs.NAMES, table))


def changes(off, on):
    """(frequency Hz, drive word relative, bias deg/s, scale factor relative, V_q^2 V^2): on less off."""
    scale = [(v[1]["force"] - v[0]["force"]) / RATE_DPS for v in (off, on)]
    bias = [v[0]["force"] / s for v, s in zip((off, on), scale)]
    return (
        on[0]["f_word"] - off[0]["f_word"],
        on[0]["amplitude"] / off[0]["amplitude"] - 1,
        bias[1] - bias[0],
        scale[1] / scale[0] - 1,
        on[0]["v_q2"] - off[0]["v_q2"],
    )


def measure_table(names, bench=None):
    """{name: changes} of effects at the sizes of their pages."""
    bench = bench or loop_runs.Bench()
    base, out = config.Config(), {}
    jobs = []
    for effect in catalogue.LAWS:
        name = effect.INFO.name
        if name in names:
            temp = 45.0 if name == "pickoff_drift" else 25.0
            on = config.changed(base, {f"effects.{name}": effect.EXAMPLE})
            # slips of re-timed edges are other ones with an effect: several ppm in one dwell
            models = [Model(disable_retiming(c)) for c in (base, on)]
            jobs += [(name, Run(m, k, SEED, base, smooth=True)) for m in models for k in conditions(temp)]
    found = bench.run([run for _, run in jobs], FAST)
    for i in range(0, len(jobs), 4):
        four = [read(f, run.condition) for f, (_, run) in zip(found[i : i + 4], jobs[i : i + 4])]
        out[jobs[i][0]] = changes(four[:2], four[2:])
    return out


def table(effect, values):
    """Markdown of one page."""
    temp = ", 45 degC" if effect.INFO.name == "pickoff_drift" else ""
    lines = [f"| off to {effect.EXAMPLE:g} {effect.INFO.unit}, A = 5 um{temp} | change |", "|---|---:|"]
    for (what, unit, _, factor, digits), value in zip(ROWS, values):
        lines.append(f"| {what} | {factor * value:+.{digits}f} {unit} |")
    how = "baseband engine, edges that leave evenly, codes not rounded, `python docs/effects_pages.py`"
    lines += ["", f"Measured 1.5 to 2.5 s after a locked state, {how}."]
    return "\n".join(lines)


PAGE = """# {name}

{head}

{source}

{applied}

{terms}

**Fingerprint.** {fingerprint}.

<!-- measured: python docs/effects_pages.py -->

<!-- end -->
"""
APPLIED = "**Applied** as laws of [ports](../parts/ports.md#laws); of the size of the table below:"


def parts(effect):
    """{part of a page: text} that the module says."""
    i = effect.INFO
    about = " ".join(effect.__doc__.split("\n\n")[0].split()).rstrip(".")
    where = f"Port {i.port}, mechanism {i.mechanism}, unit {i.unit}. Off: 0. Catalogue {effect.IDS}"
    return {
        "head": f"{about}. {where}; `effects.{i.name}` in a configuration.",
        "source": f"**Source.** {i.source[0].upper()}{i.source[1:]}.",
        "applied": APPLIED,
        "terms": "\n".join(f"    {text}" for text in effect.terms(effect.EXAMPLE, device.Device())),
        "fingerprint": i.fingerprint,
    }


def renew(effect, page=None):
    """The page with what the module says; made if it is None. Its measured table stays as it is."""
    said = parts(effect)
    if page is None:
        return PAGE.format(name=effect.INFO.name, **said)
    title, _, rest = page.split("\n\n", 2)
    rest = re.sub(r"^\*\*Source\.\*\* .*$", lambda _: said["source"], rest, count=1, flags=re.M)
    before, after = rest.split(f"{APPLIED}\n\n")
    after = after.split("\n\n", 1)[1]
    return "\n\n".join((title, said["head"], f"{before}{APPLIED}", said["terms"], after))


def main(names):
    """Renew the pages of the named effects, or of all, and the indices that list them; returns the exit code."""
    known = {effect.INFO.name: effect for effect in catalogue.LAWS}
    if unknown := set(names) - set(known):
        print(f"{', '.join(sorted(unknown))}: not among {', '.join(known)}", file=sys.stderr)
        return 2
    chosen = names or list(known)
    for name, values in measure_table(chosen).items():
        path = FOLDER / f"{name}.md"
        page = renew(known[name], path.read_text() if path.exists() else None)
        write_text(path, replace_part(page, "measured", table(known[name], values)))
    pages.renew(pages.OF_EFFECTS)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
