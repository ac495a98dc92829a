"""What effects change: python docs/effects_pages.py [NAME ...] measures and renews tables of docs/results/effects.json

A table compares the default gyroscope in the baseband engine at 5 um without the effect and with it, with the same
noise: drive frequency, drive word, bias, scale factor, V_q. `effect_section` gives what the built page of an effect
has below its docstring.
"""

import importlib
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from analog_frontend.effects import catalogue  # noqa: E402
from analog_frontend.parts import device  # noqa: E402
from testbench import config  # noqa: E402
from testbench.console import results  # noqa: E402
from testbench.console.markdown import markdown  # noqa: E402
from testbench.console.text_table import Table  # noqa: E402
from testbench.measured.closed_loop import loop_runs  # noqa: E402
from testbench.measured.closed_loop.loop_runs import FAST, Model, Run  # noqa: E402
from testbench.measured.closed_loop.loop_tangents import disable_retiming  # noqa: E402
from testbench.measured.record.recording_plan import Condition  # noqa: E402

PACKAGE = "analog_frontend.effects"
NAME, COMMAND = "effects", "python docs/effects_pages.py"  # of the file in docs/results, and what measures it
SETTLE_S, DWELL_S, RATE_DPS, SEED = 1.5, 1.0, 50.0, 3
ROWS = (
    ("drive frequency", "mHz", "rest", 1e3, 3),
    ("drive word", "ppm", "rest", 1e6, 2),
    ("bias", "deg/h", "rest", 3600.0, 3),
    ("scale factor", "ppm", "both", 1e6, 2),
    ("V_q squared", "V^2", "rest", 1.0, 6),
)
NOTE = "Measured 1.5 to 2.5 s after a locked state, baseband engine, edges that leave evenly, codes not rounded."
# keys of the effects that are no laws of the catalogue
KEYS = {
    "duffing": "effects.duffing_k3_per_um2",
    "drive_cubic": "effects.drive_cubic_per_v2",
    "feedthrough_y": "effects.feedthrough_y",
    "rate_vibration": "scenario.rate_dps",
}


# ---- measurement -----------------------------------------------------------------------------------------------------


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
    """{name: changes} of effects at the sizes of their tables."""
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
    """`Table` of the measured changes of one effect."""
    temp = ", 45 degC" if effect.INFO.name == "pickoff_drift" else ""
    rows = [
        (what, f"{factor * value:+.{digits}f} {unit}") for (what, unit, _, factor, digits), value in zip(ROWS, values)
    ]
    heads = (f"off to {effect.EXAMPLE:g} {effect.INFO.unit}, A = 5 um{temp}", "change")
    return Table(effect.INFO.name, heads, rows, NOTE, numeric=(1,))


# ---- the built page of an effect -------------------------------------------------------------------------------------


def _module(module_name):
    """The module of a dotted name or of its last part."""
    stem = module_name.rpartition(".")[2]
    return importlib.import_module(PACKAGE if stem == "effects" else f"{PACKAGE}.{stem}")


def effect_section(module_name):
    """Markdown below the docstring of an effect's page; "" for a module that is no effect.

    An effect without a law of the catalogue has neither terms nor a measured table.
    """
    module = _module(module_name)
    if not hasattr(module, "INFO"):
        return ""
    info = module.INFO
    rows = [("port", info.port), ("mechanism", info.mechanism), ("unit", info.unit)]
    if hasattr(module, "IDS"):
        rows.append(("id", module.IDS))
    rows.append(("switched on by", f"`{KEYS.get(info.name, f'effects.{info.name}')}`"))
    parts = [
        markdown(Table("", ("property", "value"), rows, numeric=())),
        f"**Source.** {info.source[0].upper()}{info.source[1:]}.",
    ]
    if hasattr(module, "terms"):
        lines = [f"    {text}" for text in module.terms(module.EXAMPLE, device.Device())]
        size = f"{module.EXAMPLE:g} {info.unit}".removesuffix(" 1")
        parts += [f"**Laws** at a size of {size}, for the default board:", "\n".join(lines)]
    parts.append(f"**Fingerprint.** {info.fingerprint[0].upper()}{info.fingerprint[1:]}.")
    command, tables = results.read_results(NAME)
    measured = [one for one in tables if one.title == info.name]
    parts += [f"{markdown(one)}\n\n{one.note} `{command} {info.name}` repeats it." for one in measured]
    return "\n\n".join(parts)


# ---- command ---------------------------------------------------------------------------------------------------------


def main(names):
    """Measure the named effects, or all, and renew their tables; returns the exit code."""
    known = {effect.INFO.name: effect for effect in catalogue.LAWS}
    if unknown := set(names) - set(known):
        print(f"{', '.join(sorted(unknown))}: not among {', '.join(known)}", file=sys.stderr)
        return 2
    tables = {one.title: one for one in results.read_results(NAME)[1]}
    tables |= {name: table(known[name], values) for name, values in measure_table(names or list(known)).items()}
    results.write_results(NAME, COMMAND, [tables[name] for name in known if name in tables])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
