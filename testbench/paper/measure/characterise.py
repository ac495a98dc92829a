"""`gyro characterise`: everything the paper measures of one register set at one temperature.

    record at rest      bias, V_q, drive frequency, A_d, Allan deviation (scenario.seconds long)
    22 rates            scale factor, nonlinearity, asymmetry; where V_q rails
    multisine, sweep    bandwidth, magnitude and phase

`POINTS` is the same as an engine of a campaign: one point to a case and temperature, so that it may be killed.
Source    docs/paper.md
"""

import json
import math

import numpy as np

from testbench.campaign.plan.engines import Engine
from testbench.engines import baseband
from testbench.errors import ConfigError
from testbench.paper.calibration.bench import Bench
from testbench.paper.calibration.calibrate import SETTLE_S
from testbench.paper.measure import measure_allan, measure_bandwidth, measure_scale
from testbench.run import build

WARM_S = 4.0
PIECE_S = 20.0
CURVES = ("scale_residual_ppm", "scale_words", "quadrature_v_of_rate", "tau_s", "adev_dps", "response_hz",
          "response_db", "response_deg", "swept_hz", "swept_db", "swept_deg")  # fmt: skip


def at_rest(bench, seconds):
    """Means of a record at rest, and its rate words averaged over 10 ms."""
    words, sums, pieces = [], dict.fromkeys(("quadrature_code", "frequency_word", "amplitude_word"), 0.0), 0
    left = seconds
    while left > 1e-9:
        rows = bench.record(min(PIECE_S, left))
        words.append(measure_allan.averaged(rows["rate_word"].astype(float)))
        for name in sums:
            sums[name] += rows.mean(name)
        pieces += 1
        left -= PIECE_S
    return np.concatenate(words), {name: value / pieces for name, value in sums.items()}


def characterise(config, say=None, engine=None, rest_s=None, temp_degc=None):
    """{name: number, text or list} of one board as it is configured, at the scenario's first temperature.

    engine  name of an engine instead of that of the configuration
    """
    if temp_degc is None:
        first = config.scenario.temperature_degc
        temp_degc = float(first if isinstance(first, (int, float)) else first[0][1])
    rest_s = config.scenario.seconds if rest_s is None else rest_s

    def told(text):
        if say:
            say(text)

    told("start-up")
    bench = Bench(config, 0.0, temp_degc, engine)
    bench.settle(WARM_S)
    told("22 rates")
    words, codes, flags = measure_scale.sweep(bench)
    scale = measure_scale.fit(measure_scale.rates_dps(bench), words)
    told("multisine and sweep")
    lines = measure_bandwidth.multisine(bench, scale.lsb_per_dps)
    bench.settle(SETTLE_S)
    swept = measure_bandwidth.swept(bench, scale.lsb_per_dps)
    bench.settle(SETTLE_S)
    told(f"{rest_s:g} s at rest")
    rest, means = at_rest(bench, rest_s)
    rate = rest / scale.lsb_per_dps
    base_s = measure_allan.BASE_FRAMES * bench.frame_s
    out = {
        "locked": int(bench.locked),
        "temperature_degc": temp_degc,
        "scale_lsb_per_dps": scale.lsb_per_dps,
        "scale_sigma_lsb_per_dps": scale.sigma_lsb_per_dps,
        "nonlinearity_ppm": scale.nonlinearity_ppm,
        "asymmetry_ppm": scale.asymmetry_ppm,
        "quadrature_v": bench.quadrature_v(means["quadrature_code"]),
        "bias_dps": float(rate.mean()),
        "bias_sigma_dps": None,
        "frequency_hz": means["frequency_word"] * bench.lsb_hz,
        "drive_v": bench.drive_v(means["amplitude_word"]),
        "bandwidth_hz": lines.bandwidth_hz,
        "bandwidth_swept_hz": swept.bandwidth_hz,
        "peak_db": max(lines.gain_db),
        "quadrature_railed": int(bool(flags & 1 << 6)),
        "scale_residual_ppm": list(scale.residual_ppm),
        "scale_words": words.tolist(),
        "quadrature_v_of_rate": bench.quadrature_v(codes).tolist(),
        "response_hz": list(lines.frequency_hz),
        "response_db": list(lines.gain_db),
        "response_deg": list(lines.phase_deg),
        "swept_hz": list(swept.frequency_hz),
        "swept_db": list(swept.gain_db),
        "swept_deg": list(swept.phase_deg),
    }
    if rest_s >= 10.0:
        allan = measure_allan.analyse(rate, base_s)
        out |= {
            "arw_deg_per_rt_h": allan.arw_deg_per_rt_h,
            "instability_deg_per_h": allan.instability_deg_per_h,
            "floor_deg_per_h": allan.floor_deg_per_h,
            "floor_low_deg_per_h": allan.floor_low_deg_per_h,
            "floor_high_deg_per_h": allan.floor_high_deg_per_h,
            "floor_tau_s": allan.floor_tau_s,
            "tau_s": list(allan.tau_s),
            "adev_dps": list(allan.adev_dps),
            "bias_sigma_dps": allan.adev_dps[-1],
        }
    return out


def flat(found):
    """Numbers as they are, curves as one text each: what a campaign keeps."""
    return {name: json.dumps(value) if isinstance(value, list) else value for name, value in found.items()}


def unflat(kept):
    """The inverse of `flat`."""
    out = dict(kept)
    for name in CURVES:
        if isinstance(out.get(name), str) and out[name]:
            out[name] = json.loads(out[name])
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in out.items()}


def play(configs, sinks):
    """As `campaign.engines` says, one point to a call; no 8 kHz rows are kept."""
    return [flat(characterise(config, engine=engine_of(config))) for config in configs]


def engine_of(config):
    """The engine for hours, unless the configuration asks for the clocked one or for what only the others can do."""
    plain = config.firmware.adc_clock == "synchronous" and type(config.effects)() == config.effects
    if config.scenario.engine == "clocked" or not plain:
        return config.scenario.engine
    temp_degc = config.plant.temp_ref_degc
    try:
        baseband.prepare(build.params(config, temp_degc, temp_degc))
    except (ConfigError, ValueError):  # a ValueError is told by whoever runs it
        return config.scenario.engine
    return "baseband"


def _compile():
    from testbench.run import warmup

    warmup.warm_up()


POINTS = Engine(
    play, 1, ("testbench.paper.measure.characterise", "testbench.run.simulate", "testbench.engines.baseband"), _compile
)
