"""Every key of every kind of file, in turn a module, a library, a path outside.

    python -m tests.fuzz.named FOLDER [FORMAT ...]     prints [format, variants, findings], a line each

The keys are those of the files themselves, so a new one is tried as well: of those that hold a text one of each name
and depth with three values; without FORMAT everything with seven, as a key, too. A finding is an import, a library, a
process or code that the value names, a file written outside of the working folder, a file outside that is read although
the key is no path of an input (`PATHS`), or a traceback.
"""

import contextlib
import copy
import functools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import h5py

from testbench.campaign.rerun import rerun
from testbench.errors import ConfigError, FileError
from tests.fuzz import commands, corpus, hostile, kinds, watch

PATHS = {
    "effects.files": "law files, beside the configuration",
    "scenario.resume": "state file to start from",
    "set.scenario.resume": "the same, in a plan of a campaign",
    "base": "configuration that a plan of a campaign starts from",
    "file": "table that a column map describes",
}


class Format(NamedTuple):
    """A kind of file.

    tree   what it holds, as dictionaries and lists
    write  (tree) -> None: makes the file
    reads  functions and command lines that read it
    """

    tree: object
    write: object
    reads: list


def toml_file(folder, name, tree, *reads):
    """A TOML file of a tree; keys without quotes, as people write them."""

    def write(changed):
        (folder / name).write_text(re.sub(r'^"(\w+)" = ', r"\1 = ", hostile.toml(changed), flags=re.M))

    return Format(tree, write, list(reads))


def configuration(files, folder):
    """With law files and a state; also that of an interrupted run."""
    tree = tomllib.loads((files / "whole.toml").read_text())
    tree["effects"]["files"] = ["law.toml"]
    shutil.copy(files / "law.toml", folder)
    return toml_file(
        folder, "c.toml", tree, ["budget", "--config", "c.toml"], ["run", "--config", "c.toml", "--out", "new"]
    )


def interrupted(files, folder):
    """Configuration of an interrupted run."""
    partial = folder / "cut" / "run.partial"
    shutil.copytree(corpus.WRITTEN / "interrupted" / "run.partial", partial)
    tree = tomllib.loads((partial / "config.toml").read_text())
    return toml_file(partial, "config.toml", tree, ["run", "--resume-run", "cut"])


def law(files, folder):
    """Law file."""
    (folder / "c.toml").write_text('[effects]\nfiles = ["law.toml"]\n')
    tree = tomllib.loads((files / "law.toml").read_text())
    return toml_file(folder, "law.toml", tree, ["budget", "--config", "c.toml"])


def campaign(files, folder):
    """Plan of a campaign, with all that a plan may have."""
    cases = [{"name": "a", "engine": "frame", "plant.qx": 1e5}, {"name": "b", "engine": "lanes"}]
    tree = {"engine": "frame", "base": "base.toml", **corpus.CAMPAIGN}
    tree["set"] = tree["set"] | {"scenario.resume": ""}
    tree["axes"] = tree["axes"] | {"case": {"cases": cases}}
    (folder / "base.toml").write_text("[plant]\nfx_hz = 11010.0\n")
    return toml_file(
        folder, "p.toml", tree, ["campaign", "check", "p.toml"], ["campaign", "run", "p.toml", "--out", "new"],
        ["study", "p.toml", "--out", "new"],
    )  # fmt: skip


def measured(files, folder):
    """Plan of a measurement record."""
    tree = corpus.MEASURED | {"truth": {"plant.qx": 1e5}}
    return toml_file(folder, "p.toml", tree, ["measured", "record", "p.toml", "--out", "new.h5"])


def imported(files, folder):
    """Map of an import."""
    shutil.copy(files / "lab.csv", folder)
    argv = ["measured", "import", "lab.csv", "--map", "m.toml", "--out", "new.h5"]
    return toml_file(folder, "m.toml", corpus.LAB, argv)


def signals(files, folder):
    """Map of the signals of a dump."""
    read = kinds.against(files, log=files / "toy.vcd", signals=folder / "m.toml")
    return toml_file(folder, "m.toml", corpus.MAP, read)


def _dds(files):
    """Bundle of a block."""
    from testbench.golden.bundles import export
    from testbench.golden.stimulus import blocks

    path = files / "golden" / "dds" / "default"
    if not path.exists():
        export.export_case(blocks.BLOCKS["dds"], "default", path)
    return path


def design(files, folder):
    """Map of a design."""
    from testbench.golden.foreign import design_map

    manifest = json.loads((_dds(files) / "manifest.json").read_text())
    ports = {port["name"]: {"port": port["name"], "type": "unsigned"} for port in manifest["inputs"]}
    ports.pop("rst", None)
    tree = {
        "schema": design_map.SCHEMA, "top": "toy", "library": "work_of_toy", "clock": {"port": "clk"},
        "reset": {"port": "rst", "active": 1, "style": "sync"}, "inputs": ports, "outputs": {},
    }  # fmt: skip
    return toml_file(folder, "m.toml", tree, ["golden", "wrap", str(_dds(files)), "--map", "m.toml", "--out", "new"])


def latency(files, folder):
    """Latencies of a design."""
    from testbench.golden.foreign import comparison_scope

    manifest = json.loads((_dds(files) / "manifest.json").read_text())
    ports = {port["name"]: 1 for port in manifest["outputs"]}
    read = functools.partial(comparison_scope.read_latency, folder / "l.toml", manifest, "outputs")
    return toml_file(folder, "l.toml", {"schema": comparison_scope.SCHEMA, "ports": ports}, read)


def bundle(files, folder):
    """Manifest of a golden bundle, sealed again."""
    from testbench.golden.bundles import bundle as bundles

    shutil.copytree(_dds(files), folder / "toy")
    path = folder / "toy" / bundles.MANIFEST

    def write(tree):
        with contextlib.suppress(Exception):  # what has no seal is read without
            tree["manifest_sha256"] = bundles.seal(tree)
        path.write_text(json.dumps(tree))

    (folder / "m.toml").write_text('schema = "gyro-design-map/1.0"\n')
    reads = [["golden", "verify", "toy"], ["golden", "wrap", "toy", "--map", "m.toml", "--out", "new"],
             ["golden", "window", "toy", "--clock", "0", "--count", "4", "--out", "new"]]  # fmt: skip
    return Format(json.loads(path.read_text()), write, reads)


def store(files, folder):
    """Head, plan, journal and points of a store."""
    from testbench.campaign import shard
    from testbench.campaign.plan.plan_points import canonical, point_address
    from testbench.campaign.store import Store

    shutil.copytree(files / "store", folder / "s")
    kept = Store.open_folder(folder / "s")
    plan = json.loads((folder / "s" / "plans" / "two.json").read_text())
    plan.pop("sha256", None)
    first = kept.addresses()[0]
    identity, variables = shard.decode(kept.point_path(first).read_bytes(), "point")
    (journal,) = (folder / "s" / "journal").iterdir()
    tree = {"head": json.loads((folder / "s" / "store.json").read_text()), "plan": plan, "point": json.loads(identity),
            "event": json.loads(journal.read_text().splitlines()[0])}  # fmt: skip
    known, named = kept.point_path(first).read_bytes(), []

    def write(changed):
        for path in named:
            path.unlink(missing_ok=True)
        (folder / "s" / "store.json").write_text(json.dumps(changed["head"]))
        text = canonical(changed["point"])
        named[:] = [kept.point_path(point_address(text))]
        named[0].parent.mkdir(exist_ok=True)
        named[0].write_bytes(known if text == identity else shard.encode(text, variables, plan["keep"]["tau_s"]))
        stated = copy.deepcopy(changed["plan"])
        if isinstance(stated, dict) and isinstance(stated.get("points"), list):
            stated["points"] = [point_address(text) if one == first else one for one in stated["points"]]
        (folder / "s" / "plans" / "two.json").write_text(canonical(stated))
        journal.write_text(json.dumps(changed["event"]) + "\n")

    def again():
        rerun(folder / "s", point_address(canonical(json.loads(shard.decode(named[0].read_bytes(), "")[0]))))

    words = [["campaign", word, "s"] for word in ("status", "show", "collect")]
    return Format(tree, write, [*words, ["campaign", "table", "s", "--out", "new.parquet"], again])


def column_map(files, folder):
    """Column map of a table."""
    source = files / "maps" / "meters"
    shutil.copy(source / "data", folder)
    tree = tomllib.loads((source / "map.toml").read_text())
    return toml_file(folder, "m.toml", tree, ["measured", "check", "m.toml"], ["measured", "trace", "m.toml"])


def sheet(files, folder):
    """Tolerances of a data sheet."""
    from testbench.measured.wide import data_sheet as sheets

    return toml_file(
        folder, "s.toml", tomllib.loads(sheets.BUNDLED_PATH.read_text()), lambda: sheets.read(folder / "s.toml")
    )


def target(files, folder):
    """Board and what it must reach, for `gyro design`."""
    from testbench.design import target as targets

    tree = {
        "target": {"bandwidth_hz": 3.5}, "nominal": {"fx_hz": 14000.7, "fy_hz": 13980.7},
        "firmware": {"board": "analog_sid"}, "design": {"adc": "generic"},
    }  # fmt: skip
    return toml_file(folder, "t.toml", tree, lambda: targets.load(folder / "t.toml"))


def record(name):
    """Attributes, versions and configuration of a record, whose hash is made again."""

    def attributes(files, folder):
        from testbench.storage import record_read
        from testbench.storage.record import write_record

        held = record_read.read_record(files / name)
        tree = {"attrs": dict(held.attrs), "versions": dict(held.versions), "config": tomllib.loads(held.config_toml)}

        def write(changed):
            more = {"attrs": changed["attrs"], "versions": changed["versions"]}
            write_record(folder / "a.h5", replace(held, config_toml=_text(changed["config"]), **more))

        words = [["check", "--no-replay", "a.h5"], ["trace", "a.h5"]]
        return Format(tree, write, [["measured", *argv] for argv in words])

    return attributes


def _text(tree):
    return hostile.toml(tree) if isinstance(tree, dict) else str(tree)


def state(files, folder):
    """Attributes and configuration of a state."""
    from testbench import config
    from testbench.run.simulation import Simulation
    from testbench.storage.state_file import save_state

    with h5py.File(files / "state.h5", "r") as file:
        values = {name: data[()] for name, data in file["state"].items()}
        layout, meta = file.attrs["source_format"], json.loads(file.attrs["meta"])
    tree = {"layout": layout, "meta": meta, "config": tomllib.loads(meta.pop("config_toml"))}

    def write(changed):
        meta = changed["meta"] | {"config_toml": _text(changed["config"])}
        save_state(folder / "a.h5", values, changed["layout"], meta)

    simulation = Simulation(config.changed(config.Config(), {"scenario.across_versions": True}), 25.0, 25.0)
    return Format(tree, write, [lambda: simulation.restore(folder / "a.h5")])


FORMATS = {
    "configuration": configuration, "interrupted run": interrupted, "law": law, "campaign": campaign,
    "measured plan": measured, "import": imported, "signals": signals, "design": design, "latency": latency,
    "bundle": bundle, "store": store, "column map": column_map, "sheet": sheet, "target": target,
    "record": record("gyrorec.h5"), "run": record("run.h5"), "state": state,
}  # fmt: skip


def _has_text(tree):
    return any(isinstance(_at(tree, place), str) for place in hostile.places(tree))


def _at(tree, place):
    return functools.reduce(lambda node, step: node[step], place, tree)


def variants(tree, values, everything=False):
    """(dotted place, value, tree) with each value for each text; with `everything` for all else, and as keys, too."""
    alike, everything = Counter(), everything or not _has_text(tree)
    for place in hostile.places(tree):
        item = _at(tree, place)
        alike[len(place), str(place[-1])] += 1
        if any(isinstance(step, int) and step > 1 for step in place):
            continue  # more of the same list
        if not everything and (not isinstance(item, str) or alike[len(place), str(place[-1])] > 1):
            continue
        dotted = ".".join(step for step in place if isinstance(step, str))
        for value in values if isinstance(item, str) else values[:2]:
            for renamed in (False, True)[: 1 + (everything and isinstance(place[-1], str))]:
                changed = copy.deepcopy(tree)
                node = _at(changed, place[:-1])
                if renamed:
                    node[value] = node.pop(place[-1])
                else:
                    node[place[-1]] = value
                yield dotted, value, changed


def _one(read):
    """What is wrong with how a reader ends, or nothing."""
    try:
        read() if callable(read) else commands.said(read)
    except (ConfigError, FileError):
        return ""
    except BaseException as error:
        return f"{type(error).__name__}: {str(error)[:300]}"
    return ""


def tried(name, files, root, values, opened, everything=False):
    """(variants, findings) of a format."""
    folder = root / "a" / name.replace(" ", "_")
    folder.mkdir(parents=True)
    os.chdir(folder)
    form = FORMATS[name](files, folder)
    form.write(copy.deepcopy(form.tree))
    findings = [f"as it is: {wrong}" for read in form.reads if (wrong := _one(read))]
    count = 0
    for dotted, value, changed in variants(form.tree, values, everything):
        count += 1
        with contextlib.suppress(Exception):  # what cannot be written is no input
            form.write(changed)
        opened.since()
        for read in form.reads:
            with watch.over(folder, *_caches()) as seen:
                wrong = _one(read)
            seen += [f"read {path}" for path in opened.since() if dotted not in PATHS]
            findings += [f"{dotted} = {value!r}: {line}" for line in [*seen, *([wrong] if wrong else [])]]
    return count, findings


def _caches():
    return filter(None, (os.environ.get("GYRO_CACHE"), tempfile.gettempdir(), "/proc"))


def main(root, *chosen):
    """Try some formats, or all of them in full."""
    everything = not chosen
    out = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    root = Path(root).resolve()
    files = corpus.make(root / "files")
    tempfile.tempdir = str(root / "a" / "tmp")
    Path(tempfile.tempdir).mkdir(parents=True)
    library, plant, canary = root / hostile.LIBRARY, root / hostile.PLANT, root / "outside.txt"
    library.write_bytes(b"no library")
    if shutil.which("cc"):
        text = f'#include <stdio.h>\n__attribute__((constructor)) void ran(void) {{ fopen("{root}/ran", "w"); }}\n'
        subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", library], input=text, text=True, check=True)
    plant.write_text(f"open({str(root / 'ran')!r}, 'w')\n")
    canary.write_text("nobody reads this")
    module = f"{hostile.MODULE}:OBJECT"
    values = [module, str(library), str(canary)]
    if everything:
        values += [hostile.MODULE, str(plant), "../../outside.txt", "/etc/passwd"]
    commands.prepare()
    opened = watch.Opened(library, plant, canary)
    for name in chosen or FORMATS:
        print(json.dumps([name, *tried(name, files, root, values, opened, everything)]), file=out, flush=True)
    print(json.dumps(["ran", 0, [str(path) for path in root.glob("ran")]]), file=out, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
