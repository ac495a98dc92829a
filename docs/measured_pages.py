"""Tables of docs/measured_results.md from docs/results/measured_parts.json, which a run of all sets gives.

    python docs/measured_pages.py build/measured.json     docs/results/measured_parts.json from a run
    summary     of each job: verdict, effects, held-out errors, what is left; of each set: the closed loop
Source    docs/measured_results.md
"""

import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from testbench.console.markdown import markdown  # noqa: E402
from testbench.console.text_table import Table  # noqa: E402
from testbench.measured.exam.part_page import is_unexplained, number  # noqa: E402
from testbench.measured.sets_report import residual_sentence  # noqa: E402
from testbench.storage.files import write_text  # noqa: E402

STORED = ROOT / "docs" / "results" / "measured_parts.json"
EFFECT = ("law", "port", "value", "sd", "unit", "kind", "status", "hz", "quality", "full_v", "bits", "coefficients")
HELD = ("unit", "floor", "noise", "before", "after_one_law", "after")
RESONATORS = ("silverbox", "quartz_vna", "mems_ringdown")


def summary(data):
    """What the pages need of build/measured.json."""
    out = {}
    for name, found in data.items():
        jobs = [
            {
                "label": job["label"],
                "verdict": job["verdict"],
                "effects": [{k: _short(e[k]) for k in EFFECT if k in e} for e in job["effects"]],
                "heldout": {p: {k: _short(h[k]) for k in HELD if k in h} for p, h in job["heldout"].items()},
                "rest": {
                    p: residual_sentence(job, p) for p, h in job["heldout"].items() if is_unexplained(h) or _tested(job)
                },
            }
            for job in found["jobs"]
        ]
        loop = [{k: _short(v) for k, v in row.items() if k != "words"} for row in found.get("closed_loop", ())]
        out[name] = {"verdict": found["verdict"], "jobs": jobs, "closed_loop": loop}
    return out


def _tested(job):
    return any(r.get("where") for r in job.get("left", ()))


def _short(value):
    if isinstance(value, dict):
        return {k: _short(v) for k, v in value.items()}
    return float(f"{value:.6g}") if isinstance(value, float) else value


def heldout_part(kept, sets):
    """Every held-out part of these sets: floor, before, after one law, after."""
    rows = []
    for name in sets:
        for job in kept[name]["jobs"]:
            for part, h in job["heldout"].items():
                ratio = "-" if not h.get("floor") else f"{h['after'] / h['floor']:.2f}"
                cells = (h.get("floor"), h["before"], h.get("after_one_law"), h["after"])
                rows.append((job["label"], part, h["unit"], *(number(c, 3) for c in cells), ratio, job["verdict"]))
    heads = ("recording", "held out", "unit", "floor", "before", "one law", "after", "after / floor", "verdict")
    return markdown(Table("", heads, rows, numeric=(3, 4, 5, 6, 7)))


def loop_part(kept):
    """What each effect does in the closed loop; the control first."""
    rows = {}
    for found in kept.values():
        for row in found["closed_loop"]:
            cells = (row["scale_ppm"], row["bias_deg_per_h"], row["noise_percent"])
            rows[row["effect"]] = (row["effect"], *(f"{c:.3g}" for c in cells))
    heads = ("effect", "scale factor (ppm)", "bias (deg/h)", "noise at rest (%)")
    return markdown(Table("", heads, list(rows.values()), numeric=(1, 2, 3)))


def rest_part(kept, sets):
    """What every report says of the rest: above 1.5 floors, or where the part has a test of its own."""
    lines = []
    for job in (job for name in sets for job in kept[name]["jobs"]):
        lines += [f"- {job['label']}, {part}: {words}." for part, words in job["rest"].items()]
    return "\n".join(lines)


def _stored():
    return json.loads(STORED.read_text())


def _others(stored):
    return [name for name in stored if name not in RESONATORS and name != "paper_numbers"]


PARTS = {
    "parts_heldout": lambda: heldout_part(_stored(), _others(_stored())),
    "parts_rest": lambda: rest_part(_stored(), _others(_stored())),
    "parts_loop": lambda: loop_part(_stored()),
    "resonators_heldout": lambda: heldout_part(_stored(), RESONATORS),
    "resonators_rest": lambda: rest_part(_stored(), ["quartz_vna"]),
}


def main(arguments=None):
    """Store a run's numbers; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if len(arguments) != 1:
        print("usage: python docs/measured_pages.py build/measured.json", file=sys.stderr)
        return 2
    data = json.loads(Path(arguments[0]).read_text())
    write_text(STORED, json.dumps(summary(data), indent=1, sort_keys=True) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
