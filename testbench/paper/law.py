"""What phase errors do to the running gyroscope: scale factor over ye1, drive loop over xe1, shares of the noise.

    scale_law   K from rates +-100 deg/s, words chosen so that ye1 is left at each angle; K(0) cos(..) = K
    drive_law   frequency, A_d, V_q and rate word at -30 deg/s with xe1 left at each angle (the paper's Fig. 2)
    noise_law   angle random walk with one source on at a time, with all, and with each one off

Truth phases come from `bench.Judge`.
Source    docs/paper.md
"""

import math

import numpy as np

from testbench import config as configuration
from testbench.paper.calibration.bench import Bench, Judge
from testbench.paper.loop import derived, parts, sensitivity
from testbench.paper.loop import loop as loops
from testbench.paper.measure import measure_allan
from testbench.paper.measure.characterise import engine_of

SOURCES = ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")
SCALE_YE1_DEG = (0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0)
DRIVE_XE1_DEG = (-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0)
NOT_RETIMED = "none, edges not re-timed"
RATE_DPS, SETTLE_S, READ_S = 100.0, 3.0, 6.0


def _scale(config):
    bench = Bench(config, RATE_DPS, 25.0, engine_of(config))
    bench.wait(SETTLE_S)
    plus = bench.record(READ_S).hann("rate_word")
    bench.rate_dps = -RATE_DPS
    bench.wait(SETTLE_S)
    minus = bench.record(READ_S).hann("rate_word")
    deg = Judge(bench).residuals().deg
    angle = math.radians(deg["ye1"] + deg["xe2"])
    return {"lsb_per_dps": (plus - minus) / (2 * RATE_DPS), "deg": deg, "inverse_cosine": 1 / math.cos(angle),
            "inverse_cosine_ye1": 1 / math.cos(math.radians(deg["ye1"]))}  # fmt: skip


def scale_law(base, cases_deg, angles_deg=SCALE_YE1_DEG):
    """Rows of the law: the cases, then case 5 with ye1 left at each angle; `ratio` is K over that of case 5.

    `law` = 1/cos(ye1 + xe2') and `eq12` = 1/cos(ye1) are relative to the same case; difference in ppm.
    """
    last = cases_deg["5"]
    sets = [(f"case {k}", values) for k, values in cases_deg.items()]
    sets += [(f"ye1 {a:g}", last | {"phase_sense_sine": last["phase_sense_sine"] - a}) for a in angles_deg]
    configs = [configuration.changed(base, {f"firmware.{n}_deg": v for n, v in s.items()}) for _, s in sets]
    found = [_scale(config) for config in configs]
    unit = found[[name for name, _ in sets].index("case 5")]
    rows = []
    for (name, _), item in zip(sets, found):
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


def _drive(config):
    bench = Bench(config, -30.0, 25.0, engine_of(config))
    bench.wait(4.0)
    rows = bench.record(4.0)
    deg = Judge(bench).residuals().deg
    return {
        "deg": deg,
        "frequency_hz": rows.mean("frequency_word") * bench.lsb_hz,
        "drive_v": bench.drive_v(rows.mean("amplitude_word")),
        "quadrature_v": bench.quadrature_v(rows.mean("quadrature_code")),
        "rate_word": rows.hann("rate_word"),
    }


def drive_law(base, cases_deg, angles_deg=DRIVE_XE1_DEG):
    """Rows over xe1, with the sense phases of the paper's simulation left as they are without compensation."""
    free = cases_deg["3"]
    configs = [
        configuration.changed(
            base,
            {f"firmware.{n}_deg": v for n, v in (free | {"phase_drive_sine": free["phase_drive_sine"] - a}).items()},
        )
        for a in angles_deg
    ]
    return [_drive(config) for config in configs]


def derived_noise(config):
    """{source: {"arw_deg_per_rt_h", "instability_deg_per_h"}} by the linear loop, nothing simulated."""
    p = parts.parts(config)
    loop = loops.close(p)
    density = sensitivity.density_dps(p, loop)
    rounding = ("adc_rounding", "dac_rounding", "v_q_rounding")
    own = dict.fromkeys(("none", NOT_RETIMED), rounding)
    own |= {s: (s, *rounding) for s in ("thermomechanical", "cv", "adc", "dac")}
    out = {
        source: {"arw_deg_per_rt_h": 60 / math.sqrt(2) * math.hypot(*(density[n] for n in names))}
        for source, names in own.items()
    }
    out["all"] = {"arw_deg_per_rt_h": sensitivity.arw_deg_per_rth(p, loop)}
    floor = {"instability_deg_per_h": derived.instability_deg_per_h(p, loop)}
    return {name: out.get(name, {}) | (floor if name in ("all", "flicker") else {}) for name in ("all", *own, *SOURCES)}


def _quiet_allan(config, seconds, lsb_per_dps):
    bench = Bench(config, 0.0, 25.0, engine_of(config))
    bench.wait(4.0)
    pieces = []
    for _ in range(max(1, round(seconds / 10.0))):
        pieces.append(measure_allan.averaged(bench.record(10.0)["rate_word"].astype(float)))
    rate = np.concatenate(pieces) / lsb_per_dps
    found = measure_allan.analyse(rate, measure_allan.BASE_FRAMES * bench.frame_s)
    return {"arw_deg_per_rt_h": found.arw_deg_per_rt_h, "instability_deg_per_h": found.instability_deg_per_h}


SILENT = {f"noise.{s}": False for s in SOURCES}
NOISE_SETS = {
    "all": {},
    "none": SILENT,
    NOT_RETIMED: SILENT | {"firmware.reference_retimed": False},
    **{f"only {s}": {f"noise.{o}": o == s for o in SOURCES} for s in SOURCES},
    **{f"without {s}": {f"noise.{s}": False} for s in SOURCES},
}


def noise_law(base, cases_deg, seconds, lsb_per_dps):
    """{"all": .., "none": .., "only cv": .., "without cv": ..} of case 5; `seconds` of record by name of a set."""
    config = configuration.changed(base, {f"firmware.{n}_deg": v for n, v in cases_deg["5"].items()})
    return {
        name: _quiet_allan(configuration.changed(config, NOISE_SETS[name]), length, lsb_per_dps)
        for name, length in seconds.items()
    }
