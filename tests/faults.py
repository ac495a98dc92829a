"""Twenty faults made by hand, one at a time in a copy of the tree: `make test` must kill each. python -m tests.faults

For each the fast tests named beside it are run, which must pass without it; a fault that lives is printed with ALIVE,
and the exit code is 1.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FAULTS = (
    ("fpga_model/pi.py", ", p.hi << fraction_bits)", ", (p.hi << fraction_bits) + 1)", "fpga_model"),
    (
        "fpga_model/dds.py",
        "wrap_unsigned(s.phase + off_sense_ref",
        "wrap_unsigned(s.phase + off_drive_ref",
        "fpga_model",
    ),
    ("fpga_model/watchdog.py", "1 if age > p.limit", "1 if age >= p.limit", "fpga_model"),
    ("fpga_model/fixed.py", "(1 << n) >> 1", "(1 << n) >> 2", "fpga_model"),
    ("analog_frontend/parts/resonator.py", "(VY, X): -per_force", "(VY, X): per_force", "analog_frontend"),
    ("analog_frontend/parts/dac.py", "(1.0 - ratio * ratio)", "(1.0 - ratio)", "analog_frontend"),
    ("analog_frontend/effects/centrifugal.py", "rate^2 y", "rate^2 x", "test_catalogue_pages.py"),
    (
        "testbench/engines/turn.py",
        "(clock - turn.clock) * turn.old",
        "(clock - turn.since) * turn.old",
        "testbench/engines",
    ),
    ("testbench/engines/window.py", "SLOT_WORD = SLOT_PI + 2", "SLOT_WORD = SLOT_PI + 1", "testbench/engines"),
    ("testbench/storage/code_hash.py", "BLOCK_TICKS - tick % BLOCK_TICKS", "BLOCK_TICKS", "testbench/storage"),
    (
        "testbench/storage/files.py",
        "os.replace(staging.new, staging.path)",
        "os.rename(staging.new, str(staging.path) + '.new')",
        "testbench/storage",
    ),
    ("testbench/config/load.py", "abs(v) <= 1e-2", "abs(v) <= 1e-1", "testbench/config"),
    (
        "testbench/run/phase_meter.py",
        "(angle_deg + 180.0) % 360.0 - 180.0",
        "angle_deg % 360.0 - 180.0",
        "testbench/run",
    ),
    ("testbench/run/budget.py", 'edge quantisation, mean", -0.5', 'edge quantisation, mean", 0.5', "testbench/run"),
    (
        "testbench/console/show.py",
        "not math.isfinite(value)",
        "math.isnan(value)",
        "testbench/commands testbench/console",
    ),
    ("testbench/golden/bundles/bundle.py", "sha256(data)", "sha512(data)", "testbench/golden/test_bundle.py"),
    (
        "testbench/measured/record/checks.py",
        "(steps < 0).any()",
        "(steps < -1).any()",
        "testbench/measured/test_record.py",
    ),
    (
        "testbench/tracing/fit/evidence.py",
        "np.exp(logs - logs.max())",
        "np.exp(logs)",
        "testbench/tracing/test_evidence.py",
    ),
    ("testbench/paper/loop/loop.py", "b[v, 1] = -x * per_force", "b[v, 1] = x * per_force", "testbench/paper"),
    ("testbench/campaign/plan/draws.py", ">> 11", ">> 12", "testbench/campaign"),
)


def killed(tree, path, old, new, tests):
    """Whether the tests fail with the fault in the tree; the tree is as before afterwards."""
    file = tree / path
    sound = file.read_text()
    assert old in sound, (path, old)
    file.write_text(sound.replace(old, new, 1))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        *(f"tests/{t}" for t in tests.split()),
    ]
    done = subprocess.run(
        command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, capture_output=True, text=True
    )
    file.write_text(sound)
    return done.returncode != 0


def main(wanted):
    """Print a line for each fault, or for those whose numbers are wanted; returns the exit code."""
    alive = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "out", "build"))
        chosen = [(n, *fault) for n, fault in enumerate(FAULTS, 1) if not wanted or n in wanted]
        for path, old, tests in {tests: (path, old, tests) for _, path, old, _, tests in chosen}.values():
            if killed(tree, path, old, old, tests):
                print(f"tests/{tests} fails without a fault: nothing can be said of those that it must kill")
                return 1
        for number, path, old, new, tests in chosen:
            dead = killed(tree, path, old, new, tests)
            alive += not dead
            print(f"{number:2} {'killed' if dead else 'ALIVE '} {path}: {old!r} -> {new!r}", flush=True)
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main({int(text) for text in sys.argv[1:]}))
