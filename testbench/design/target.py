"""TARGET.toml: the board that firmware is designed for, what it must reach, and what the user has fixed already.

    [target]     bandwidth, peak, start-up time, scale, largest rate and quadrature, amplitude, gap: one unit to a name
    [nominal]    the board, as in a configuration, with its tolerances
    [firmware]   keys that the design must not choose
    [design]     rates and word lengths of the firmware
Source  docs/design_of_loops.md
"""

from pydantic import Field, ValidationError, model_validator

from testbench.config import Design, Firmware, Nominal, scenario
from testbench.config.config_errors import explain
from testbench.config.section import Section, number, other
from testbench.errors import ConfigError
from testbench.storage.inputs import read_toml


def optional(unit, lo, hi, doc):
    """A key that may be absent."""
    return Field(None, ge=lo, le=hi, description=doc, json_schema_extra={"unit": unit})


class Target(Section):
    """What the design must reach. A key that is absent is chosen, or not checked where its sentence says so."""

    bandwidth_hz: float = number(25.0, "Hz", 0.05, 1000.0, "bandwidth: response 3 dB below the scale factor at rest")
    peak_db: float = number(1.5, "dB", 0.1, 6.0, "largest rise of the response within the bandwidth")
    modulus_margin: float = number(0.5, "", 0.1, 0.9, "least distance of the rate loop's open-loop gain L from -1")
    startup_s: float = number(
        3.0, "s", 0.5, 60.0, "longest time from power-on to lock, for the slowest board within the tolerances"
    )
    scale_lsb_per_deg_s: float | None = optional("LSB/(deg/s)", 1.0, 1e6, "force word per rate; decides the amplitude")
    full_scale_deg_s: float | None = optional(
        "deg/s", 1.0, 1e5, "rate of the largest force word; decides the amplitude"
    )
    max_rate_deg_s: float = number(300.0, "deg/s", 0.1, 1e5, "largest rate that the ranges must allow")
    max_quadrature_deg_s: float | None = optional("deg/s", 0.0, 1e5, "largest quadrature; if absent, that of [nominal]")
    amplitude_um: float | None = optional(
        "um", 1e-3, 100.0, "drive amplitude; if absent, the largest that the ranges allow"
    )
    gap_um: float | None = optional("um", 0.1, 1e3, "gap of the electrodes; if absent, displacement is not checked")
    gap_share: float = number(1 / 3, "", 0.01, 1.0, "largest displacement, as a part of the gap")
    compensate: bool = other(True, "compute phase words from the phase budget, so that force and rate are in phase")
    keep_sid: bool = other(False, "keep the SID capacitor of [nominal]")

    @model_validator(mode="after")
    def _check_scale_keys(self):
        keys = [k for k in ("scale_lsb_per_deg_s", "full_scale_deg_s", "amplitude_um") if getattr(self, k) is not None]
        if len(keys) > 1:
            raise scenario.Problem("", f"{keys[0]} and {keys[1]} both decide the amplitude; write only one of them")
        return self


class TargetFile(Section):
    """A whole TARGET.toml."""

    target: Target = Target()
    nominal: Nominal = Nominal()
    firmware: Firmware = Firmware()
    design: Design = Design()


SECTIONS = {name: info.annotation for name, info in TargetFile.model_fields.items()}


def from_dict(tree, source="target"):
    """Checked `TargetFile` from nested dicts. Raises ConfigError with one line."""
    try:
        return TargetFile.model_validate(tree)
    except ValidationError as problem:
        errors = problem.errors(include_url=False)
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        hint = "; describe the board in [nominal]" if errors[0]["loc"] == ("plant",) else ""
        raise ConfigError(explain(errors[0], SECTIONS, source, {}) + hint + more) from None


def load(path):
    """Checked `TargetFile` of a TOML file. Raises ConfigError with one line."""
    return from_dict(read_toml(path), str(path))
