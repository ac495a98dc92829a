"""What `gyro design` prints and writes: tables of the choice and its predictions, the page, one object for machines.

Source  docs/design_of_loops.md
"""

import numpy as np

from testbench.config import to_toml
from testbench.console.text_table import Table
from testbench.design import margins, range_check
from testbench.paper.loop import loop_page
from testbench.run.budget import NODES

CHOSEN = (
    "amplitude_um",
    "ftr_crossover_hz",
    "ftr_zero_hz",
    "qsc_crossover_hz",
    "agc_crossover_hz",
    "agc_zero_hz",
    "pll_crossover_hz",
    "pll_zero_hz",
    "kick_s",
    "kick_v",
    "decay_s",
    "search_s",
    "search_limit_hz",
    "search_min_v",
    "retune_s",
    "acquire_share",
    "pll_limit_hz",
    "phase_drive_sine_deg",
    "phase_sense_sine_deg",
    "phase_drive_ref_deg",
    "phase_sense_ref_deg",
)


# field of `predicted_values` -> text
PREDICTED = {
    **{name: text for name, (text, *_) in loop_page.NUMBERS.items()},
    "gain_margin_db": loop_page.NUMBERS["gain_margin_up_db"][0],
    "phase_margin_deg": "phase margin, smallest of lag and lead",
    "modulus_margin_of_tolerances": "smallest modulus margin within the tolerances",
    "full_scale_deg_s": "rate of the largest force word",
    "ring_tau_s": "time constant of the ringing at the split",
    "lock_s": "time from power-on to lock",
    "promised_lock_s": "time to lock of the slowest board within the tolerances",
    "drive_frequency_hz": "drive frequency",
    "amplitude_um": "drive amplitude",
    **{f"{name}_deg": f"node phase {name}" for name in NODES},
    **{f"{name}_loop_deg": f"loop phase {name}'" for name in ("xe2", "ye2")},
    "leak_deg": "ye1 + xe2', by which rate leaks into quadrature",
}


def predicted_values(result):
    """{name: value} of what a run of the design is expected to show, nominal board, noise off."""
    a, budget = result.advice, result.budget
    node, loop = budget.node_deg(), budget.loop_deg()
    nearest = min((min(c.lag_deg, c.lead_deg) for c in a.crossings), default=None)
    return {
        "bandwidth_hz": a.bandwidth_hz,
        "peak_db": max(a.peak_db, 0.0),
        "gain_margin_db": a.gain_margin_up_db,
        "phase_margin_deg": nearest,
        "modulus_margin": a.modulus_margin,
        "modulus_margin_of_tolerances": result.choice.worst_modulus,
        "lsb_per_dps": a.lsb_per_dps,
        "full_scale_deg_s": 2**23 / abs(a.lsb_per_dps),
        "bias_dps": a.bias_dps,
        "v_q": a.v_q,
        "ring_tau_s": a.ring_tau_s,
        "lock_s": result.nominal.lock_s,
        "promised_lock_s": result.promised_s,
        "drive_frequency_hz": budget.frequency_hz,
        "amplitude_um": result.config.firmware.amplitude_um,
        **{f"{name}_deg": node[name] for name in node},
        **{f"{name}_loop_deg": loop[name] for name in loop},
        "leak_deg": range_check.leak_deg(result.config),
    }


UNITS = (("_hz", "Hz"), ("_db", "dB"), ("_deg_s", "deg/s"), ("lsb_per_dps", "LSB/(deg/s)"), ("_dps", "deg/s"),
         ("_deg", "deg"), ("_um", "um"), ("_s", "s"), ("_v", "V"), ("v_q", "V"))  # fmt: skip


def quantity_unit(name):
    """Unit that a name ends in."""
    return next((unit for end, unit in UNITS if name.endswith(end)), "")


def _six_digits(value):
    return "-" if value is None else f"{value:.6g}"


def tables(result):
    """Tables for the terminal and the page."""
    f, n, effects = result.config.firmware, result.config.nominal, result.rounding_effects
    chosen = [("sid_c_f of [nominal]", _six_digits(n.sid_c_f), "F")]
    chosen += [(name, _six_digits(getattr(f, name)), quantity_unit(name)) for name in CHOSEN]
    simulated = result.simulated._asdict() if result.simulated else {}
    predicted = [
        (
            PREDICTED[name],
            _six_digits(value),
            _six_digits(simulated[name]) if name in simulated else "",
            quantity_unit(name),
        )
        for name, value in predicted_values(result).items()
    ]
    rounding = [
        ("half a step of the converter, without noise", _six_digits(effects.adc_dead_band_dps), "deg/s"),
        ("one LSB of the force word", _six_digits(effects.word_lsb_dps), "deg/s"),
        ("one LSB of the force DAC", _six_digits(effects.dac_lsb_dps), "deg/s"),
        ("one code of V_q, as quadrature", _six_digits(effects.v_q_lsb_dps), "deg/s"),
        ("noise at the converter, relative to its step", _six_digits(effects.dither), "rms steps"),
    ]
    range_rows = [(r.what, f"{r.value:.4g}", f"{r.limit:.4g}", r.unit, f"{100 * r.share:.0f} %") for r in result.ranges]
    plan = [
        (m.what, f"{m.distance_hz:.6g}", f"{m.least_hz:.4g}", "yes" if m.is_satisfied else "no", m.effect)
        for m in result.plan
    ]
    return [
        Table("Chosen", ("key", "value", "unit"), chosen, f"amplitude bounded by: {result.amplitude_bound}"),
        Table(
            "Predicted",
            ("quantity", "value", "simulated", "unit"),
            predicted,
            "nominal board, noise off; the simulated scale factor is that of a sine at 2 % of the bandwidth",
            (1, 2),
        ),
        Table("Rounding and limit cycles", ("effect", "value", "unit"), rounding),
        Table("Ranges", ("range", "needed", "limit", "unit", "used"), range_rows, numeric=(1, 2, 4)),
        Table("Frequency plan", ("distance", "Hz", "required Hz", "met", "effect"), plan, numeric=(1, 2)),
    ]


def as_json(result):
    """One object with every number."""
    return {
        "chosen": {"sid_c_f": result.config.nominal.sid_c_f, **{k: getattr(result.config.firmware, k) for k in CHOSEN}},
        "predicted": predicted_values(result),
        "simulated": result.simulated._asdict() if result.simulated else None,
        "rounding": {k: float(v) for k, v in result.rounding_effects._asdict().items()},
        "start_up": {"nominal": result.nominal._asdict(), "slowest": result.slowest._asdict()},
        "ranges": [{**r._asdict(), "kept": r.is_satisfied} for r in result.ranges],
        "plan": [{**m._asdict(), "kept": m.is_satisfied} for m in result.plan],
        "warnings": list(result.warnings),
    }


def write(result, folder, progress=None, cells=9):
    """design.html in `folder`: tables, open and closed loop, margins over bandwidth and split."""
    from testbench.console import report
    from testbench.design import design_pictures
    from testbench.paper.loop import loop_pictures
    from testbench.paper.loop.loop_parameters import loop_parameters

    config, p = result.config, loop_parameters(result.config)
    split, bandwidth = abs(config.nominal.fx_hz - config.nominal.fy_hz), result.choice.bandwidth_hz
    reach = np.geomspace(1 / 4, 4, cells)
    margin_map = margins.margin_map(config, bandwidth * reach, split * reach, result.limits, progress)
    pictures = [
        (
            "The best loop for each bandwidth and split, its SID capacitor included. Grey: no stable loop meets "
            "the limits of peak and modulus margin. Star: this design.",
            design_pictures.margins(margin_map, (bandwidth, split)),
        ),
        ("Open loop of this design, with its margins.", loop_pictures.bode(p, result.advice)),
        ("Closed loop of this design.", loop_pictures.closed_loop_bode(p)),
    ]
    path = folder / "design.html"
    notes = result.warnings or ("no warnings",)
    report.write_html(
        path, "Design", tables(result), pictures, notes, [("configuration", to_toml(config, inherited=False))]
    )
    return path
