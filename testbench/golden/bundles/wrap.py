"""Folder of a bundle for a design with names, reset and latency of its own: `make check` in it needs no Python.

    stim.hex, exp.hex, mask.hex   the rows that are judged; ports that come later are shifted; the mask has the level's
    golden_BLOCK.v, .vhd          wrapper of the design (`wrapper`)
    map.toml, latency.toml        what the folder was written from
    the rest                      benches and scripts of the bundle, with the wrapper's name and the level

Of the whole design: a bundle of its pins alone, `pins_of`.
Source  docs/foreign_designs.md, docs/golden.md (pins alone)
"""

import re
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, top
from testbench.golden.foreign import design_map, judged, wrapper
from testbench.storage.files import replacing_folder

KEPT = ("params.vh", "params.svh", "params_pkg.vhd", "Makefile", "run_vunit.py")


def _texts(folder, manifest, level):
    """{path: text} of the bundle's benches and scripts for a wrapped design."""
    block, rows = manifest["block"], manifest["n"]
    names = [*KEPT, "check.sh", f"tb_{block}.v", f"tb_{block}.vhd", f"tb_{block}_vunit.vhd", f"cocotb_{block}.v",
             f"test_{block}.py", *(n for n in manifest["sha256"] if n.startswith("rom/"))]  # fmt: skip
    found = {}
    for name in names:
        text = (folder / name).read_text()
        if name not in KEPT:
            text = re.sub(rf"\bgyro_{block}\b", wrapper.name_of(manifest), text)
        found[name] = text
    script, test = "check.sh", f"test_{block}.py"
    found[script] = re.sub(r"(?m)(?<=^LEVEL=\$\{LEVEL:-)\w+", level, found[script])
    found[script] = re.sub(r"(?m)^LEVELS=.*$", f'LEVELS="{level}"', found[script])
    # a design of other names has no file of the block's name
    found[script] = found[script].replace('no $BLOCK.$(suffix "$1") in $RTL', "no file of its language in RTL or FILES")
    found[test] = re.sub(r'(?<=or ")registers(?=")', level, found[test], count=1)
    for name in KEPT[:3]:
        for key, value in (("N_ROWS", rows), ("RESET_CYCLES", manifest["reset"]["cycles"])):
            found[name] = re.sub(rf"(\b{key}(?: : natural :)? ?= )\d+", rf"\g<1>{value}", found[name])
    return found


def around_top(manifest, map_path, top_name=None):
    """{path: text} of the wrapper of a whole design with pins of its own names: a module gyro_top.

    map_path, top_name  as of `design_map.read`; ConfigError for a design whose name is the wrapper's
    """
    named = design_map.read(map_path, manifest, "pins", top_name)
    if named.top == wrapper.name_of(manifest):
        raise ConfigError(f"{map_path or '--top'}: top: {named.top} is the name of the wrapper; rename yours")
    if named.style != "sync":
        raise ConfigError(f"{map_path}: reset.style: {named.style!r} is not 'sync': the recordings of top hold resets")
    texts = {"golden_top.v": wrapper.verilog(manifest, named), "golden_top.vhd": wrapper.vhdl(manifest, named)}
    return texts | ({"map.toml": Path(map_path).read_text()} if map_path else {})


def pins_of(folder, level, out, map_path=None, top_name=None, latency=None):
    """Write the bundle of the pins of a bundle of the whole design; returns its manifest.

    map_path, top_name  of a design with names of its own;  latency  file of the pins that come later
    """
    if level not in ("pins", "outputs"):
        raise ConfigError(f"level: {level!r} is not one of pins, outputs; the bundle itself is at level registers")
    golden = bundle.read(folder)
    late = top.late_of(folder, golden.manifest)
    if latency is not None:
        late = {name.removeprefix("o_"): k for name, k in judged.read_latency(latency, golden.manifest, level).items()}
    if out.is_dir() and any(out.iterdir()):
        raise FileError(f"{out}: exists and is not an empty folder")
    of_board = "design" in golden.manifest
    own = map_path is not None or top_name is not None
    texts = around_top(golden.manifest, map_path, top_name) if own else {}
    return top.write(top.replayed(folder, golden.manifest), out, golden.at, of_board, "pins", more=texts, clocks=late)


def wrap(folder, map_path, level, out, latency_path=None):
    """Write the folder of a bundle, a map, a level and a latency file; returns its `Judged` part of the bundle.

    out  new folder; FileError if it is there and holds anything
    """
    folder, out = Path(folder), Path(out)
    golden = bundle.read(folder)
    named = design_map.read(map_path, golden.manifest, level)
    clocks = {} if latency_path is None else judged.read_latency(latency_path, golden.manifest, level)
    found = judged.judged(golden, level, named.style, clocks)
    manifest = found.golden.manifest
    exp, mask = judged.late_rows(found)
    widths = {name: [p["width"] for p in ports] for name, ports in (
        ("stim", manifest["inputs"]), ("exp", manifest["registers"] + manifest["outputs"]))}  # fmt: skip
    texts = _texts(folder, manifest, level)
    for name, rows, like in (("stim", found.golden.stim, "stim"), ("exp", exp, "exp"), ("mask", mask, "exp")):
        texts[f"{name}.hex"] = bundle.hex_text(bundle.pack(rows, widths[like]), sum(widths[like]))
    head = f"golden_{manifest['block']}"
    texts |= {f"{head}.v": wrapper.verilog(manifest, named), f"{head}.vhd": wrapper.vhdl(manifest, named)}
    texts["map.toml"] = Path(map_path).read_text()
    if latency_path is not None:
        texts["latency.toml"] = Path(latency_path).read_text()
    keys = ("schema", "block", "case", "clock", "reset", "n", "inputs", "registers", "outputs", "params", "levels")
    told = {key: manifest[key] for key in keys if key in manifest}
    told |= {"level": level, "first_row": found.first, "clocks": found.clocks,
             "of_bundle": golden.manifest["manifest_sha256"]}  # fmt: skip
    texts["manifest.json"] = bundle.canonical(told) + "\n"
    with replacing_folder(out) as new:
        for name, text in texts.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)
    return found
