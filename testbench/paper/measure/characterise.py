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
from testbench.paper.calibration.calibrate_phases import SETTLE_S
from testbench.paper.measure import measure_allan, measure_bandwidth, measure_scale
from testbench.run import build

WARM_S = 4.0
PIECE_S = 20.0
PARTS = 5  # of a record at rest, for the scatter of its ARW
CURVES = ("scale_residual_ppm", "scale_words", "quadrature_v_of_rate", "tau_s", "adev_dps", "adev_sigma",
          "response_hz", "response_db", "response_deg", "swept_hz", "swept_db", "swept_deg")  # fmt: skip


def record_zero_rate(bench, seconds):
    """Rate words of a record at rest, averaged over 10 ms, and {column: means of its pieces}."""
    words, means = [], {name: [] for name in ("quadrature_code", "frequency_word", "amplitude_word")}
    remaining_s = seconds
    while remaining_s > 1e-9:
        rows = bench.record(min(PIECE_S, remaining_s))
        words.append(measure_allan.average_row_blocks(rows["rate_word"].astype(float)))
        for name, values in means.items():
            values.append(rows.mean(name))
        remaining_s -= PIECE_S
    return np.concatenate(words), means


def characterise(config, say=None, engine=None, zero_rate_s=None, temp_degc=None):
    """{name: number, text or list} of one board as it is configured, at the scenario's first temperature.

    engine  name of an engine instead of that of the configuration
    """
    if temp_degc is None:
        first = config.scenario.temperature_degc
        temp_degc = float(first if isinstance(first, (int, float)) else first[0][1])
    zero_rate_s = config.scenario.seconds if zero_rate_s is None else zero_rate_s

    def report_stage(text):
        if say:
            say(text)

    report_stage("start-up")
    bench = Bench(config, 0.0, temp_degc, engine)
    bench.settle(WARM_S)
    report_stage("22 rates")
    words, codes, flags = measure_scale.sweep(bench)
    scale = measure_scale.fit(measure_scale.rates_dps(bench), words)
    report_stage("multisine and sweep")
    lines = measure_bandwidth.multisine(bench, scale.lsb_per_dps)
    bench.settle(SETTLE_S)
    swept = measure_bandwidth.sweep_response(bench, scale.lsb_per_dps)
    bench.settle(SETTLE_S)
    report_stage(f"{zero_rate_s:g} s at rest")
    zero_rate_words, pieces = record_zero_rate(bench, zero_rate_s)
    means = {name: float(np.mean(values)) for name, values in pieces.items()}
    rate = zero_rate_words / scale.lsb_per_dps
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
    if zero_rate_s >= 10.0:
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
            "adev_sigma": list(allan.relative_sigma),
            "bias_sigma_dps": allan.adev_dps[-1],
        }
        out |= sigmas(bench, scale, lines, rate, base_s, allan.arw_deg_per_rt_h)
    if len(pieces["quadrature_code"]) > 1:
        codes = pieces["quadrature_code"]
        spread = np.std(codes, ddof=1) / math.sqrt(len(codes))
        out["quadrature_sigma_v"] = float(bench.quadrature_v(spread) - bench.quadrature_v(0.0))
    return out


def sigmas(bench, scale, lines, rate_dps, base_s, arw_deg_per_rt_h):
    """{name: one sigma} that the measured white rate noise N leaves.

    reading    N sqrt(1.5/T), a Hann-weighted mean over T    slope     reading / sqrt(sum (rate - mean)^2)
    line       N sqrt(2/T) over its amplitude, in dB         bandwidth line over the slope of the gain
    ARW        scatter of five parts of the record
    """
    n_dps = arw_deg_per_rt_h / 60.0
    rates = np.array(measure_scale.rates_dps(bench))
    reading = n_dps * math.sqrt(1.5 / measure_scale.READ_S)
    slope, half = (reading / math.sqrt(np.sum((x - x.mean()) ** 2)) for x in (rates, rates[rates > 0]))
    line_db = 20 / math.log(10) * n_dps * math.sqrt(2 / (bench.slower * measure_bandwidth.LINES_S))
    line_db /= bench.part * measure_bandwidth.LINE_DPS
    fall_db = -float(np.interp(lines.bandwidth_hz, lines.frequency_hz, np.gradient(lines.gain_db, lines.frequency_hz)))
    out = {
        "scale_noise_lsb_per_dps": slope * abs(scale.lsb_per_dps),
        "nonlinearity_sigma_ppm": reading / rates.max() * 1e6,
        "asymmetry_sigma_ppm": half * math.sqrt(2) * 1e6,
        "bandwidth_sigma_hz": line_db / fall_db if fall_db > 0 else math.nan,
        "response_sigma_db": line_db,
    }
    parts = np.array_split(rate_dps, PARTS)
    if len(parts[-1]) * base_s >= measure_allan.LEAST_S:
        arw = [measure_allan.analyse(part, base_s).arw_deg_per_rt_h for part in parts]
        out["arw_sigma_deg_per_rt_h"] = float(np.std(arw, ddof=1) / math.sqrt(PARTS))
    return out


def encode_curves(measured_values):
    """Numbers as they are, curves as one text each: what a campaign keeps."""
    return {name: json.dumps(value) if isinstance(value, list) else value for name, value in measured_values.items()}


def decode_curves(encoded_values):
    """The inverse of `encode_curves`."""
    out = dict(encoded_values)
    for name in CURVES:
        if isinstance(out.get(name), str) and out[name]:
            out[name] = json.loads(out[name])
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in out.items()}


def characterise_points(configs, sinks):
    """As `campaign.engines` says, one point to a call; no 8 kHz rows are kept."""
    return [encode_curves(characterise(config, engine=choose_engine(config))) for config in configs]


def choose_engine(config):
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


def _compile_kernels():
    from testbench.run import warmup

    warmup.warm_up()


POINTS = Engine(
    characterise_points,
    1,
    ("testbench.paper.measure.characterise", "testbench.run.simulate", "testbench.engines.baseband"),
    _compile_kernels,
)
