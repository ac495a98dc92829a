"""Run somebody's whole design with the bench of its bundle, and find the first clock that differs.

    bundle of the level --> its check.sh --> rows and signatures equal, or the first frame that differs
    that frame          --> a bundle with a row at each of its clocks --> its check.sh --> clock, port, both values

Source  docs/golden.md (the whole design), docs/foreign_designs.md
"""

import re
import shutil
import tempfile
from pathlib import Path

from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle, top
from testbench.golden.bundles.wrap import pins_of
from testbench.golden.check import design_run
from testbench.golden.check.compare import Divergence, Report
from testbench.golden.check.rtl_run import TIMEOUT_S, Runner, first_lines
from testbench.golden.recording import recording
from testbench.golden.stimulus import levels

ROW = re.compile(r"clock (\d+): (\w+): expected (\w+), got (\w+) \(hex\)")
FRAME = re.compile(r"frame (\d+) \(clocks ")
PASSED = re.compile(r"PASS \S+: (\d+) clocks, (\d+) rows .* (\d+) of \d+ frames")
UNREAD = ("ports/", "vec.csv", "golden.")  # files that no bench opens


def _bench(folder, level, place):
    """(folder in `place`, manifest) of the bench of a level: what it opens is copied, or written for the pins."""
    bench, manifest = place / "bench", bundle.read(folder).manifest
    if level != "registers" and manifest["registers"]:
        return bench, pins_of(folder, level, bench)
    for name in manifest["sha256"]:
        if not name.startswith(UNREAD):
            (bench / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(folder) / name, bench / name)
    return bench, manifest


def _said(run, bench, sim, rtl, files, level, frames=()):
    """What check.sh says of a design; FileError if nothing was compared."""
    given = [f"RTL={Path(rtl).resolve()}", f"LEVEL={level}", f"TIMEOUT={run.timeout_s:g}", *frames]
    given += [f"FILES={Path(files).resolve()}"] if files else []
    code, text = run("env", *given, "sh", bench / "check.sh", sim)
    if code == 0 or (code == 1 and ("rows differ" in text or "frames differ" in text)):
        return text
    if "stopped after" in text:
        raise FileError(f"{sim}: stopped after {run.timeout_s:g} s: the design hangs or is slow")
    raise FileError(f"{rtl}: nothing was compared under {sim}:\n{first_lines(text)}")


def _first(text):
    """(clock, [(port, expected, got)]) of the first row that a bench names, or None."""
    found = ROW.findall(text)
    return found and (int(found[0][0]), [words[1:] for words in found if words[0] == found[0][0]])


def _value(word, port):
    """Number of a hexadecimal word of a port; None: unknown."""
    try:
        raw = int(word, 16)
    except ValueError:
        return None
    return raw - (1 << port["width"]) if port["signed"] and raw >> (port["width"] - 1) else raw


def _divergence(manifest, clock, rows):
    """`Divergence` of the ports that a bench names at one clock, inputs first."""
    ports = {p["name"]: p for p in manifest["inputs"]} | dict(levels.judged(manifest, "registers"))
    seen = [(ports[name], name, _value(want, ports[name]), _value(got, ports[name])) for name, want, got in rows]
    port, name, want, got = seen[0]
    scale = 2.0 ** -port["fmt"][2]
    inputs = {p["name"] for p in manifest["inputs"]}
    return Divergence(
        cycle=clock,
        time_ns=clock * 1e9 / manifest["clock"]["hz"],
        port=port["name"],
        kind="input" if name in inputs else levels.kind_of(manifest, name),
        expected=want,
        got=got,
        expected_value=want * scale,
        got_value=None if got is None else got * scale,
        error_lsb=None if got is None else got - want,
        also=tuple(p["name"] for p, *_ in seen[1:]),
        before=(),
    )


def check(folder, rtl, timeout_s=TIMEOUT_S, choice=design_run.AS_OURS):
    """Compare the whole design in folder `rtl` with a bundle of `top`; returns a `compare.Report`.

    choice  `design_run.Choice`: sim, level, files; ConfigError for a map, a module or a latency
    The run ends after the frames by default of its simulator: `rows` counts the rows up to there.
    """
    for name in ("map", "top", "latency"):
        if getattr(choice, name) is not None:
            raise ConfigError(f"--{name}: the whole design is compared with the names and clocks of gyro_top")
    if not 0 < timeout_s <= 86400:
        raise ConfigError(f"timeout: {timeout_s} s is outside 0 .. 86400 s")
    manifest = bundle.read(folder).manifest
    level = choice.level or top.level_of(manifest)
    if level not in levels.LEVELS or (level == "registers" and not manifest["registers"]):
        raise ConfigError(f"level: {level!r} is not a level of {folder}")
    sim = design_run.chosen(manifest, rtl, choice).sim
    with tempfile.TemporaryDirectory(prefix="gyro-check-") as place:
        place = Path(place).resolve()
        (bench, own), run = _bench(folder, level, place), Runner(place, timeout_s)
        text = _said(run, bench, sim, rtl, choice.files, level)
        differs = "FAIL " in text
        if differs:
            clock, rows = _found(text, run, bench, sim, rtl, choice.files, level, own)
    ports = tuple(p["name"] for _, p in levels.judged(own, "registers"))
    count = int(re.search(r"(?:of|all) (\d+) rows", text)[1] if differs else PASSED.search(text)[2])
    head = ("top", own["case"], count, own["n"], ports, (), level, count, {})
    if not differs:
        return Report(*head, {}, None, ())
    found = _divergence(own, clock, rows)
    return Report(*head, dict.fromkeys((found.port, *found.also), 1), found, ())


def _found(text, run, bench, sim, rtl, files, level, manifest):
    """(clock, rows) of the first clock that differs: every clock of the first frame that a bench names."""
    frames = [int(number) for number in FRAME.findall(text)]
    rows = _first(text)
    frames += [rows[0] // manifest["frame_cycles"]] if rows else []
    first = min(frames) * manifest["frame_cycles"]
    place = recording.Window(first, manifest["frame_cycles"], "differs")
    r = top.begun(top.replayed(bench, manifest), min(frames) + 1, (place,))
    window = run.folder / "window"
    top.write(r, window, None, "design" in manifest, top.level_of(manifest))
    rows = _first(_said(run, window, sim, rtl, files, level, ("FRAMES=0",)))
    if not rows:
        raise FileError(f"{rtl}: frame {min(frames)} differs in one run of {sim} and not in the next")
    return rows
