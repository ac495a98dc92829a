"""What an effect that was found in a part would do to the gyroscope: two runs of the closed loop, with it and without.

    rates      0, then +100, then -100 deg/s; bias and scale factor from the means behind each step, noise from the rest
    paired     both runs have the same noise sample by sample: the difference is the effect's alone
    mapping    a converter's error goes in as parts of full scale, a DAC's in its LSB, a rate as a rate; a resonator's
               law as `gyro_laws.laws_of_loop` writes it for the drive mode: as strong at 5 um as it was in the part
    meters     of each kind of law, the meter that has most of it; a law of temperature at WARM_DEGC
               where the loop does not lock with it, a tenth, a hundredth .. of it
    control    springs too weak to matter: what two runs differ by of themselves, as codes flip; the largest counts
    not run    what belongs to an instrument or a preparation and has no counterpart on the board: listed
Source    docs/measured_results.md
"""

import html
import re
from typing import NamedTuple

import numpy as np

from analog_frontend.effects import rate_vibration
from analog_frontend.parts.adc import CURVE
from testbench import config
from testbench.measured.exam import part_page
from testbench.measured.models.gyro_laws import AMPLITUDE_M
from testbench.measured.parts import dac_levels
from testbench.run import simulate

RATE_DPS, ZERO_RATE_S, STEP_S, MEAN_S = 100.0, 1.0, 0.8, 0.3
WORD_PER_DPS = 8651.0
SEED = 7
CONTROLS = (1e-9, -1e-9, 1e-8, -1e-8)  # of the spring
SIGNIFICANCE_FACTOR = 2.0  # times the largest change of a control, from which a change is called one
MEASURED = ("scale factor", "bias", "noise")
WARM_DEGC = 35.0
DRIVE_BITS, SENSE_BITS = 16, 20  # of the board's DACs
LOCKED, WEAKEST = 0.5, 4  # share of the scale factor that a locked loop has; tens by which a law is made weaker
FRAMES_PER_POINT = 8  # frames averaged for a point of the picture: 1 ms


class Case(NamedTuple):
    """One effect for the loop: what is set, and in words what it stands for; of which set."""

    name: str
    words: str
    settings: dict
    vibration: tuple = ()
    temperature_degc: float = 25.0
    set: str = ""


class Reading(NamedTuple):
    """Means and noise of one run (deg/s), and the rate itself."""

    bias_dps: float
    scale: float
    rms_dps: float
    rate_dps: np.ndarray


def levels(effects, bits):
    """Texts of [effects] for a DAC of so many bits with the errors in volts of one that was measured."""
    for e in effects:
        if e["port"] == "dac" and "coefficients" in e:
            coefficients = {name: c["value"] for name, c in e["coefficients"].items()}
            return dac_levels.levels_texts(coefficients, e["bits"], bits)
    return []


def _key(law):
    """Key of [effects] that a converter's law sets; "" if the board's converter cannot have it."""
    if law.startswith("curve T"):
        return "adc_curve"
    if law.startswith("gain with") and "temp" in law:
        return "adc_gain_tc_per_k"
    return {"turnover": "adc_turnover", "memory": "adc_memory"}.get(law, "")


def converter(effects):
    """{meter: {key of [effects]: value}} of the laws of converters that the board's converter can have."""
    meters = {}
    for e in effects:
        meter, _, law = e["law"].partition(": ")
        key, per_volt = _key(law), e["value"] * 1e-6 / e.get("full_v", 1.0)
        mine = meters.setdefault(meter, {})
        if key == "adc_curve":
            mine.setdefault(key, [0.0] * CURVE)[int(law[7:]) - 2] = per_volt
        elif key == "adc_gain_tc_per_k":
            span = re.search(r"1 is ([-+.\deE]+)", e["text"])
            if span:
                mine[key] = per_volt / float(span[1])
        elif key:
            mine[key] = per_volt
    meters.pop("source", None)
    return {meter: meter_settings for meter, meter_settings in meters.items() if meter_settings}


def cases(sets):
    """Cases of what the sets have: {set: JSON} as in build/measured.json."""
    return [case._replace(set=name) for name, data in sets.items() for case in _data_set_cases(name, data["jobs"])]


def controls(device):
    """Runs that should differ from the plain one by nothing: the spring is changed by a share of it at 5 um."""
    k = device.mass_kg * (2 * np.pi * device.fx_hz) ** 2
    texts = {share: f"force_x = {-share * k / AMPLITUDE_M**2!r} x^3" for share in CONTROLS}
    return [Case(f"control: {share:g} of the spring", text, {"laws": [text]}) for share, text in texts.items()]


def _data_set_cases(name, jobs):
    out, effects = [], jobs[0]["effects"]
    texts = levels(effects, DRIVE_BITS)
    if texts:
        words = f"{len(texts)} laws in LSB of 16 bit"
        out.append(Case(f"{name}: levels as drive DAC", words, {"drive_dac_levels": texts}))
        words, fine = "the same errors in volts, at 20 bit", levels(effects, SENSE_BITS)
        out.append(Case(f"{name}: levels as force DAC", words, {"sense_dac_levels": fine}))
    out += _meter_cases(name, [e for job in jobs for e in job["effects"]])
    for job in jobs:
        out += _vibration_cases(name, job["effects"])
        for c in job.get("gyroscope", ()):
            title = f"{name}, {job['label']}: {c['name']}"
            words = f"effects.laws: {c['text']}; at 5 um {c['share']:.3g} of the {c['of']}, as in the part"
            out.append(Case(title, words, {"laws": [c["text"]]}))
    return out


def _meter_cases(name, effects):
    """For each kind of law of converters, the meter with the largest coefficient."""
    worst = {}
    for meter, meter_settings in converter([e for e in effects if ": " in e["law"]]).items():
        for key, value in meter_settings.items():
            if key not in worst or _largest_magnitude(value) > _largest_magnitude(worst[key][1]):
                worst[key] = (meter, value)
    out = []
    for key, (meter, value) in sorted(worst.items()):
        words, degc = f"{key} = {_format_value(value)}", 25.0
        if key == "adc_gain_tc_per_k":
            words, degc = f"{words}, both runs at {WARM_DEGC:g} degC", WARM_DEGC
        out.append(Case(f"{name}: {meter} as converter, {key}", words, {key: value}, temperature_degc=degc))
    return out


def _vibration_cases(name, effects):
    """Lines of vibration, where they settle."""
    out = []
    for e in effects:
        if "hz" in e:
            f_hz, quality, rms = e["hz"], max(e["quality"], 1.0), float(np.sqrt(e["value"]))
            words = f"{f_hz:.3g} Hz, {rms:.3g} deg/s rms, quality {quality:.2g}"
            out.append(Case(f"{name}: vibration at {f_hz:.3g} Hz", words, {}, (f_hz, quality, rms)))
    return out


def not_run(sets):
    """[(set, job, law, port, kind)] of the named effects that no case has."""
    out = []
    for name, data in sets.items():
        for job in data["jobs"]:
            covered_laws = {c["name"] for c in job.get("gyroscope", ())}
            for e in job["effects"]:
                meter, _, law = e["law"].partition(": ")
                converts = _key(law) and meter != "source"
                if not (e["law"] in covered_laws or levels([e], DRIVE_BITS) or converts or "vibration" in law):
                    out.append((name, job["label"], e["law"], e["port"], e.get("kind", "")))
    return out


def _largest_magnitude(value):
    return float(np.max(np.abs(value)))


def _format_value(value):
    return f"{value:.3g}" if np.isscalar(value) else "[" + ", ".join(f"{v:.2g}" for v in value) + "]"


def run_case(case):
    """`Reading` of the run of a case; one without settings: the board as it is."""
    total = ZERO_RATE_S + 2 * STEP_S
    points = [[0.0, 0.0], [ZERO_RATE_S, 0.0], [ZERO_RATE_S + 0.001, RATE_DPS], [ZERO_RATE_S + STEP_S, RATE_DPS]]
    points += [[ZERO_RATE_S + STEP_S + 0.001, -RATE_DPS], [total, -RATE_DPS]]
    if case.vibration:
        f_hz, quality, rms = case.vibration
        t, x = np.array(rate_vibration.profile(total, f_hz, quality, rms, SEED)).T
        steps = np.interp(t, *np.array(points).T)
        points = [[float(a), float(b)] for a, b in zip(t, steps + x)]
    cfg = config.Config()
    scenario = {"seconds": total, "rate_dps": points, "diagnose": False, "temperature_degc": case.temperature_degc}
    update = {"scenario": cfg.scenario.model_copy(update=scenario)}
    cfg = cfg.model_copy(update=update | {"effects": cfg.effects.model_copy(update=case.settings)})
    watch = simulate.Watch("rate_word")
    simulate.run(cfg, sinks=(watch,))
    rate = watch.values() / WORD_PER_DPS
    per_s = len(rate) / total
    at = [
        int(per_s * t)
        for t in (
            ZERO_RATE_S - MEAN_S,
            ZERO_RATE_S,
            ZERO_RATE_S + STEP_S - MEAN_S,
            ZERO_RATE_S + STEP_S,
            total - MEAN_S,
        )
    ]
    plus, minus = rate[at[2] : at[3]].mean(), rate[at[4] :].mean()
    zero_rate_dps = rate[at[0] : at[1]]
    return Reading(
        float(zero_rate_dps.mean()), float((plus - minus) / (2 * RATE_DPS)), float(zero_rate_dps.std()), rate
    )


def _run_until_lock(case):
    """(`Reading`, case) of a run; a law with which the loop does not lock is made weaker by tens, and this is said."""
    one, weaker = run_case(case), case
    for k in range(1, WEAKEST + 1):
        if abs(one.scale) > LOCKED or "laws" not in case.settings:
            break
        laws = []
        for text in case.settings["laws"]:
            port, _, expression = text.partition(" = ")
            coefficient, _, product = expression.partition(" ")
            laws.append(f"{port} = {float(coefficient) * 0.1**k!r} {product}")
        words = f"{case.words}. With it the loop does not lock; the run uses 1/{10**k} of it"
        weaker = case._replace(name=f"{case.name}, 1/{10**k} of it", words=words, settings={"laws": laws})
        one = run_case(weaker)
    return one, weaker


def closed_loop_section(sets):
    """(HTML: a table, and for each effect a paragraph and a picture; {set: [numbers of each effect]})."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    effect_cases = cases(sets)
    if not effect_cases:
        return "", {}
    bases, rows, words, data, itself = {}, [], [], {}, np.zeros(len(MEASURED))
    for case in (*controls(config.Config().device()), *effect_cases):
        degc = case.temperature_degc
        if degc not in bases:
            bases[degc] = run_case(Case("", "", {}, temperature_degc=degc))
        base = bases[degc]
        one, case = _run_until_lock(case)
        scale_ppm, bias = (one.scale / base.scale - 1) * 1e6, (one.bias_dps - base.bias_dps) * 3600
        measured = (scale_ppm, bias, 100 * (one.rms_dps / base.rms_dps - 1))
        numbers = dict(zip(("scale_ppm", "bias_deg_per_h", "noise_percent"), measured))
        data.setdefault(case.set, []).append({"effect": case.name, "words": case.words} | numbers)
        texts = [f"{x:+.3g}" for x in measured]
        rows.append((case.name, *texts))
        if not case.set:
            itself = np.maximum(itself, np.abs(measured))
            continue
        change = (
            (one.rate_dps - base.rate_dps)[: len(base.rate_dps) // FRAMES_PER_POINT * FRAMES_PER_POINT]
            .reshape(-1, FRAMES_PER_POINT)
            .mean(axis=1)
        )
        t = (np.arange(len(change)) + 0.5) * FRAMES_PER_POINT / 8000.0
        figure, panel = plt.subplots(figsize=(9, 2.6), layout="constrained")
        panel.plot(t, change * 3600, lw=0.6, color="#205090")
        panel.set_xlabel("time from lock (s); rate 0, +100, -100 deg/s")
        panel.set_ylabel("change of rate (deg/h)")
        large = [n for n, x, c in zip(MEASURED, measured, itself) if abs(x) > SIGNIFICANCE_FACTOR * c]
        sentence = (
            f"{case.words}. Scale factor {texts[0]} ppm, bias {texts[1]} deg/h, noise of the rate word at rest "
            f"{texts[2]} %, compared to the run without it (bias {base.bias_dps:.4g} deg/s, "
            f"{base.rms_dps:.3g} deg/s rms). Larger than {SIGNIFICANCE_FACTOR:g} times the controls: "
            f"{', '.join(large) or 'nothing'}."
        )
        words.append(
            f"<h3>{html.escape(case.name)}</h3><p>{html.escape(sentence)}</p><figure>{part_page.png(figure)}<figcaption>"
            "Rate with the effect minus rate without it, same noise. The steps show the scale factor, the first second "
            "shows the bias.</figcaption></figure>"
        )
    head = ("effect", "scale factor (ppm)", "bias (deg/h)", "noise at rest (%)")
    omitted_effects, more = not_run(sets), ""
    if omitted_effects:
        more = (
            "<p>Named effects without a counterpart in the plant of the board; they were not run:</p>"
            + part_page.table(("set", "job", "law", "port", "kind"), omitted_effects)
        )
    intro = (
        "<h2>The same effects in the closed loop</h2><p>Pairs of runs of the gyroscope, with and without the effect, "
        "the same noise sample by sample. The first rows are controls; a change that is not larger than theirs is not "
        "an effect.</p>"
    )
    return intro + part_page.table(head, rows, (1, 2, 3)) + "".join(words) + more, data
