"""What a measurement record holds: streams, tables, attributes; the one source for writer, validator and page.

    streams   raw codes and words at exact rates of the 26 MHz clock; row n is the value before edge edge0 + n den / num
    tables    register log, segments, gaps, stimuli, counters, priors
    findings  `Rnn path expected ..., found ...`, each a refusal, a warning, a downgrade, or a block

Edges count from the record's first power-on; a frame is 3250 of them, a tick 26.
Source    docs/measured.md
"""

import hashlib
import json
from typing import NamedTuple

import numpy as np

from fpga_model import block, registers, top
from fpga_model.rates import FRAME_CYCLES, TICK_CYCLES
from testbench.measured.record.replay import WINDOW_WORDS, WORDS

SCHEMA = "gyrorec/1.0"
REFUSED, WARNED, DOWNGRADED, BLOCKED = "refused", "warned", "downgraded", "blocked"


class Stream(NamedTuple):
    """A stream of the schema: format of its codes, and what it is."""

    required: bool
    bits: int
    signed: bool
    unit: str
    tap: str
    doc: str


ADC = {
    "adc_xI": "drive demodulated by sgn(sin)",
    "adc_xQ": "drive demodulated by sgn(cos)",
    "adc_yI": "sense demodulated by sgn(sin): rate",
    "adc_yQ": "sense demodulated by sgn(cos): quadrature",
}
DAC = ("dac_drv", "dac_ftr", "dac_qsc")
TICKED = ("dac_drv", "dac_ftr")  # may have a row for each tick: the code at its end
STREAMS = {
    **{name: Stream(True, 24, True, "code", "adc", doc) for name, doc in ADC.items()},
    "adc_ok": Stream(False, 1, False, "1", "internal", "1 where the frame's status word was good"),
    "adc_temperature": Stream(False, 24, True, "code", "adc", "channel of the temperature sensor"),
    "dac_drv": Stream(False, 16, True, "code", "dac", "code at the drive DAC's output"),
    "dac_ftr": Stream(False, 20, True, "code", "dac", "code at the sense DAC's output"),
    "dac_qsc": Stream(False, 16, False, "code", "dac", "code at the quadrature DAC's output"),
    "nco_fword": Stream(False, 48, False, "word", "internal", "frequency word, turns per clock / 2^48"),
    "nco_pword": Stream(False, 48, False, "word", "internal", "phase accumulator, turns / 2^48"),
    "amplitude_word": Stream(False, 24, True, "word", "internal", "amplitude of the drive, 10 V / 2^23"),
    "rate_word": Stream(False, 24, True, "word", "internal", "force-to-rebalance word, 10 V / 2^23"),
    "quadrature_code": Stream(False, 16, False, "code", "internal", "V_q of the loop, 5.5 V / 2^16"),
    "magnitude": Stream(False, 25, False, "code", "internal", "CORDIC magnitude of the drive"),
    "phase": Stream(False, 24, True, "word", "internal", "CORDIC phase of the drive, turns / 2^24"),
    "state": Stream(False, 4, False, "1", "internal", "state of the sequencer"),
    "lock": Stream(False, 4, False, "1", "internal", "locks of the loops"),
    "flags": Stream(False, 16, False, "1", "internal", "live faults"),
    "rate_output": Stream(False, 32, True, "word", "internal", "compensated rate, deg/s / 2^20"),
    "agc_acc": Stream(False, 60, True, "word", "internal", "integrator of the amplitude loop"),
    "pll_acc": Stream(False, 60, True, "word", "internal", "integrator of the frequency loop"),
    "ftr_acc": Stream(False, 60, True, "word", "internal", "integrator of the rate loop"),
    "qsc_acc": Stream(False, 60, True, "word", "internal", "integrator of the quadrature loop"),
}
# Streams that the firmware's registers decide, and which column of a replay says so
REPLAYED = {
    name: {"nco_fword": "frequency_word", "nco_pword": "nco_phase"}.get(name, name)
    for name in STREAMS
    if not name.startswith("adc_")
}
assert set(REPLAYED.values()) == set(WORDS), "every word of a replay is a stream"
# Columns of an engine behind the streams
CODE_OF = {"adc_xI": "adc_drive_sin", "adc_xQ": "adc_drive_cos", "adc_yI": "adc_sense_sin", "adc_yQ": "adc_sense_cos"}
CODE_OF["adc_temperature"] = "adc_temperature"
WORD_OF = {
    "dac_drv": "drive_dac_code",
    "dac_ftr": "sense_dac_code",
    "dac_qsc": "quadrature_dac_code",
    "nco_fword": "frequency_word",
    **{name: name for name in WINDOW_WORDS},
}
ADDED_PARAMETERS = ("sid.still",)  # that the firmware of version 0.1.0 did not have
PER_FRAME, PER_TICK = (1, FRAME_CYCLES), (1, TICK_CYCLES)

ROOT_KEYS = (
    "lab",
    "device_serial",
    "board_rev",
    "licence",
    "bitstream_sha256",
    "firmware_version",
    "regmap_sha256",
    "roles_sha256",
    "nuisances",
)
# Columns of each table with their units: "" of a text, "1" of a number whose unit is free
TABLES = {
    "power_on": {"edge": "edge"},
    "registers": {
        "edge": "edge",
        "name": "",
        "addr": "1",
        "width": "1",
        "frac_bits": "1",
        "signed": "1",
        "raw": "word",
    },
    "segments": {
        "id": "",
        "edge_a": "edge",
        "edge_b": "edge",
        "kind": "",
        "loops": "",
        "a_set": "um",
        "detune": "deg",
        "temp_set": "degC",
        "rate_set": "deg/s",
        "repeat_group": "",
        "role": "",
    },
    "gaps": {"edge_a": "edge", "edge_b": "edge", "streams": "", "reason": ""},
    "stimulus/rate": {"edge": "edge", "rate": "deg/s", "unc": "ppm"},
    "stimulus/temperature": {"edge": "edge", "temperature": "degC", "where": "", "unc": "K"},
    "priors": {"param": "", "dist": "", "mean": "1", "sd": "1", "unit": "", "source": "", "correlation_group": ""},
}
OPTIONAL_TABLES = {"initial": {"name": "", "raw": "word"}}
COUNTER_PAIRS = {
    "Vxm_vs_sgnsin": "deg",
    "Vxm_vs_sgncos": "deg",
    "Vym_vs_sgnsin": "deg",
    "y_vs_sgnsin": "deg",
    "f_drive": "Hz",
}
KINDS = ("warmup", "settle", "dwell", "rate_step", "sweep", "ringdown", "startup", "multisine", "detune")
ROLES = ("fit", "validate", "none")
DISTRIBUTIONS = ("normal", "lognormal", "uniform")
GAP_STREAMS = ("adc", "all")
GAIN_UNC = 1e-3  # relative, of the volts per code that a laboratory states
MOST_SATURATED = 1e-3  # part of the rows of a fit segment
UNCERTAIN = {"stimulus/rate": "unc", "stimulus/temperature": "unc"}  # columns that state an uncertainty


def column_units(name):
    """{column: unit} of a table; a counter of an unknown pair has units None, an unknown table no columns."""
    if name.startswith("counter/"):
        unit = COUNTER_PAIRS.get(name.partition("/")[2])
        return {"edge": "edge", "value": unit, "gate": "s", "unc": unit}
    return TABLES.get(name) or OPTIONAL_TABLES.get(name, {})


def frame_count(record):
    """Frames of a record: rows of its converter."""
    return len(record.streams["adc_xI"].data)


def rows(table, *keys):
    """Values of some columns of a table, row by row."""
    return zip(*(table[key].data.tolist() for key in keys))


class Finding(NamedTuple):
    """Something wrong with a record, or something that it cannot be used for."""

    rule: str
    path: str
    text: str
    level: str = REFUSED

    def __str__(self):
        return f"{self.rule} {self.path} {self.text}"


def json_sha256(data):
    """SHA-256 of a structure as JSON."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def regmap_sha256(version=registers.VERSION):
    """Hash of a version's register map: names, addresses, formats, reset values, access."""
    resets = {r.name: r.reset for r in registers.MAP} | {"identity": registers.identity(version)}
    return json_sha256([[r.address, r.name, list(r.fmt), resets[r.name], r.access] for r in registers.MAP])


def lsb_volts(device):
    """{stream: V} of a code, of the converters of a `Device`."""
    d = device
    adc = {"x": d.adc_vref_v / d.adc_pga_drive / 2**23, "y": d.adc_vref_v / d.adc_pga_sense / 2**23}
    return {
        **{name: adc[name[4]] for name in ADC},
        "adc_temperature": adc["x"],
        "dac_drv": d.drive_dac_span_v / 2**15,
        "dac_ftr": d.sense_dac_span_v / 2**19,
        "dac_qsc": d.quad_dac_span_v / 2**16,
        "quadrature_code": d.quad_dac_span_v / 2**16,
    }


def stream_dtype(name):
    """NumPy type of a stream's codes."""
    stream = STREAMS[name]
    return np.int32 if stream.bits < 32 or (stream.signed and stream.bits == 32) else np.int64


def attributes(name, tap, lsb_v=None, unc_v=None):
    """Attributes of a stream; without an uncertainty of its volts per code that of a usual laboratory."""
    stream = STREAMS[name]
    out = {"bits": stream.bits, "twos_comp": int(stream.signed), "tap": tap}
    if lsb_v is None:
        return out
    return out | {"lsb_V": lsb_v, "lsb_V_unc": unc_v or GAIN_UNC * lsb_v, "offset_code": 0}


def has_supported_map(record):
    """True if the register map of a record is one of ours: only then are its registers known by their names."""
    return record.attrs["regmap_sha256"] in [regmap_sha256(version) for version in registers.REPLAYED]


def bitstream_sha256(firmware, excluded_parameters=()):
    """Hash of the firmware's parameters, without `excluded_parameters` and later ones that have their default.

    It stands for the bitstream of a simulated board.
    """
    firmware_parameters = block.flattened_parameters(firmware, top.PARAMS_FMT)
    return json_sha256([[name, value] for name, value, _ in firmware_parameters if name not in excluded_parameters])


def roles_sha256(segments):
    """Hash of who is fitted and who is held out: fixed before any analysis."""
    return json_sha256([list(row) for row in rows(segments, "id", "edge_a", "edge_b", "repeat_group", "role")])
