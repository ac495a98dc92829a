"""Options of every command, and paths that are no files: hostile values for each, in one process.

What a command would compute is left out (HEAVY): its function refuses at once, so that options alone are tried.
"""

import contextlib
import importlib
import io
import os
import resource
from unittest import mock

from testbench.errors import FileError

ALLOWED = (0, 1, 2)
BLOCKED = 3  # of `measured check`: a record whose firmware is not the model's
HEAVY = (
    "testbench.run.simulate:run", "testbench.paper.calibration.calibrations:many", "testbench.paper.paper_study:Study",
    "testbench.paper.measure.characterise:characterise", "testbench.campaign.execute:run",
    "testbench.campaign.rerun:rerun", "testbench.golden.bundles.export:export",
    "testbench.golden.bundles.effect:export",
    "testbench.golden.mutation.mutate:score", "testbench.golden.loop.run:run", "testbench.golden.proofs.formal:prove",
    "testbench.golden.proofs.synthesis:synthesise", "testbench.golden.ranges.range_report:case_range_entry",
    "testbench.golden.check.rtl_run:check", "testbench.measured.record.produce:record",
    "testbench.measured.record.from_run:write", "testbench.paper.loop.loop_page:write",
    "testbench.measured.residual.residuals:study_residuals", "testbench.measured.residual.calibrate_residual:calibrate",
    "testbench.measured.record.firmware_residual:residual", "testbench.measured.trace_recording:trace_problem",
    "testbench.measured.closed_loop.loop_trace:run", "testbench.paper.inference.inference_study:run_inference",
)  # fmt: skip
WORDS = (
    "", "x", "-1", "0", "1", "2", "1e400", "nan", "inf", "-inf", "9" * 5000, "0.5", "1e-320", "\n", "°ü", "a=b", "=",
    "plant.fx_hz=1",
    "plant.fx_hz=[[[[", "scenario.seconds=1e400", "noise.seed=" + "9" * 5000, "scenario.rate_dps=" + "[" * 3000,
    "noise.seed=1\nb=2", "output.directory=a\0b", "output.directory=", "plant.fx_hz=\r", "noise.seed=\n", "\0",
    "1:2", "nan:nan", "-5:1e9", "all", "top", "dds", "pi", "frame", "baseband", "icarus", "R1", "--help", "--", "-",
)  # fmt: skip
THREADS = ("0", "-1", "00", " 0 ", "x", "1e9", "9" * 50, "\u0661", "", "1")  # of NUMBA_NUM_THREADS
# parts of the names of options whose file is written
NEW = ("new", "dir", "empty", "empty/below", "x" * 300, "a\nb", "a\0b", "°ü.h5")
WRITTEN = ("out", "report", "json_file", "envelope", "checkpoint", "gyrorec", "build")
_READY = []


def _refused(*_, **__):
    raise FileError("not computed here")


def said(argv):
    """Exit code of the command line; an exception that is no SystemExit is the caller's."""
    from testbench.commands import main

    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            main.main(argv)
        except SystemExit as ended:
            code = ended.code
    allowed = (*ALLOWED, BLOCKED) if argv[:2] == ["measured", "check"] else ALLOWED
    if code not in allowed or err.getvalue().startswith("gyro: gyro:"):
        raise AssertionError(
            f"exit code {code} of {[a[:80] for a in argv]}: {out.getvalue()[-500:]} {err.getvalue()[-500:]}"
        )
    return code


def prepare():
    """{command: its parameters}, and what is heavy put out of action, once in a process."""
    if _READY:
        return _READY[0]
    import typer

    from testbench.commands import main

    for place in HEAVY:
        module, _, name = place.partition(":")
        setattr(importlib.import_module(module), name, _refused)
    found = {}

    def walk(command, words):
        for name, inner in getattr(command, "commands", {}).items():
            walk(inner, [*words, name])
        if not hasattr(command, "commands"):
            found[tuple(words)] = command.params

    walk(typer.main.get_command(main.app), [])
    _READY.append(found)
    return found


def _paths(corpus, folder):
    """Files of every kind, and what is no file."""
    (folder / "dir").mkdir(exist_ok=True)
    (folder / "link").unlink(missing_ok=True)
    (folder / "link").symlink_to("/dev/zero")
    with contextlib.suppress(FileExistsError):
        os.mkfifo(folder / "fifo")
    (folder / "a\nb.toml").write_text("x = [")
    (folder / "empty").write_text("")
    strange = ["dir", "link", "fifo", "a\nb.toml", "empty", "none", "empty/below", "x" * 300]
    return [*map(str, sorted(p for p in corpus.iterdir() if p.name != "done")), *(str(folder / s) for s in strange),
            "/dev/zero", "/dev/null", "/proc/self/mem", "", "a\0b"]  # fmt: skip


def options(rng, corpus, folder):
    """A command with a few of its options, hostile values in them."""
    found = prepare()
    words = rng.choice(sorted(found))
    argv, paths = list(words), _paths(corpus, folder)
    for param in found[words]:
        wanted = param.param_type_name == "argument" or param.required
        if param.name == "help" or not (rng.random() < (0.95 if wanted else 0.25)):
            continue
        # what is written lies in the folder of this input, whatever it is called
        writes = any(name in param.name for name in WRITTEN)
        value = (
            rng.choice(("", *(str(folder / name) for name in NEW)))
            if writes else rng.choice(paths) if rng.random() < 0.5 else rng.choice(WORDS)
        )  # fmt: skip
        if param.param_type_name == "argument":
            argv.append(value)
        else:
            argv += [param.opts[0]] if getattr(param, "is_flag", False) else [param.opts[0], value]
    threads = {"NUMBA_NUM_THREADS": rng.choice(THREADS)} if rng.random() < 0.2 else {}
    return lambda: _inside(folder, argv, threads)


def _inside(folder, argv, environment=()):
    with contextlib.chdir(folder), mock.patch.dict(os.environ, environment):
        return said(argv)


READERS = (
    ("run", "--config"), ("run", "--resume"), ("run", "--resume-run"), ("budget", "--config"), ("loop", "--config"),
    ("design",),
    ("golden", "verify"), ("golden", "window", "--out", "new", "--frame", "0"), ("golden", "check", "LOG"),
    ("measured", "check", "--no-replay"), ("measured", "convert"), ("measured", "record", "--out", "new"),
    ("measured", "residuals"), ("measured", "calibrate"), ("measured", "trace"), ("campaign", "check"),
    ("campaign", "run", "--out", "new"), ("campaign", "status"), ("campaign", "show"), ("campaign", "collect"),
)  # fmt: skip


def paths(rng, corpus, folder):
    """A command that reads a file, with a directory, a FIFO, a device, a link to one, a file of another kind."""
    prepare()
    known = _paths(corpus, folder)
    argv = [*rng.choice(READERS), rng.choice(known)]
    if argv[:2] == ["measured", "convert"]:
        argv.append(rng.choice(("new", "dir", "empty/x")))
    if argv[:2] == ["golden", "check"]:
        signals = rng.choice([*known, *[str(corpus / "map.toml")] * len(known)])
        argv[2:] = [str(corpus / "toy"), "--log", argv[3], "--map", signals]
    return lambda: _inside(folder, argv)


WRITERS = (
    ("registers", "--out", "new"), ("fmu", "--out", "new"), ("loop", "--report", "new"),
    ("measured", "convert", "gyrorec.h5", "new"),
)  # fmt: skip


def full(rng, corpus, folder):
    """A command that writes, on a disk that is full after some bytes: it ends well, or names the file."""
    prepare()
    argv = [str(corpus / word) if word.startswith("gyrorec") else word for word in rng.choice(WRITERS)]
    room = rng.choice((0, 1, 50, 1000, 10_000, 100_000))

    def read():
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
        try:
            code = _inside(folder, argv)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        if code == 0 and not room:
            raise AssertionError(f"{argv} wrote nothing and said nothing")

    return read


KINDS = {"options": options, "paths": paths, "full": full}
