"""What the columns of a laboratory's files are: a TOML file, checked; one line for what is wrong.

    name, lab, device_serial, board_rev, licence, bitstream_sha256, firmware_version, regmap_sha256     head
    [time]      column, unit, power_on      [columns.STREAM]  column, unit, lsb_V, lsb_V_unc
    [set]       configuration of the model over the defaults, as --set
    [profile]   rate_dps, temperature_degc: a number, or [[seconds from power-on, value], ..], each held until the next
    [[write]]   at_s, and one of: name with raw, a_um, detune_deg       written behind those of the configuration
    [[power_on]]  of the file of this number: profile and writes where they differ from those of other files; held_out
    [[segment]] id, from_s, to_s, kind, role, group: instead of those that are found
    [dwells]    settle_s, longest_s, held_out (numbers of dwells that no fit sees)
    [[prior]]   as in a plan
Errors    ConfigError
Source    docs/import.md
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from testbench.errors import ConfigError
from testbench.measured.record import schema
from testbench.storage import inputs

TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
PREFIX_V = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
INTEGERS = ("code", "word", "1")
HEAD = ("lab", "device_serial", "board_rev", "licence", "bitstream_sha256", "firmware_version", "regmap_sha256")
Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=36_000)]
Profile = Finite | Annotated[list[tuple[Seconds, Finite]], Field(min_length=1, max_length=100_000)]


class Part(BaseModel):
    """A table of the file: no other keys than these."""

    model_config = ConfigDict(extra="forbid")


class Time(Part):
    """Column of time stamps; power_on is the stamp at power-on, if it is known."""

    column: str
    unit: Literal["s", "ms", "us", "ns"] = "s"
    power_on: Finite | None = None


class Stream(Part):
    """Column of a stream: integers of the schema, or V (with V per code) or Hz."""

    column: str
    unit: Literal["code", "word", "1", "V", "mV", "uV", "Hz", "kHz"] = "code"
    lsb_V: Annotated[float, Field(gt=0, lt=1)] | None = None
    lsb_V_unc: Annotated[float, Field(gt=0, lt=1)] | None = None


class Profiles(Part):
    """Rate and temperature over the time from power-on, and how well they are known."""

    rate_dps: Profile = 0.0
    temperature_degc: Profile = 25.0
    rate_shape: Literal["steps", "linear"] = "steps"
    temperature_shape: Literal["steps", "linear"] = "steps"
    rate_unc_ppm: Annotated[float, Field(gt=0)] = 50.0
    temperature_unc_k: Annotated[float, Field(gt=0)] = 0.1


class Write(Part):
    """A write of the host: a register of the map by its raw value, or a set-point in its unit."""

    at_s: Seconds
    name: str = ""
    raw: Annotated[int, Field(ge=-(1 << 47), lt=1 << 48)] | None = None
    a_um: Annotated[float, Field(gt=0, le=10)] | None = None
    detune_deg: Annotated[float, Field(ge=-60, le=60)] | None = None


class PowerOn(Part):
    """What is different in one file; held_out: no fit sees it."""

    held_out: bool = False
    profile: Profiles | None = None
    write: list[Write] | None = None


class Segment(Part):
    """A stretch of every file, in seconds from its power-on."""

    id: str
    from_s: Seconds
    to_s: Seconds
    kind: Literal[schema.KINDS] = "dwell"
    role: Literal[schema.ROLES] = "fit"
    group: str = ""


class Dwells(Part):
    """How dwells are found where no segment is stated."""

    settle_s: Annotated[float, Field(ge=0.1, le=3600)] = 3.0
    longest_s: Annotated[float, Field(ge=0.1, le=3600)] = 4.0
    held_out: list[Annotated[int, Field(ge=1)]] = []


class Prior(Part):
    """What is known of a parameter beforehand."""

    param: str
    mean: Finite
    sd: Annotated[float, Field(gt=0)]
    unit: str = "1"
    dist: Literal[schema.DISTRIBUTIONS] = "normal"
    source: str = "datasheet"
    correlation_group: str = ""


class Map(Part):
    """The whole file."""

    name: str = "imported"
    lab: str = "unknown"
    device_serial: str = "unknown"
    board_rev: str = "unknown"
    licence: str = "unknown"
    bitstream_sha256: str = "0" * 64
    firmware_version: str = "unknown"
    regmap_sha256: str = ""
    time: Time | None = None
    columns: dict[str, Stream]
    set: dict[str, dict | float | int | bool | str] = {}
    profile: Profiles = Profiles()
    write: list[Write] = []
    power_on: list[PowerOn] = []
    segment: list[Segment] = []
    dwells: Dwells = Dwells()
    prior: list[Prior] = []

    def file_settings(self, k):
        """(Profiles, [Write], held out) of file k."""
        entry = self.power_on[k] if k < len(self.power_on) else PowerOn()
        return entry.profile or self.profile, self.write if entry.write is None else entry.write, entry.held_out

    def settings(self):
        """{section.key: value} of [set]."""
        out = {}
        for key, value in self.set.items():
            out |= {f"{key}.{name}": item for name, item in value.items()} if isinstance(value, dict) else {key: value}
        return out


def read(path):
    """`Map` of a TOML file."""
    data = inputs.read_toml(path)
    if "kind" in data:
        raise ConfigError(f"{path}: is a column map of a part; run gyro measured trace {path} (docs/quality.md)")
    lab_map = inputs.validate_data(data, Map, path, ConfigError)
    for name, stream in lab_map.columns.items():
        if name not in schema.STREAMS:
            raise ConfigError(f"{path}: columns.{name}: is not a stream; known: {', '.join(schema.STREAMS)}")
        volts = stream.unit in PREFIX_V
        if stream.unit not in (*INTEGERS, *PREFIX_V) and name != "nco_fword":
            raise ConfigError(f"{path}: columns.{name}: unit {stream.unit!r} is valid only for nco_fword")
        if volts and schema.STREAMS[name].unit not in ("code", "word"):
            raise ConfigError(
                f"{path}: columns.{name}: a stream in unit {schema.STREAMS[name].unit!r} cannot be given in volts"
            )
    missing = [name for name in schema.ADC if name not in lab_map.columns]
    if missing:
        raise ConfigError(f"{path}: columns.{missing[0]} is missing; the four channels of the converter are required")
    for k, one in enumerate([*lab_map.write, *(w for p in lab_map.power_on for w in p.write or ())]):
        set_keys = [key for key in ("name", "a_um", "detune_deg") if getattr(one, key) not in ("", None)]
        if len(set_keys) != 1 or (one.name != "") != (one.raw is not None):
            raise ConfigError(f"{path}: write[{k}]: expected name with raw, or a_um, or detune_deg, found {set_keys}")
    for one in lab_map.segment:
        if not one.from_s < one.to_s:
            raise ConfigError(
                f"{path}: segment {one.id}: from_s = {one.from_s:g} s is not before to_s = {one.to_s:g} s"
            )
    return lab_map
