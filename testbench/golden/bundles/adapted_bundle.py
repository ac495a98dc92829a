"""Folder of a bundle for a design with names, reset and latency of its own: `make check` in it needs no Python.

    stim.hex, exp.hex, mask.hex   the rows that are judged; ports that come later are shifted; the mask has the level's
    golden_BLOCK.v, .vhd          wrapper of the design (`adapter`)
    map.toml, latency.toml        what the folder was written from
    the rest                      benches and scripts of the bundle, with the wrapper's name and the level

Of the whole design: a bundle of its pins alone, `write_pin_bundle`.
Source  docs/foreign_designs.md, docs/golden.md (pins alone)
"""

import re
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, design_bundle
from testbench.golden.foreign import adapter, comparison_scope, design_map
from testbench.storage.files import replace_folder

UNRENAMED_FILES = ("params.vh", "params.svh", "params_pkg.vhd", "Makefile", "run_vunit.py")


def _bench_texts(folder, manifest, level):
    """{path: text} of the bundle's benches and scripts for a wrapped design."""
    block, rows = manifest["block"], manifest["n"]
    names = [*UNRENAMED_FILES, "check.sh", f"tb_{block}.v", f"tb_{block}.vhd", f"tb_{block}_vunit.vhd",
             f"cocotb_{block}.v", f"test_{block}.py",
             *(n for n in manifest["sha256"] if n.startswith("rom/"))]  # fmt: skip
    texts = {}
    for name in names:
        text = (folder / name).read_text()
        if name not in UNRENAMED_FILES:
            text = re.sub(rf"\bgyro_{block}\b", adapter.adapter_name(manifest), text)
            text = re.sub(r"\b1 ports\b", "1 port", text)
        texts[name] = text
    script, test = "check.sh", f"test_{block}.py"
    texts[script] = re.sub(r"(?m)(?<=^LEVEL=\$\{LEVEL:-)\w+", level, texts[script])
    texts[script] = re.sub(r"(?m)^LEVELS=.*$", f'LEVELS="{level}"', texts[script])
    # a design of other names has no file of the block's name
    texts[script] = texts[script].replace('no $BLOCK.$(suffix "$1") in $RTL', "no file of its language in RTL or FILES")
    texts[test] = re.sub(r'(?<=or ")registers(?=")', level, texts[test], count=1)
    for name in UNRENAMED_FILES[:3]:
        for key, value in (("N_ROWS", rows), ("RESET_CYCLES", manifest["reset"]["cycles"])):
            texts[name] = re.sub(rf"(\b{key}(?: : natural :)? ?= )\d+", rf"\g<1>{value}", texts[name])
    return texts


def top_wrapper_texts(manifest, map_path, top_name=None):
    """{path: text} of the wrapper of a whole design with pins of its own names: a module gyro_top.

    map_path, top_name  as of `design_map.read`; ConfigError for a design whose name is the wrapper's
    """
    port_map = design_map.read(map_path, manifest, "pins", top_name)
    if port_map.top == adapter.adapter_name(manifest):
        raise ConfigError(f"{map_path or '--top'}: top: {port_map.top} is the name of the wrapper; rename your module")
    if port_map.style != "sync":
        raise ConfigError(
            f"{map_path}: reset.style: {port_map.style!r} is not 'sync', which the resets in the recordings of top need"
        )
    texts = {"golden_top.v": adapter.verilog(manifest, port_map), "golden_top.vhd": adapter.vhdl(manifest, port_map)}
    return texts | ({"map.toml": Path(map_path).read_text()} if map_path else {})


def write_pin_bundle(folder, level, out, map_path=None, top_name=None, latency=None):
    """Write the bundle of the pins of a bundle of the whole design; returns its manifest.

    map_path, top_name  of a design with names of its own;  latency  file of the pins that come later
    """
    if level not in ("pins", "outputs"):
        raise ConfigError(f"level: {level!r} is not one of pins, outputs; the bundle itself is at level registers")
    golden = bundle.read(folder)
    delays = design_bundle.pin_delays(folder, golden.manifest)
    if latency is not None:
        latencies = comparison_scope.read_latency(latency, golden.manifest, level)
        delays = {name.removeprefix("o_"): k for name, k in latencies.items()}
    if out.is_dir() and any(out.iterdir()):
        raise FileError(f"{out}: exists and is not an empty folder")
    names_design = "design" in golden.manifest
    has_custom_names = map_path is not None or top_name is not None
    wrapper_texts = top_wrapper_texts(golden.manifest, map_path, top_name) if has_custom_names else {}
    r = design_bundle.read_bundle_recording(folder, golden.manifest)
    return design_bundle.write(r, out, golden.at, names_design, "pins", more=wrapper_texts, clocks=delays)


def write_adapted_bundle(folder, map_path, level, out, latency_path=None):
    """Write the folder of a bundle, a map, a level and a latency file; returns its `Judged` part of the bundle.

    out  new folder; FileError if it is there and holds anything
    """
    folder, out = Path(folder), Path(out)
    golden = bundle.read(folder)
    port_map = design_map.read(map_path, golden.manifest, level)
    clocks = {} if latency_path is None else comparison_scope.read_latency(latency_path, golden.manifest, level)
    comparison = comparison_scope.build_scope(golden, level, port_map.style, clocks)
    manifest = comparison.golden.manifest
    exp, mask = comparison_scope.delayed_rows(comparison)
    widths = {name: [p["width"] for p in ports] for name, ports in (
        ("stim", manifest["inputs"]), ("exp", manifest["registers"] + manifest["outputs"]))}  # fmt: skip
    file_texts = _bench_texts(folder, manifest, level)
    for name, rows, width_key in (("stim", comparison.golden.stim, "stim"), ("exp", exp, "exp"), ("mask", mask, "exp")):
        file_texts[f"{name}.hex"] = bundle.hex_text(bundle.pack(rows, widths[width_key]), sum(widths[width_key]))
    head = f"golden_{manifest['block']}"
    file_texts |= {f"{head}.v": adapter.verilog(manifest, port_map), f"{head}.vhd": adapter.vhdl(manifest, port_map)}
    file_texts["map.toml"] = Path(map_path).read_text()
    if latency_path is not None:
        file_texts["latency.toml"] = Path(latency_path).read_text()
    keys = ("schema", "block", "case", "clock", "reset", "n", "inputs", "registers", "outputs", "params", "levels")
    manifest_entries = {key: manifest[key] for key in keys if key in manifest}
    manifest_entries |= {"level": level, "first_row": comparison.first, "clocks": comparison.clocks,
             "of_bundle": golden.manifest["manifest_sha256"]}  # fmt: skip
    file_texts["manifest.json"] = bundle.canonical(manifest_entries) + "\n"
    with replace_folder(out) as new:
        for name, text in file_texts.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)
    return comparison
