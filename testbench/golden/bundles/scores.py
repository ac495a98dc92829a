"""Mutation scores and times of `make rtl` as they were measured last, with what they belong to.

    scores.json    one entry per bundle, with hashes of its vectors and of the design; times of the parts
    manifests      an export notes the score of a bundle whose vectors and design are those that were scored

`python docs/rtl_page.py scores OUT` takes over what `make rtl` left in OUT/golden.
Source  docs/rtl.md, docs/golden.md (how good the vectors are)
"""

import functools
import hashlib
import json
import re
from pathlib import Path

from testbench.golden.bundles import bundle

FILE = Path(__file__).with_name("scores.json")
MUTATION, TIMES = "mutation.json", "rtl.json"
KEYS = ("block", "case", "seed", "mutants", "killed", "equivalent", "undecided", "score")


def vectors(manifest):
    """Hash of what a score of these vectors depends on: words and parameters, not benches and waves."""
    if manifest["schema"] == bundle.REPLAY_SCHEMA:
        return manifest["recording_sha256"]
    hash_inputs = [manifest["sha256"][f"{name}.hex"] for name in bundle.hex_stems(manifest)] + [manifest["params"]]
    return hashlib.sha256(bundle.canonical(hash_inputs).encode()).hexdigest()


def design(paths):
    """Hash of Verilog, whatever its comments and spaces."""
    texts = [re.sub(r"//[^\n]*", "", path.read_text()).split() for path in sorted(paths)]
    return hashlib.sha256(bundle.canonical(texts).encode()).hexdigest()


def entry(outcome, vector_hashes, design_hash, cpu_s):
    """JSON of an outcome; `vector_hashes` is {case: hash}. Proved faults are counted, the others listed."""
    outcome_dict = outcome.to_dict()
    unproved_faults = [s for s in outcome_dict["survivors"] if s["verdict"] != "equivalent"]
    survivor_entries = [{k: s[k] for k in ("verdict", "fault", "source", "why")} for s in unproved_faults]
    return {k: outcome_dict[k] for k in KEYS} | {
        "vectors": vector_hashes, "design": design_hash, "cpu_s": round(cpu_s, 1), "left": survivor_entries,
    }  # fmt: skip


def stored_scores():
    """What is stored."""
    return json.loads(FILE.read_text())


def missing_scores(out):
    """Entries that a measurement left in a folder, else those that are stored."""
    path = out / MUTATION
    return json.loads(path.read_text()) if path.is_file() else stored_scores()["mutation"]


@functools.cache
def _entries():
    return {(e["block"], case): e for e in stored_scores()["mutation"] for case in e["vectors"]}


def note_score(manifest):
    """Entry for a sealed manifest's provenance: its score, if these very vectors were scored; else empty."""
    score_entry = _entries().get((manifest["block"], manifest["case"]))
    if score_entry is None or score_entry["vectors"][manifest["case"]] != vectors(manifest):
        return {}
    return {"mutation": {k: v for k, v in score_entry.items() if k not in ("vectors", "cpu_s")}}
