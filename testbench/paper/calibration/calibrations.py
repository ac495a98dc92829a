"""`gyro calibrate`: the procedure on one board or on many, judged by the truth that it was not shown.

For each board: register words, cases 1 to 5, what remains of the four
loop phases (truth), its uncertainty (the procedure's own), and what a second pass would have moved.
Source    docs/paper.md
"""

import math
from pathlib import Path

from fpga_model.dds import offset_of_deg
from testbench import config as configuration
from testbench.paper.calibration import calibration_boards
from testbench.paper.calibration.bench import Bench, Judge
from testbench.paper.calibration.calibrate_phases import NODES, REGISTER, calibrate
from testbench.storage.files import atomic_outputs, write_text

PAPER_LEVEL_DEG, TARGET_DEG = 0.012, 0.002


def one(config, temp_degc, compare, say, engine=None):
    """Calibrate one board; the dict that `--json` prints of it."""
    bench = Bench(config, 0.0, temp_degc, engine)
    calibration = calibrate(bench, compare, say)
    truth = Judge(bench).residuals()
    words = bench.phases_deg()
    uncertainty = calibration.uncertainty_deg
    again = {node: calibration.second.estimates[node] for node in NODES}
    first = calibration.first.estimates
    out = {
        "residual_deg": {node: truth.deg[node] for node in NODES},
        "uncertainty_deg": uncertainty,
        "covered": {node: abs(truth.deg[node]) <= uncertainty[node] for node in NODES},
        "found_deg": {node: first[node].deg for node in NODES},
        "found_uncertainty_deg": {node: first[node].uncertainty_deg for node in NODES},
        "second_pass_deg": {node: again[node].deg for node in NODES},
        "second_pass_uncertainty_deg": {
            node: math.hypot(again[node].uncertainty_deg, calibration.first.uncertainty_deg[node]) for node in NODES
        },
        "registers": {name: offset_of_deg(value, bench.design) for name, value in words.items()},
        "phases_deg": words,
        "cases_deg": {str(case): values for case, values in calibration.cases.items()},
        "frequency_hz": truth.frequency_hz,
        "minutes": bench.time_s / 60,
        "seen": {k: (v._asdict() if hasattr(v, "_asdict") else v) for k, v in calibration.first.extra_numbers.items()},
        "locked": bench.locked,
    }
    return out


def many(base, count, seed, temp_degc=25.0, compare=False, progress=None, engine=None):
    """[dict, ...] of `count` boards: the base itself if it is one without a seed, else drawn from the spreads.

    engine  name of an engine instead of that of the configuration
    """
    configs = (
        [base]
        if count == 1 and seed is None
        else calibration_boards.random_boards(base, 0 if seed is None else seed, count)
    )
    out = []
    for number, config in enumerate(configs):

        def report_board_step(step, number=number):
            if progress:
                progress(f"board {number + 1}: {step}", number, len(configs))

        report_board_step("start")
        out.append(one(config, temp_degc, compare, report_board_step, engine) | {"board": number})
    return out


def summary(results):
    """Verdict over boards: largest residual of each phase, how often the uncertainty covers it, and the two levels."""
    rows = {}
    for node in NODES:
        abs_residuals_deg = [abs(r["residual_deg"][node]) for r in results]
        rows[node] = {
            "largest_deg": max(abs_residuals_deg),
            "covered": sum(r["covered"][node] for r in results),
            "unchanged": sum(
                abs(r["second_pass_deg"][node]) <= r["second_pass_uncertainty_deg"][node] for r in results
            ),
        }
    worst = max(row["largest_deg"] for row in rows.values())
    return {
        "boards": len(results),
        "phases": rows,
        "covered_all_four": sum(all(r["covered"].values()) for r in results),
        "worst_deg": worst,
        "paper_level_deg": PAPER_LEVEL_DEG,
        "below_paper_level": worst < PAPER_LEVEL_DEG,
        "below_target": worst < TARGET_DEG,
    }


def case_config(base, phases_deg):
    """The base configuration with the four words of a case."""
    return configuration.changed(base, {f"firmware.{name}_deg": value for name, value in phases_deg.items()})


def write_cases(results, base, seed, directory):
    """Files that `gyro run --config` reads: case_1.toml .. case_5.toml, of many boards in board_N. Returns paths."""
    texts = {}
    for result in results:
        lone = len(results) == 1 and seed is None
        folder = Path(directory) if lone else Path(directory) / f"board_{result['board']}"
        board = base if lone else calibration_boards.draw(base, seed or 0, result["board"])
        for case, values in result["cases_deg"].items():
            texts[folder / f"case_{case}.toml"] = configuration.to_toml(case_config(board, values))
    with atomic_outputs():
        for path, text in texts.items():
            write_text(path, text)
    return list(texts)


__all__ = ["NODES", "PAPER_LEVEL_DEG", "REGISTER", "TARGET_DEG", "case_config", "many", "one", "summary", "write_cases"]
