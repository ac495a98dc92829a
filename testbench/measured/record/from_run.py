"""`gyro run --gyrorec FILE`: the run's gyroscope as a measurement record, one condition and one power-on.

Rate and temperature must be constant: a record of several conditions and repeats is made from a plan.
Source    docs/measured.md
"""

from testbench.config import changed
from testbench.errors import ConfigError
from testbench.measured.record import produce
from testbench.measured.record.recording_plan import Condition, Plan
from testbench.storage.record import write_record

HEAD = ("lab", "device_serial", "board_rev", "licence")


def plan_from_config(config):
    """`Plan` of one condition; ConfigError names the key that a record of this kind cannot hold."""
    s = config.scenario
    for key, value in (("rate_dps", s.rate_dps), ("temperature_degc", s.temperature_degc)):
        if not isinstance(value, (int, float)):
            raise ConfigError(
                f"--gyrorec: scenario.{key} is a profile, expected a number; write a recording plan instead"
            )
    for key in ("faults", "register_writes", "resume"):
        if getattr(s, key):
            raise ConfigError(f"--gyrorec: scenario.{key} is set; a record of one run allows none, remove the key")
    if s.origin != "lock":
        raise ConfigError(f'--gyrorec: scenario.origin = "{s.origin}", expected "lock"')
    c = Condition(
        "run", config.firmware.amplitude_um, float(s.rate_dps), None, float(s.temperature_degc), settle_s=0.0,
        seconds=s.seconds, role="none",
    )  # fmt: skip
    head = dict.fromkeys(HEAD, "unknown")
    model = changed(config, {"scenario.plant": "", "scenario.plant_file": ""})
    return Plan("run", head, 1, config.noise.seed, "frame", 0.0, model, config, {}, (c,), ())


def write(config, path, progress=None):
    """Make the record and write it; returns its content hash."""
    return write_record(path, produce.record(plan_from_config(config), progress))
