"""What phase errors do to the running gyroscope: scale factor over ye1 and ye2, drive loop over xe1, V_q's rail, noise.

    scale_law      K from rates +-100 deg/s, words chosen so that ye1 is left at each angle; K(0) cos(..) = K
    sense_law      K over ye1 at three ye2 (the paper's Fig. 6a)
    drive_law      frequency, A_d, V_q and rate word over xe1 at the rate and sense phases of the paper's Fig. 2b, c
    rail_law       nonlinearity of cases 1 to 3 where V_q has more span
    measure_noise  angle random walk of one set: one source on at a time, all, each one off

Truth phases come from `bench.Judge`.
Source    docs/paper.md
"""

import math

import numpy as np

from testbench import config as configuration
from testbench.paper.calibration.bench import Bench, Judge
from testbench.paper.calibration.calibrate_phases import REGISTER
from testbench.paper.loop import advisor, derived, loop_parameters, sensitivity
from testbench.paper.loop import loop as loops
from testbench.paper.measure import measure_allan, nonlinearity
from testbench.paper.measure.characterise import choose_engine

SOURCES = ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")
SCALE_YE1_DEG = (0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0)
SENSE_DEG = (-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0), (-6.0, 0.0, 6.0)  # ye1, ye2
DRIVE_XE1_DEG = (-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0)
DRIVE_DPS, DRIVE_YE1_DEG, DRIVE_YE2_DEG = -30.0, -9.0, -6.0  # the paper's Fig. 2b, c
SPAN_PART = 1.4  # of V_q, where it shall not rail at 500 deg/s
BLOCKS = 8  # of a record, for the standard error of its mean
NOT_RETIMED = "none, edges not re-timed"
RATE_DPS, SETTLE_S, READ_S = 100.0, 3.0, 6.0


def _block_means(rows, name):
    """Hann-weighted means of `BLOCKS` parts of a record: lines that ring beside the mean do not enter."""
    x = rows[name]
    x = x[: len(x) // BLOCKS * BLOCKS].reshape(BLOCKS, -1)
    weights = np.sin(np.pi * (np.arange(x.shape[1]) + 0.5) / x.shape[1]) ** 2
    return x @ weights / weights.sum()


def _standard_error(rows, name):
    """Standard error of the mean of a column, from the scatter of its parts."""
    return float(np.std(_block_means(rows, name), ddof=1) / math.sqrt(BLOCKS))


def _scale(config):
    bench = Bench(config, RATE_DPS, 25.0, choose_engine(config))
    bench.wait(SETTLE_S)
    plus = bench.record(READ_S)
    bench.rate_dps = -RATE_DPS
    bench.wait(SETTLE_S)
    minus = bench.record(READ_S)
    deg = Judge(bench).residuals().deg
    angle = math.radians(deg["ye1"] + deg["xe2"])
    k = (plus.hann("rate_word") - minus.hann("rate_word")) / (2 * RATE_DPS)
    sigma = math.hypot(_standard_error(plus, "rate_word"), _standard_error(minus, "rate_word")) / (2 * RATE_DPS)
    return {"lsb_per_dps": k, "sigma_lsb_per_dps": sigma, "deg": deg, "inverse_cosine": 1 / math.cos(angle),
            "inverse_cosine_ye1": 1 / math.cos(math.radians(deg["ye1"]))}  # fmt: skip


def set_residual_phases(base, words, **deg):
    """Configuration with the words of a case, turned so that these residual phases (deg) are left where it leaves 0."""
    turned = dict(words)
    for node, angle in deg.items():
        turned[REGISTER[node]] += -angle if node.endswith("1") else angle
    return configuration.changed(base, {f"firmware.{n}_deg": v for n, v in turned.items()})


def scale_law(base, cases_deg, angles_deg=SCALE_YE1_DEG):
    """Rows of the law: the cases, then case 5 with ye1 left at each angle; `ratio` is K over that of case 5.

    `law` = 1/cos(ye1 + xe2') and `eq12` = 1/cos(ye1) are relative to the same case; difference in ppm.
    """
    last = cases_deg["5"]
    sets = {f"case {k}": set_residual_phases(base, words) for k, words in cases_deg.items()}
    sets |= {f"ye1 {a:g}": set_residual_phases(base, last, ye1=a) for a in angles_deg}
    scale_by_set = {name: _scale(config) for name, config in sets.items()}
    unit = scale_by_set["case 5"]
    rows = []
    for name, item in scale_by_set.items():
        ratio = item["lsb_per_dps"] / unit["lsb_per_dps"]
        law = item["inverse_cosine"] / unit["inverse_cosine"]
        eq12 = item["inverse_cosine_ye1"] / unit["inverse_cosine_ye1"]
        rows.append(
            {
                "name": name,
                **item,
                "ratio": ratio,
                "law_ppm": (ratio / law - 1) * 1e6,
                "eq12_ppm": (ratio / eq12 - 1) * 1e6,
            }
        )
    return rows


def sense_law(base, cases_deg, angles_deg=SENSE_DEG):
    """Rows of K with ye1 and ye2 of case 5 left at each pair of angles: the paper's Fig. 6a."""
    last = cases_deg["5"]
    return [
        _scale(set_residual_phases(base, last, ye1=a, ye2=b)) | {"ye1": a, "ye2": b}
        for b in angles_deg[1]
        for a in angles_deg[0]
    ]


def _drive(config):
    bench = Bench(config, DRIVE_DPS, 25.0, choose_engine(config))
    bench.wait(4.0)
    rows = bench.record(4.0)
    code, lsb_v = rows.mean("quadrature_code"), bench.quadrature_v(0.5) - bench.quadrature_v(-0.5)
    return {
        "deg": Judge(bench).residuals().deg,
        "frequency_hz": rows.mean("frequency_word") * bench.lsb_hz,
        "drive_v": bench.drive_v(rows.mean("amplitude_word")),
        "quadrature_v": bench.quadrature_v(code),
        "rate_word": rows.hann("rate_word"),
        "sigma": {
            "frequency_hz": _standard_error(rows, "frequency_word") * bench.lsb_hz,
            "drive_v": bench.drive_v(_standard_error(rows, "amplitude_word")),
            "quadrature_v": _standard_error(rows, "quadrature_code") * lsb_v,
            "rate_word": _standard_error(rows, "rate_word"),
        },
    }


def drive_law(base, cases_deg, angles_deg=DRIVE_XE1_DEG):
    """Rows over xe1, xe2 compensated, with the rate and the sense phases of the paper's simulation."""
    sense = {"ye1": DRIVE_YE1_DEG, "ye2": DRIVE_YE2_DEG}
    return [_drive(set_residual_phases(base, cases_deg["5"], xe1=a, **sense)) for a in angles_deg]


def rail_law(base, cases_deg):
    """{case: `nonlinearity.read` of its 22 rates} of cases 1 to 3 at 25 degC with `SPAN_PART` of V_q's span."""
    more = {"nominal.quad_dac_span_v": SPAN_PART * base.nominal.quad_dac_span_v,
            "plant.quad_dac_span_v": SPAN_PART * base.plant.quad_dac_span_v,
            "firmware.quadrature_ceiling_v": SPAN_PART * base.firmware.quadrature_ceiling_v}  # fmt: skip
    wide = configuration.changed(base, more)
    return {case: nonlinearity.read(set_residual_phases(wide, cases_deg[case])) for case in ("1", "2", "3")}


def derived_noise(config):
    """{source: {"arw_deg_per_rt_h", "instability_deg_per_h"}} by the linear loop, nothing simulated."""
    p = loop_parameters.loop_parameters(config)
    loop = loops.close(p)
    density = sensitivity.density_dps(p, loop)
    rounding = ("adc_rounding", "dac_rounding", "v_q_rounding")
    terms = dict.fromkeys(("none", NOT_RETIMED), rounding)
    terms |= {s: (s, *rounding) for s in ("thermomechanical", "cv", "adc", "dac")}
    out = {
        source: {"arw_deg_per_rt_h": 60 / math.sqrt(2) * math.hypot(*(density[n] for n in names))}
        for source, names in terms.items()
    }
    out["all"] = {"arw_deg_per_rt_h": sensitivity.arw_deg_per_rth(p, loop)}
    floor = {"instability_deg_per_h": derived.instability_deg_per_h(p, loop)}
    return {
        name: out.get(name, {}) | (floor if name in ("all", "flicker") else {}) for name in ("all", *terms, *SOURCES)
    }


def _quiet_allan(config, seconds, lsb_per_dps):
    bench = Bench(config, 0.0, 25.0, choose_engine(config))
    bench.wait(4.0)
    pieces = []
    for _ in range(max(1, round(seconds / 10.0))):
        pieces.append(measure_allan.average_row_blocks(bench.record(10.0)["rate_word"].astype(float)))
    rate = np.concatenate(pieces) / lsb_per_dps
    allan = measure_allan.analyse(rate, measure_allan.BASE_FRAMES * bench.frame_s)
    return {"arw_deg_per_rt_h": allan.arw_deg_per_rt_h, "instability_deg_per_h": allan.instability_deg_per_h}


SILENT = {f"noise.{s}": False for s in SOURCES}
NOISE_SETS = {
    "all": {},
    "none": SILENT,
    NOT_RETIMED: SILENT | {"firmware.reference_retimed": False},
    **{f"only {s}": {f"noise.{o}": o == s for o in SOURCES} for s in SOURCES},
    **{f"without {s}": {f"noise.{s}": False} for s in SOURCES},
}


def measure_noise(base, cases_deg, name, seconds):
    """{"arw_deg_per_rt_h", "instability_deg_per_h"} of case 5 with a set of `NOISE_SETS`, `seconds` of record.

    The scale factor is that of the linear loop.
    """
    config = set_residual_phases(base, cases_deg["5"])
    unit = advisor.dc_gain(loops.close(loop_parameters.loop_parameters(config))) * loops.DEG
    return _quiet_allan(configuration.changed(config, NOISE_SETS[name]), seconds, unit)
