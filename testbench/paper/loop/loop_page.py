"""What `gyro loop` prints and writes: tables of the advisor, the page with its pictures, one object for machines.

Source    docs/loop.md
"""

import math

import numpy as np

from testbench.config import changed
from testbench.console.text_table import Table, to_decimals
from testbench.paper.loop import advisor, confirm, equations, limit_cycles, notch_loop, sensitivity, temperature_tables
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run import simulate
from testbench.run.budget import ring_warnings

STEP_DPS, STEP_BEFORE_S, STEP_AFTER_S, MEAN_S = 100.0, 2.5, 1.0, 0.05
# field of Advice -> (text, unit, digits, factor)
NUMBERS = {
    "bandwidth_hz": ("bandwidth, -3 dB", "Hz", 2, 1),
    "peak_db": ("closed-loop peak within the bandwidth", "dB", 2, 1),
    "peak_hz": ("frequency of this peak", "Hz", 1, 1),
    "gain_margin_up_db": ("FTR gain margin, upwards", "dB", 1, 1),
    "gain_margin_down_db": ("FTR gain margin, downwards", "dB", 1, 1),
    "qsc_margin_up_db": ("QSC gain margin, upwards", "dB", 1, 1),
    "modulus_margin": ("modulus margin: smallest distance of L from -1", "", 3, 1),
    "delay_margin_us": ("delay margin", "us", 0, 1),
    "ring_hz": ("ringing frequency at the split, closed loop", "Hz", 2, 1),
    "ring_tau_s": ("time constant of this ringing", "s", 3, 1),
    "split_db": ("closed-loop gain at the ringing frequency", "dB", 2, 1),
    "lsb_per_dps": ("scale factor", "LSB/(deg/s)", 2, 1),
    "bias_dps": ("bias", "deg/s", 4, 1),
    "v_q": ("V_q at rate 0", "V", 4, 1),
}
# What a stable loop without a margin stands
NO_MARGIN = {
    "gain_margin_up_db": f"stable up to +{advisor.GAIN_LIMIT_DB:g} dB",
    "gain_margin_down_db": f"stable down to -{advisor.GAIN_LIMIT_DB:g} dB",
    "qsc_margin_up_db": f"stable up to +{advisor.GAIN_LIMIT_DB:g} dB",
}


class Study:
    """Everything that the command knows; pictures and the simulation are made on demand."""

    def __init__(self, config):
        self.config = config
        self.parts = loop_parameters(config)
        self.advice = advisor.advise(self.parts, advisor.BAND_HZ if config.is_paper_board else (0.0, math.inf))
        self.warnings = (*self.advice.warnings, *ring_warnings(config))
        self.rounding = limit_cycles.resolution(self.parts) if self.advice.stable else None
        firmware = config.firmware
        # a notch of the firmware, or one at the ring
        self.in_firmware = firmware.notch_hz > 0
        self.notch_at = (firmware.notch_width_hz, firmware.notch_hz) if self.in_firmware else (None, None)
        self.notch = notch_loop.effect(self.parts, *self.notch_at) if self.advice.stable else None
        self.simulated = self.step = self.still = None
        self.slower = simulate.rate_loop_pace(config)
        self.lines_hz = tuple(f / self.slower for f in confirm.LINES_HZ) if self.slower > 1 else confirm.LINES_HZ

    def simulate(self):
        """Play a multisine, a step, and rest without noise."""
        settle_s, window_s = confirm.SETTLE_S * simulate.pace(self.config), confirm.WINDOW_S * self.slower
        frame_hz = self.config.design_record().frame_hz
        sine = confirm.multisine(self.lines_hz, settle_s=settle_s, window_s=window_s, frame_hz=frame_hz)
        before_s, after_s = STEP_BEFORE_S * simulate.pace(self.config), STEP_AFTER_S * self.slower
        count = round((before_s + after_s) * frame_hz)
        step = np.where(np.arange(count) < round(before_s * frame_hz), 0.0, STEP_DPS)
        quiet = changed(self.config, confirm.QUIET)
        runs = confirm.run_profiles([self.config, quiet, quiet], [sine, step, np.zeros(count)])
        self.simulated = confirm.measured_response(runs[0], sine, self.lines_hz, window_s)
        word, begin = runs[1].columns["rate_word"], round(before_s * frame_hz)
        before, after = (float(np.mean(word[k - round(MEAN_S * frame_hz) : k])) for k in (begin, count))
        self.step = (np.arange(count) - begin) / frame_hz, (word - before) / (after - before)
        self.still = runs[2].columns["rate_word"][begin:], runs[2].columns["quadrature_code"][begin:]

    def difference(self):
        """Largest (dB, deg) between simulated and linear response, or None."""
        if self.simulated is None:
            return None
        ratio = self.simulated / (lp.response(lp.close(self.parts), self.lines_hz) * lp.DEG)
        return float(np.max(np.abs(20 * np.log10(np.abs(ratio))))), float(np.max(np.abs(np.degrees(np.angle(ratio)))))


def _number_row(advice, name):
    text, unit, digits, factor = NUMBERS[name]
    value = getattr(advice, name)
    if value is None and advice.stable and name in NO_MARGIN:
        return text, "none", NO_MARGIN[name]
    return text, to_decimals(None if value is None else value * factor, digits), unit


def tables(study):
    """Tables for the terminal and the page."""
    a, p = study.advice, study.parts
    loop_tables = [
        Table(
            "Loops around the sense mode",
            ("what", "value", "unit"),
            [_number_row(a, name) for name in NUMBERS],
            f"split {p.split_hz:.2f} Hz, SID {p.sid_stages} x {p.sid_hz:.2f} Hz; derived from the configuration",
        )
    ]
    if a.crossings:
        rows = [
            (f"{c.hz:.2f}", f"{c.lag_deg:.1f}", f"{c.lead_deg:.1f}", f"{c.delay_us:.0f}") for c in sorted(a.crossings)
        ]
        heads = ("|L| = 1 at Hz", "lag margin deg", "lead margin deg", "delay us")
        loop_tables.append(Table("Phase margins", heads, rows, numeric=(0, 1, 2, 3)))
    if study.rounding:
        r = study.rounding
        rows = [
            ("dead band without noise: half a converter step", f"{3600 * r.adc_dead_band_dps:.2f}", "deg/h"),
            ("one LSB of the force word", f"{3600 * r.word_lsb_dps:.3f}", "deg/h"),
            ("one LSB of the force DAC", f"{3600 * r.dac_lsb_dps:.2f}", "deg/h"),
            ("one code of V_q, as quadrature", f"{3600 * r.v_q_lsb_dps:.2f}", "deg/h"),
            ("noise at the converter over its step", f"{r.dither:.2f}", "rms steps"),
        ]
        loop_tables.append(Table("Rounding", ("what", "value", "unit"), rows))
    if a.stable:
        loop_tables += [temperature_tables.shares(study.config), temperature_tables.numbers(study.config)]
    if study.notch:
        n = study.notch
        rows = [
            (
                "ringing after 0.2 s, share of the rate step",
                f"{100 * n.ring_without:.3f}",
                f"{100 * n.ring_with:.3f}",
                "%",
            ),
            ("bandwidth", f"{n.bandwidth_without_hz:.2f}", f"{n.bandwidth_with_hz:.2f}", "Hz"),
            ("delay added", "0", f"{n.delay_ms:.3f}", "ms"),
            *(
                (f"gain for ringing {off} Hz off the notch", "0", f"{level:.1f}", "dB")
                for off, level in n.left_db.items()
            ),
        ]
        whose = "The firmware's notch" if study.in_firmware else "A notch"
        title = f"{whose} in the rate output, {n.centre_hz:.1f} Hz, {n.width_hz:g} Hz wide"
        loop_tables.append(Table(title, ("what", "without", "with", "unit"), rows, numeric=(1, 2)))
    if study.simulated is not None:
        db, deg = study.difference()
        ratio = study.simulated / (lp.response(lp.close(p), study.lines_hz) * lp.DEG)
        rows = [
            (f"{f:g}", f"{20 * math.log10(abs(r)):+.4f}", f"{math.degrees(np.angle(r)):+.3f}")
            for f, r in zip(study.lines_hz, ratio)
        ]
        span_lsb = np.ptp(study.still[0])
        note = f"largest {db:.4f} dB, {deg:.3f} deg; without noise the rate words at rest span {span_lsb} LSB"
        heads = ("Hz", "dB", "deg")
        loop_tables.append(Table("Simulation minus analysis", heads, rows, note, numeric=(0, 1, 2)))
    return loop_tables


def as_json(study):
    """One object with every number."""
    a = study.advice
    out = {name: value for name, value in a._asdict().items() if name != "crossings"}
    out["warnings"] = list(study.warnings)
    out["crossings"] = [{**c._asdict(), "delay_us": c.delay_us} for c in a.crossings]
    out["split_hz"], out["sid_hz"] = study.parts.split_hz, study.parts.sid_hz
    out["poles"] = [{"hz": q.hz, "tau_s": q.tau_s} for q in lp.poles(lp.close(study.parts))[:8]]
    out["rounding"] = study.rounding._asdict() if study.rounding else None
    out["notch"] = study.notch._asdict() | {"in_firmware": study.in_firmware} if study.notch else None
    out["over_temperature"] = temperature_tables.as_json(study.config) if a.stable else None
    out["simulated"] = None
    if study.simulated is not None:
        db, deg = study.difference()
        out["simulated"] = {
            "f_hz": list(study.lines_hz),
            "lsb_per_dps": np.abs(study.simulated).tolist(),
            "phase_deg": np.degrees(np.angle(study.simulated)).tolist(),
            "largest_db": db,
            "largest_deg": deg,
        }
    return out


def sensitivity_tables(sensitivity_rows):
    """The strongest six of each observable, and the whole matrix of changes."""
    names = list(sensitivity.OBSERVABLES)
    best = []
    for name in names:
        text, unit = sensitivity.OBSERVABLES[name]
        for rank, row in enumerate(sensitivity.ranking(sensitivity_rows, name)[:6], 1):
            label = (row.parameter.name, row.parameter.unit)
            best.append((f"{text} ({unit})" if rank == 1 else "", str(rank), *label, f"{row.change[name]:+.4g}"))
    matrix_rows = [
        (
            row.parameter.name,
            row.parameter.unit,
            *(f"{v:+.3g}" if abs(v) >= sensitivity.RESOLUTION[k] else "" for k, v in row.change.items()),
        )
        for row in sensitivity_rows
    ]
    heads = ("parameter", "step", *(f"{text}, {unit}" for text, unit in sensitivity.OBSERVABLES.values()))
    return [
        Table(
            "Strongest influences on each observable",
            ("observable", "rank", "parameter", "step", "change"),
            best,
            numeric=(1, 4),
        ),
        Table(
            "Change of each observable for one step of each parameter",
            heads,
            matrix_rows,
            "Central differences of the linear loops. Empty: below the resolution of the difference.",
            numeric=tuple(range(2, len(heads))),
        ),
    ]


def misprint_table(y, w_d, m_c, ye1_rad):
    """The paper's misprints, with the numbers of a gyroscope: sense mode, drive frequency, Coriolis mass, ye1."""
    rows = [
        (m.where, m.printed, m.right, m.example[0], f"{m.example[1]:.4g}", f"{m.example[2]:.4g}")
        for m in equations.misprints(y, w_d, m_c, ye1_rad)
    ]
    heads = ("equation", "printed", "correct", "number", "as printed", "correct")
    return Table("Misprints of the paper", heads, rows, numeric=(4, 5))


def map_axes(p):
    """(x, values, y, values) of the three maps: the SID corner beside the split, and factors on the loop."""
    split = np.geomspace(0.22, 2.9, 26) * p.split_hz
    sid = np.geomspace(0.14, 2.9, 26) * abs(p.split_hz)
    gain, zero = np.geomspace(0.2, 6, 26), np.geomspace(0.1, 10, 26)
    return ("sid_hz", sid, "split_hz", split), ("crossover", gain, "sid_hz", sid), ("zero", zero, "crossover", gain)


def write(study, folder, progress=None, coarse=1, parameters=sensitivity.PARAMETERS):
    """loop.html in `folder`; `coarse` takes every so many points of the maps, `parameters` are those of the ranking."""
    from testbench.console import report
    from testbench.paper.loop import loop_pictures as draw

    p, a = study.parts, study.advice
    pictures, page_tables = [], tables(study)
    maps = [advisor.stability_map(p, x, xs[::coarse], y, ys[::coarse], progress) for x, xs, y, ys in map_axes(p)]
    operating_point = {"sid_hz": p.sid_hz, "split_hz": p.split_hz, "crossover": 1.0, "zero": 1.0}
    pictures.append(
        (
            "Three maps of the closed-loop maximum. Red: stability limit; star: this configuration. Left: the FTR gain "
            "is scaled with the split, so that the crossover stays. A split that is too small or a SID that is too "
            "fast is unstable, because the SID must lag by more than 90 deg at the split.",
            draw.draw_stability_maps(maps, [(operating_point[m.x], operating_point[m.y]) for m in maps]),
        )
    )
    if a.stable:
        pictures = [
            (
                "|L| passes 0 dB three times: at the crossover, and on both flanks of the sense mode's resonance at "
                "the split. On the flanks the phase of L is beyond -180 deg; the loop is stable only because the SID "
                "lags so much.",
                draw.bode(p, a),
            ),
            (
                "Rate word per rate: flat up to the bandwidth, then three poles; the peak at the split is the sense "
                "mode. Bottom, if simulated: difference of the simulated lines from the analysis.",
                draw.closed_loop_bode(p, study.simulated, study.lines_hz),
            ),
            (
                "A rate step excites ringing at the split: a few tenths of a percent for a third of a second. A notch "
                "in the rate output removes it if the notch is at the ringing frequency.",
                draw.step(p, study.step, *study.notch_at),
            ),
            (
                "Sense phase errors from -9 to 9 deg and -6 to 6 deg: the bandwidth falls by half a hertz with ye1 "
                "alone and by 0.8 Hz with both, because the loop gain is proportional to cos(ye1 + ye2').",
                draw.phase_influence(p),
            ),
            *pictures,
            (
                "Top: force of a sine that is rounded to 20 bits; it is zero below half an LSB. Bottom: without noise "
                "the loops come to rest in the dead band of the converter. With a finer converter they would oscillate "
                "by one code of V_q.",
                draw.rounding(study.config, p),
            ),
        ]
        sensitivity_rows = sensitivity.rows(study.config, parameters, progress)
        pictures.append(
            (
                "Each column is an observable, each row one step of a parameter. A colour is the share of the column's "
                "largest change, which is printed below the column's name.",
                draw.influence(sensitivity_rows),
            )
        )
        page_tables += sensitivity_tables(sensitivity_rows)
    y = equations.Mode(p.mass_kg, p.wy_rad_s, p.qy)
    page_tables.append(misprint_table(y, p.w_rad_s, p.coriolis_mass_kg, p.ye1_rad))
    path = folder / "loop.html"
    report.write_html(path, "Loop advisor", page_tables, pictures, study.warnings or ("no warnings",))
    return path
