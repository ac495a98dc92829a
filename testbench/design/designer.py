"""From a TARGET to a configuration, and what it will do: each step chooses some keys or says which limit stops it.

    1  phase words  if the target wants them: from the phase budget
    2  amplitude    from the scale, from the user, or the largest that the ranges hold
    3  rate loop    SID capacitor, crossover, zero: `rate_loop`
    4  drive loops  and words of the search: `drive_loops`
    5  quadrature   crossover at a 25th of the bandwidth, faster if the start-up needs it
    6  prediction   `advisor`, `start_up`, `ranges`, `frequency_plan`, `budget` of the finished configuration

Rates and word lengths are those of [design]. A key that [firmware] of the TARGET has is never changed.
Source  docs/design_of_loops.md
"""

import math
import re
from typing import NamedTuple

from testbench.config import changed
from testbench.config import from_dict as config_of
from testbench.design import drive_loops, frequency_plan, range_check, rate_loop_design, start_up
from testbench.errors import ConfigError
from testbench.paper.loop import advisor, limit_cycles
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run import build, design_check
from testbench.run.budget import budget, lock_frequency_hz, ring_warnings

QUADRATURE_BY_BANDWIDTH = (0.04, 0.08, 0.16)
STEPS_PER_UM, AMPLITUDES_UM = 100, (0.01, 100.0)
FIRST_AMPLITUDES_UM = (5.0, 1.0, 0.2, 0.04, 25.0)
BANDWIDTH_ROOM, PEAK_ROOM_DB, MODULUS_ROOM = 0.03, 0.1, 0.95  # rounded coefficients and the grid of the search
WIDER = (1.02, 1.2, 1.5, 2.0)  # times the split that would be in proportion to the bandwidth


class Result(NamedTuple):
    """A finished design: the configuration and everything that is predicted of it."""

    config: object
    choice: rate_loop_design.Choice
    advice: advisor.Advice
    rounding_effects: limit_cycles.RoundingEffects
    nominal: start_up.StartUp
    slowest: start_up.StartUp
    promised_s: float
    ranges: list
    plan: list
    budget: object
    amplitude_bound: str
    limits: rate_loop_design.Limits
    simulated: object = None  # `confirm_design.Measured`, if the engine was asked

    @property
    def warnings(self):
        """What to mind, one line each."""
        warning_lines = [
            f"{m.what}: {m.distance_hz:.4g} Hz is below {m.least_hz:.4g} Hz: {m.effect}{m.remedy and '; '}{m.remedy}"
            for m in self.plan
            if not m.is_satisfied
        ]
        warning_lines += [w for w in self.advice.warnings if not w.startswith("bandwidth ")]
        warning_lines += ring_warnings(self.config)
        warning_lines += [line for _, line in build.dac_notes(self.config)]
        return (*warning_lines, *build.no_rate_output(self.config))


class _Draft:
    """A configuration in the making; keys of [firmware] that the user has fixed stay."""

    def __init__(self, source, file):
        self.source, self.target = source, file.target
        self.fixed = set(file.firmware.model_fields_set)
        nominal = file.nominal.model_dump()
        firmware = {k: getattr(file.firmware, k) for k in self.fixed}
        tree = {"design": file.design.model_dump(), "nominal": nominal, "firmware": firmware}
        self.config = config_of(tree, source)
        design_check.check(self.config)
        self._set_initial_gains(file.target.bandwidth_hz)

    def _set_initial_gains(self, bandwidth_hz):
        """Gains and an amplitude that the firmware's formats hold, to begin with."""
        self.set(ftr_crossover_hz=0.6 * bandwidth_hz, ftr_zero_hz=10 * bandwidth_hz)
        for trial_amplitude_um in FIRST_AMPLITUDES_UM:
            self.set(amplitude_um=trial_amplitude_um)
            try:
                return self.set_quadrature(QUADRATURE_BY_BANDWIDTH[0] * bandwidth_hz)
            except ConfigError as problem:
                last_error = problem
        raise last_error

    def set(self, **keys):
        """Change keys of [firmware] that are not fixed; keys of both boards are written `nominal__key`."""
        values = {}
        for key, value in keys.items():
            if key.startswith("nominal__"):
                values["nominal." + key.removeprefix("nominal__")] = value
            elif key not in self.fixed:
                values[f"firmware.{key}"] = _clamp_to_limits(type(self.config.firmware), key, float(f"{value:.6g}"))
        self.config = changed(self.config, values)

    def set_quadrature(self, crossover_hz):
        """Set the quadrature loop's crossover, at most what the format of its gain holds."""
        for halvings in range(12):
            self.set(qsc_crossover_hz=crossover_hz / 2**halvings)
            try:
                return build.firmware(self.config)
            except ValueError as problem:
                if "fit format" not in str(problem):
                    raise
                format_error = problem
        return self.refuse(f"the gains of this board do not fit the formats of the firmware: {format_error}")

    def refuse(self, text):
        """ConfigError with the file's name in front."""
        raise ConfigError(f"{self.source}: {text}")


def _clamp_to_limits(section, key, value):
    """The value, within the limits of its key."""
    low, high = (
        next(getattr(m, end) for m in section.model_fields[key].metadata if hasattr(m, end)) for end in ("ge", "le")
    )
    return min(max(value, low), high)


def _tolerances(nominal):
    return rate_loop_design.Tolerances(
        nominal.f_tolerance, nominal.q_tolerance, nominal.transducer_tolerance, nominal.capacitor_tolerance,
        nominal.split_tolerance,
    )  # fmt: skip


def _amplitude(draft):
    """Choose the amplitude; returns what bounds it."""
    target, config = draft.target, draft.config
    if "amplitude_um" in draft.fixed:
        return "[firmware]"
    now = config.firmware.amplitude_um
    most, bound = range_check.most_amplitude_um(range_check.ranges(config, target), now)
    amplitude_um = target.amplitude_um
    scale = target.scale_lsb_per_deg_s or (target.full_scale_deg_s and 2**23 / target.full_scale_deg_s)
    if scale:
        amplitude_um = scale / abs(advisor.dc_gain(lp.close(loop_parameters(config))) * lp.DEG) * now
    if amplitude_um is None:
        amplitude_um, reason = math.floor(most * STEPS_PER_UM) / STEPS_PER_UM, bound
    else:
        reason = "[target]"
    if not AMPLITUDES_UM[0] <= amplitude_um <= AMPLITUDES_UM[1]:
        low, high = AMPLITUDES_UM
        draft.refuse(f"amplitude: {amplitude_um:.4g} um, bounded by {reason}, is outside {low:g} .. {high:g} um")
    draft.set(amplitude_um=amplitude_um)
    draft.set_quadrature(config.firmware.qsc_crossover_hz)  # its gain goes with 1 / amplitude
    return reason


def _compensate(draft):
    """Phase words from the budget: force in phase with sin(theta), references behind x and y."""
    plain = changed(draft.config, {f"firmware.{k}": 0.0 for k in WORDS})
    phases = budget(plain, frequency_hz=_lock_hz(plain))
    node, loop = phases.node_deg(), phases.loop_deg()
    words = (node["xe1"], node["ye1"], -loop["xe2"], -loop["ye2"])
    draft.set(**dict(zip(WORDS, words)))


def _lock_hz(config):
    """Drive frequency at which the frequency loop comes to rest (Hz)."""
    first, d = budget(config), config.device()
    return lock_frequency_hz(d.fx_hz, d.qx, first.node_deg()["xe1"], first.loop_deg()["xe2"])


WORDS = ("phase_drive_sine_deg", "phase_sense_sine_deg", "phase_drive_ref_deg", "phase_sense_ref_deg")


def _check_ranges(draft):
    for r in range_check.ranges(draft.config, draft.target):
        if not r.is_satisfied:
            draft.refuse(f"{r.what}: {r.value:.4g} {r.unit} is above the limit {r.limit:.4g} {r.unit}; {r.remedy}")


def _limits(target):
    return rate_loop_design.Limits(target.peak_db, target.modulus_margin)


def _rate_loop(draft):
    """Choose SID capacitor, crossover and zero of the rate loop, and the drive loops with them.

    Where a slow SID stops the drive's start-up, a faster one with less margin is tried.
    """
    target, config = draft.target, draft.config
    tolerances = _tolerances(config.nominal)
    limits = _limits(target)
    if target.keep_sid:
        bands = [rate_loop_design.build_board(config, config.nominal.sid_c_f, tolerances, target.bandwidth_hz)]
    else:
        bands = rate_loop_design.boards(config, tolerances, target.bandwidth_hz)
    failure = ""
    for nearly in rate_loop_design.NEARLY:
        choice = rate_loop_design.choose(config, bands, target.bandwidth_hz, limits, nearly)
        if choice is None:
            draft.refuse(_why(draft, bands, tolerances, limits))
        draft.set(ftr_crossover_hz=choice.crossover_hz, ftr_zero_hz=choice.zero_hz, nominal__sid_c_f=choice.sid_c_f)
        failure = _drive_loops(draft)
        if not failure:
            return choice
    return draft.refuse(failure)


def _why(draft, bands, tolerances, limits):
    """Line for a bandwidth that no rate loop reaches: what is possible, and which constraint stops it."""
    target, config = draft.target, draft.config
    split = abs(config.nominal.fx_hz - config.nominal.fy_hz)
    hz = target.bandwidth_hz
    most = rate_loop_design.most(bands, limits)
    if target.keep_sid:
        return (
            f"target.bandwidth_hz = {hz:g} Hz is not possible with nominal.sid_c_f = {config.nominal.sid_c_f:g} F, "
            f"which allows at most {most:.3g} Hz; keep_sid = false lets the design choose it"
        )
    if not most:
        return (
            f"rate loop: no bandwidth keeps target.modulus_margin = {limits.modulus:g} and target.peak_db = "
            f"{limits.peak_db:g} dB within the tolerances of [nominal], with a split of {split:.4g} Hz; lower "
            "the tolerances or the modulus_margin"
        )
    if hz <= most:
        return (
            f"target.bandwidth_hz = {hz:g} Hz does not allow a modulus margin of {limits.modulus:g}, although "
            f"{most:.3g} Hz does; choose another bandwidth or a lower modulus_margin"
        )
    text = f"target.bandwidth_hz = {hz:g} Hz is above {most:.3g} Hz, the most that a rate loop of this board allows"
    for by in WIDER:
        by *= hz / most
        other = changed(
            config, {"nominal.fy_hz": config.nominal.fx_hz - by * (config.nominal.fx_hz - config.nominal.fy_hz)}
        )
        if rate_loop_design.choose(other, rate_loop_design.boards(other, tolerances, hz), hz, limits):
            need = f"{by * split:.3g} Hz would be enough"
            return f"{text}: the split fx_hz - fy_hz of {split:.4g} Hz of [nominal] is the constraint; {need}"
    return f"{text}: the delay of the converter's frames is the constraint"


def _drive_loops(draft):
    """Set drive loops and words of the start-up; returns what stops them, or ""."""
    loop_words = drive_loops.words(draft.config)
    if not loop_words.failure:
        draft.set(**loop_words.keys)
    return loop_words.failure


def _start_up(draft):
    """Choose the quadrature loop's crossover; returns (nominal, slowest, promised) of the start-up."""
    target = draft.target
    drives = [start_up.predict_drive_start(c) for c in (draft.config, *start_up.corners(draft.config))]
    for ratio in QUADRATURE_BY_BANDWIDTH:
        draft.set_quadrature(ratio * target.bandwidth_hz)
        boards = (draft.config, *start_up.corners(draft.config))
        predicted_start_ups = [start_up.add_sense_lock(*pair) for pair in zip(drives, boards)]
        slowest = start_up.slowest(predicted_start_ups)
        promised = start_up.promised_s(slowest)
        if promised is not None and promised <= target.startup_s:
            return predicted_start_ups[0], slowest, promised
    if promised is None:
        draft.refuse(f"start-up of a board within the tolerances: {slowest.failure}")
    draft.refuse(
        f"target.startup_s = {target.startup_s:g} s is below {promised:.3g} s, which the slowest board within the "
        f"tolerances needs: {slowest.reached_s:.3g} s to firmware.acquire_share of the amplitude, "
        f"{slowest.drive_s:.3g} s to the drive's lock"
    )


def _check_loop(draft, advice):
    """Refuse what the finished loop does not keep: a key that the user has fixed stands in the way."""
    target = draft.target
    fixed = ", ".join(sorted(draft.fixed)) or "none"
    if not advice.stable:
        draft.refuse(f"rate loop: {advice.warnings[0]}; fixed keys of [firmware]: {fixed}")
    off = abs(advice.bandwidth_hz / target.bandwidth_hz - 1)
    for what, value, limit, unit in (
        ("relative deviation from target.bandwidth_hz", off, BANDWIDTH_ROOM, ""),
        ("closed-loop peak", advice.peak_db, target.peak_db + PEAK_ROOM_DB, " dB"),
        ("1 - modulus margin", 1 - advice.modulus_margin, 1 - MODULUS_ROOM * target.modulus_margin, ""),
    ):
        if value > limit:
            draft.refuse(
                f"rate loop: {what}: {value:.3g}{unit} is above the limit {limit:.3g}{unit}; "
                f"fixed keys of [firmware]: {fixed}"
            )


def _check_run(config):
    temp_degc = config.scenario.temperature_degc
    build.params(config, temp_degc, temp_degc + config.plant.self_heating_k)
    build.register_writes(config)


def design(file, source="target"):
    """`Result` for a `TargetFile`. Raises ConfigError with the constraint that stops it."""
    try:
        return _compute_design(file, source)
    except ValueError as problem:  # of the designers of blocks and parts, too: name, value, limit
        text = re.sub(r"\bplant\.", "nominal.", str(problem))  # a target has no [plant]
        raise ConfigError(text if text.startswith(f"{source}: ") else f"{source}: {text}") from None


def _compute_design(file, source):
    draft = _Draft(source, file)
    target = draft.target
    if target.compensate:
        _compensate(draft)
    bound = _amplitude(draft)
    _check_ranges(draft)
    choice = _rate_loop(draft)
    nominal, slowest, promised = _start_up(draft)
    config = draft.config
    p = loop_parameters(config)
    advice = advisor.advise(p)
    _check_loop(draft, advice)
    _check_run(config)
    n = config.nominal
    return Result(
        config,
        choice,
        advice,
        limit_cycles.resolution(p),
        nominal,
        slowest,
        promised,
        range_check.ranges(config, target),
        frequency_plan.plan(
            n.device(), target.bandwidth_hz, n.f_tolerance, config.design_record(), drive_loops.frequency_loop(config)
        ),
        budget(config, frequency_hz=_lock_hz(config)),
        bound,
        _limits(target),
    )
