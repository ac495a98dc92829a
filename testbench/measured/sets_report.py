"""All measured sets, unattended: each through the openers, one page, build/measured.json.

    jobs      each of `kinds.KINDS` says which files belong together; what none takes goes by itself
    files     folders of sets in GYRO_DATA_DIR, or those that the registry has downloaded
    a job that fails is a row of the page with its reason, and the exit status is 1; the others go on
JSON      {set: {verdict, sentence, effects, heldout, jobs: [...]}}; effects of all jobs, each with its `job`; held-out
          parts carry the label of their job in front where there are several; verdict and sentence are those of the
          least settled job, in the order of UNSETTLED; `closed_loop`: what the effects do there, and a control run
Source    docs/measured_results.md
"""

import argparse
import html
import json
import os
import sys
import time
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.measured import kinds, trace_recording
from testbench.measured.closed_loop import loop_trace
from testbench.measured.exam import part_page
from testbench.measured.openers import open_problem
from testbench.storage.files import write_text

UNSETTLED = ("firmware", "unexplained", "named in part", "confounded", "candidate", "named", "noise-model", "none")
SKIPPED = ("README", "LICENSE")


def folders(root):
    """{set: [paths]} of a data folder."""
    root = Path(root)
    if not root.is_dir():
        raise FileError(f"{root}: no such folder; GYRO_DATA_DIR names the folder of the sets")
    return {
        d.name: sorted(p for p in d.iterdir() if p.is_file() and not p.name.startswith(SKIPPED))
        for d in sorted(root.iterdir())
        if d.is_dir()
    }


def jobs(paths):
    """[(label, paths, options)] of a set's files: what the parts say, else one file each."""
    out, assigned_paths = [], set()
    for kind in kinds.KINDS:
        for label, chosen, options in kind.jobs(paths):
            out.append((label, chosen, options))
            assigned_paths |= set(chosen)
    return out + [(path.stem, [path], {}) for path in paths if path not in assigned_paths]


def trace_job(paths, options):
    """(JSON, picture) of one job."""
    report_and_picture = trace_recording.trace_table(paths, options)
    if report_and_picture is None:
        problem = open_problem(paths, options)
        report_and_picture = trace_recording.trace_problem(problem) or (loop_trace.run(problem)[1].to_json(), "")
    return report_and_picture


def run(sets, say=print):
    """({set: JSON}, {set: [(label, JSON, picture)]}, [failures]) of {set: paths}."""
    out, reports_by_set, failures = {}, {}, []
    for name, paths in sets.items():
        rows = []
        for label, chosen, options in jobs(paths):
            start = time.monotonic()
            try:
                data, image = trace_job(chosen, options)
            except Exception as problem:  # unattended: one job's defect is a row of the page, not the end of the others
                text = str(problem) if isinstance(problem, (ConfigError, FileError)) else repr(problem)
                failures.append((name, label, text))
                say(f"{name}: {label}: {text}")
                continue
            seconds = time.monotonic() - start
            rows.append((label, data, image))
            say(f"{name}: {label}: {data['verdict']}, laws: {len(data['effects'])}, {seconds:.0f} s")
        reports_by_set[name] = rows
        if rows:
            out[name] = join_reports(rows)
    return out, reports_by_set, failures


def join_reports(rows):
    """JSON of a set from its jobs."""
    speaks = min((data for _, data, _ in rows), key=lambda data: UNSETTLED.index(data["verdict"]))
    heldout = {}
    for other, data, _ in rows:
        prefix = "" if len(rows) == 1 else f"{other}: "
        heldout |= {prefix + key: value for key, value in data["heldout"].items()}
    return {
        "verdict": speaks["verdict"],
        "sentence": speaks["sentence"],
        "effects": [e | {"job": name} for name, data, _ in rows for e in data["effects"]],
        "heldout": heldout,
        "jobs": [{"label": name} | data for name, data, _ in rows],
    }


def overview(out):
    """The before/after table of all sets."""
    rows = []
    for name, data in out.items():
        for part, h in data["heldout"].items():
            ratio = None if not h.get("floor") else h["after"] / h["floor"]
            rows.append(
                (name, part, h["unit"], part_page.number(h.get("floor")), part_page.number(h["before"]))
                + (part_page.number(h.get("after_one_law")), part_page.number(h["after"]), part_page.number(ratio, 3))
            )
    head = ("set", "held out", "unit", "floor", "before", "after one law", "after", "after / floor")
    return part_page.table(head, rows, (3, 4, 5, 6, 7))


def residual_sentence(data, part):
    """One sentence on what is left of a held-out part, from the tests in `part_page.describe_residual`."""
    for r in data.get("left", []):
        if part in (r["observable"], r["segment"], f"{r['segment']} {r['observable']}"):
            if r.get("where"):
                return r["where"]["words"]
            curve = "a curve over" if r["p"] < 0.01 else "no curve over"
            words = f"correlation of neighbours {r['neighbours']:.2f} (p {r['p']:.2g}): {curve} {r['axis']}; "
            words += f"{100 * r['tenth']:.0f} % of its power in a tenth of the rows, {r['tenth_from']:.4g} .. "
            words += f"{r['tenth_to']:.4g}"
            if r["drift"] is not None:
                drifts = "drifts" if r["drift_p"] < 0.01 else "does not drift"
                words += f"; correlation in the order of recording {r['drift']:.2f} (p {r['drift_p']:.2g}): it {drifts}"
            if r["shared"] is not None:
                words += f"; correlation with the residual of the fitted segments {r['shared']:.2f}"
            return words
    return data["sentence"]


def page(out, reports_by_set, failures, loop=""):
    """The page of `make measured`."""
    words = [
        "<p>Published recordings of single parts, compared with the parts of this model. An effect is chosen on some "
        "samples, sessions or files and tested on the others. The floor is the repeatability of the recording.</p>",
        "<h2>Error on held-out data, before and after</h2>",
        overview(out),
    ]
    if failures:
        rows = [(s, label, text) for s, label, text in failures]
        words += ["<h2>What could not be traced</h2>", part_page.table(("set", "file", "why"), rows)]
    unexplained_rows = [
        (name, label, part, f"{h['after'] / h['floor']:.2f}", residual_sentence(data, part))
        for name, rows in reports_by_set.items()
        for label, data, _ in rows
        for part, h in data["heldout"].items()
        if part_page.is_unexplained(h)
    ]
    if unexplained_rows:
        words += [
            "<h2>Not explained: held-out error above 1.5 floors</h2>",
            part_page.table(("set", "job", "held out", "after / floor", "remaining residual"), unexplained_rows, (3,)),
        ]
    for name, rows in reports_by_set.items():
        words.append(f"<h2>{html.escape(name)}</h2>")
        for label, data, image in rows:
            words.append(trace_recording.report_section(label, data, image))
    return part_page.page("Measured parts", "".join(words) + loop)


def main(arguments=None):
    """Command line; 0 if all jobs ran."""
    parser = argparse.ArgumentParser(
        prog="python -m testbench.measured.sets_report", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--data", default=os.environ.get("GYRO_DATA_DIR", ""), help="folder of the sets")
    parser.add_argument("--out", type=Path, default=Path("build"), help="folder for measured.html and measured.json")
    parser.add_argument("--only", nargs="*", help="names of the sets to trace")
    parser.add_argument("--no-loop", action="store_true", help="skip the runs of the closed loop")
    options = parser.parse_args(arguments)
    try:
        if options.data:
            sets = folders(options.data)
        else:
            from testbench.measured.formats import registry

            sets = registry.folders()
        sets = {name: paths for name, paths in sets.items() if not options.only or name in options.only}
        out, reports_by_set, failures = run(sets, lambda text: print(text, file=sys.stderr, flush=True))
        loop = ""
        if not options.no_loop:
            from testbench.measured import in_loop

            loop, numbers = in_loop.closed_loop_section(out)
            control = numbers.pop("", [])
            for name, rows in numbers.items():
                out[name]["closed_loop"] = control + rows
    except (ConfigError, FileError) as problem:
        print(problem, file=sys.stderr)
        return 2
    options.out.mkdir(parents=True, exist_ok=True)
    clean = {name: {**data, "jobs": [_strip_html(job) for job in data["jobs"]]} for name, data in out.items()}
    write_text(options.out / "measured.json", json.dumps(clean, indent=1, sort_keys=True, allow_nan=False) + "\n")
    write_text(options.out / "measured.html", page(out, reports_by_set, failures, loop))
    print(options.out / "measured.html")
    return 1 if failures else 0


def _strip_html(job):
    return {key: value for key, value in job.items() if key != "html"}


if __name__ == "__main__":
    sys.exit(main())
