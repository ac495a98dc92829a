"""What a run says: the object of `--json`, sentences for a person, arguments of the pictures, the register window.

Numbers come from the tally and from the last chunk, never from all rows.
Source    docs/phases.md, docs/record.md
"""

from typing import Any, NamedTuple

import numpy as np

from analog_frontend import amplifier_use
from analog_frontend.parts import pickoff, thermal
from fpga_model import fault_monitor, fixed, sequencer
from fpga_model import top as fpga
from testbench import flatten
from testbench.config import Firmware, Plant
from testbench.engines import chips, engine
from testbench.judge import phases
from testbench.run import budget, build, nodes
from testbench.run.outputs import Result
from testbench.run.run_statistics import amplitude_m
from testbench.run.run_tables import FITTED
from testbench.storage.vcd import Signal, signals


class End(NamedTuple):
    """What holds at the end of the scenario, before the diagnosis."""

    locked: bool
    codes_sha256: str
    tail: np.ndarray  # last codes of both DACs
    state: Any  # arguments of `state_file.save_state`, or None
    real_time_factor: float


def build_run_result(job, end, reading, wall_s):
    """`Result` of a `simulate.Run` that is done; `reading` is its diagnosis or None."""
    config, sim, tally = job.config, job.sim, job.statistics
    clock_hz, device = build.clock_hz(config), config.device()
    planned = budget.budget(config, frequency_hz=None if reading is None else reading.nodes.frequency_hz)
    lock_s = None if config.scenario.resume else job.start_up.lock_s
    warm = thermal.device_at_temperature(device, tally.temp_degc)
    node_readings = None if reading is None else reading.nodes
    summary = {
        "locked": end.locked,
        "lock_time_s": lock_s,
        "drive_frequency_hz": tally.mean("frequency_word") * build.lsb_hz(config),
        "expected_frequency_hz": budget.lock_frequency_hz(
            warm.fx_hz, warm.qx, planned.node_deg()["xe1"], planned.loop_deg()["xe2"]
        ),
        "amplitude_m": tally.amplitude_m,
        "phase_deg": None if node_readings is None else node_readings.phase_deg,
        "phase_sigma_deg": None if node_readings is None else node_readings.sigma_deg,
        "counter_deg": None if node_readings is None else node_readings.counter_deg,
        "counter_resolution_deg": None if node_readings is None else node_readings.counter_resolution_deg,
        "uneven_deg": None if node_readings is None else node_readings.uneven_deg,
        "derived_deg": None
        if node_readings is None
        else _readout_terms_deg(config, node_readings, tally.temp_degc, 1 / clock_hz),
        "budget_deg": planned.node_deg(),
        "loop_phase_deg": None if node_readings is None else _loop_phases(node_readings.phase_deg, planned),
        "budget_loop_deg": planned.loop_deg(),
        "paper_deg": dict(planned.paper_deg),
        "paper_verdict": None if node_readings is None else _verdicts(config, node_readings, planned),
        "amplifier_use": [u._asdict() for u in planned.amplifiers],
        "rate_lsb_per_dps": None if reading is None else reading.lsb_per_dps,
        "rate_word_mean_lsb": tally.mean("rate_word"),
        "quadrature_v": tally.mean("quadrature_code") * device.quad_dac_span_v / 2**16,
        "flags": [name for k, name in enumerate(fault_monitor.NAMES) if tally.flags >> k & 1],
        "warnings": [
            *job.anomaly_detector.warnings(config),
            *build.no_rate_output(config),
            *amplifier_use.warnings(planned.amplifiers),
        ],
        "window_missing": 0
        if not sim.window
        else sim.design.tick_clocks * sim.window[1] - (0 if sim.rows is None else len(sim.rows)),
        "real_time_factor": end.real_time_factor,
        "simulated_s": sim.tick / sim.design.tick_hz,
        "wall_s": wall_s,
        "codes_sha256": end.codes_sha256,
        "plant_sha256": sim.identity.get("plant"),
        "plant_file_sha256": sim.identity.get("plant_file"),
        "seed": config.noise.seed,
    }
    return Result(
        summary,
        (*notes(config, summary, planned), *(sim.foreign.notes() if sim.foreign else ())),
        job.recording,
        _plots(job, end.tail, summary, reading, clock_hz),
        _register_window(sim),
        end.state,
    )


def _readout_terms_deg(config, node_readings, temp_degc, clock_s):
    """Terms (deg) of the readings of xe2 and ye2 that are no property of the board: the mode's frequency, the tick."""
    base, added = config.device(), {}
    warm, tick_s = thermal.device_at_temperature(base, temp_degc), clock_s * config.design_record().tick_clocks
    for node, name in (("xe2", "drive"), ("ye2", "sense")):
        forced, k_vf = node_readings.forced[node], getattr(warm, f"k_vf_{name}_n_per_v")
        force = pickoff.Force(forced.volts_per_m * k_vf / warm.mass_kg, forced.poles_s, forced.instant_s)
        poles_s = budget.pickoff_poles_s(base, name, temp_degc)
        tick_deg = pickoff.lag_deg(poles_s, node_readings.frequency_hz, tick_s, force)
        added[node] = {"frequency": node_readings.off_deg[node], "tick": tick_deg}
    return added


def _verdicts(config, node, planned):
    """{node: verdict of the judge}; None for each node of another board."""
    if not config.is_paper_board:
        return dict.fromkeys(phases.NODES)
    return phases.verdicts(node.phase_deg, node.sigma_deg, planned.nonzero_words)


def _loop_phases(readings, planned):
    """Loop phases from node phases: less what the demodulator's switching delays the reference."""
    return {node: readings[node] + sum(row.degrees for row in planned.loop_rows[node]) for node in ("xe2", "ye2")}


def notes(config, summary, planned):
    """Sentences: what is assumed, and what remains unexplained."""
    sentences = []
    if not summary["locked"]:
        sentences.append("NOT LOCKED at the end of the scenario; see docs/firmware.md")
        sentences += _out_of_reach(config)
    if summary.get("window_missing"):
        sentences.append(
            f"The waveform window lacks {summary['window_missing']} clocks: the run ended or the phases were read."
        )
    if summary.get("flags"):
        sentences.append(f"Fault flags raised: {', '.join(summary['flags'])}; see docs/firmware.md")
    sentences += [f"Warning: {text}" for text in summary.get("warnings", ())]
    sentences += [planned.ring, amplifier_use.sentence(planned.amplifiers)]
    design = config.design_record()
    origin = "Fitted to the paper, not a fact" if config.is_paper_board else "As configured"
    if config.firmware.reference_retimed:
        sentences.append(
            f"{origin}: the references leave on the {1e-6 * design.tick_hz:g} MHz grid "
            f"(firmware.reference_retimed), which reduces xe1 and ye1 by {(design.tick_clocks + 1) / 2:g} clocks."
        )
    if count := config.firmware.frame_latency_sense:
        frames = f"one extra {1e6 / design.tick_hz:g} us frame" if count == 1 else f"{count} extra frames"
        sentences.append(f"{origin}: {frames} in the sense path (firmware.frame_latency_sense).")
    measured = summary["phase_deg"]
    paper_verdict = summary.get("paper_verdict") if config.is_paper_board else None
    if paper_verdict:
        compared_deg = {k: v for k, v in budget.PAPER_DEG.items() if phases.is_compared(paper_verdict[k])}
        gap = {k: (measured[k] - v) / 360.0 / planned.frequency_hz * 1e9 for k, v in compared_deg.items()}
        sentences += phases.sentences(paper_verdict)
        sentences.append("Measured minus paper: " + ", ".join(f"{k} {ns:+.0f} ns" for k, ns in gap.items()) + ".")
        sentences.append(f"{FITTED} See docs/phases.md.")
    if paper_verdict and config.firmware == Firmware() and config.plant == Plant():
        sentences.append(
            "Most of the difference is in ye1. There are two alternatives: part of the DAC's 130 ns is inside its "
            "output poles, or a pole near 170 kHz is there instead of the frame. Their drift with temperature differs."
        )
        sentences.append(
            "Two measurements cannot separate ring diode, noise gains and switch delay in xe2 and ye2. The loop phases "
            "printed above exclude the assumed 80 ns of the analog switch."
        )
    return tuple(sentences)


def _out_of_reach(config):
    """What to do where the search cannot find the drive mode."""
    f, fx_hz = config.firmware, config.plant.fx_hz
    if abs(fx_hz - f.nominal_frequency_hz) > f.search_limit_hz:
        yield (
            f"plant.fx_hz = {fx_hz:g} Hz is more than firmware.search_limit_hz = {f.search_limit_hz:g} Hz from "
            f"firmware.nominal_frequency_hz = {f.nominal_frequency_hz:g} Hz: describe the board in [nominal]"
        )


def _plots(job, tail, summary, reading, clock_hz):
    """Arguments of the pictures."""
    c, config = job.start_up.columns(), job.config
    plots = {
        "startup": {
            "time_s": c["time_s"],
            "amplitude_um": amplitude_m(c["x"], c["vx"], c["frequency_word"], build.lsb_hz(config)) * 1e6,
            "phase_deg": c["phase"] / 2**24 * 360,
            "frequency_error_hz": c["frequency_word"] * build.lsb_hz(config) - summary["expected_frequency_hz"],
            "state": c["state"],
            "state_names": sequencer.STATES,
            "lock_time_s": summary["lock_time_s"],
            "setpoint_um": config.firmware.amplitude_um,
        },
    }
    # the baseband engine knows no codes of single ticks
    if tail.shape[1]:
        board = chips.dac_chips(config.design)
        bits = {"drive": board.drive.bits, "sense": board.sense.bits}
        outputs = {f"{name} ({n} bit)": (codes, n) for (name, n), codes in zip(bits.items(), tail)}
        plots["spectra"] = {"outputs": outputs, "rate_hz": config.design_record().tick_hz}
    if reading is not None:
        names = ("drive sgn(sin)", "drive sgn(cos)", "sense sgn(sin)", "sense sgn(cos)")
        f = summary["drive_frequency_hz"]
        errors = {
            n: nodes.edge_errors_turns(reading.edges, k, config.design.dds_bits) / f * 1e9 for k, n in enumerate(names)
        }
        plots["jitter"] = {
            "edges_ns": errors,
            "grid_ns": 1e9 * config.design.tick_clocks / clock_hz
            if config.firmware.reference_retimed
            else 1e9 / clock_hz,
        }
        plots["rate_step"] = reading.step
    return plots


def _register_window(sim):
    """Register window for the waveform writer."""
    if sim.rows is None:
        return None
    pins = [
        Signal(f"pins.{name}", 24 if name.endswith("code") else (4 if name == "refs" else 1), name.endswith("code"))
        for name in engine.PIN_COLUMNS
    ]
    formats = [fmt for _, fmt in flatten.leaves(fixed.formats(fpga.State, sim.design, sim.state.fpga))]
    window_signals, d = pins + signals(flatten.names(sim.state.fpga), formats), sim.design
    return sim.rows, window_signals, sim.window[0] * d.tick_clocks, d.master_hz
