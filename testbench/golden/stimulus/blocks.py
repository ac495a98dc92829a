"""Every block of the firmware as a golden reference: ports with formats, parameter cases, latencies, rules.

A runner takes stimulus rows (column 0 is `rst`, then the inputs of `step` in order) and writes, for each row, all
registers before that edge and the output pins that the row's inputs give. Registers and pins are flattened depth first,
dots and numbers joined by `_`: exactly the ports of the RTL after the prefixes `r_` and `o_`.
Source  docs/conventions.md, docs/blocks/
"""

import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fpga_model import (
    agc,
    cordic,
    dds,
    delay,
    digital_sid,
    fault_monitor,
    frequency_tracker,
    isqrt,
    lock_monitor,
    modulator,
    pi,
    quadrature_loop,
    rate_loop,
    rate_output,
    rates,
    references,
    registers,
    sequencer,
    sine,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits
from testbench.flatten import format_leaves, leaves
from testbench.golden.stimulus import runners

BIT = bits(1)
ALL_ONES = 1023  # top of the counters of frames in the quick cases: every bit below it decides
RESET_INPUT = "rst"


class Port(NamedTuple):
    """One flattened port: bare name (without `r_` and `o_`), format, reset value, and its rules where it has any."""

    name: str
    fmt: Fmt
    reset: int | None = None
    rounding: str | None = None
    overflow: str | None = None

    @property
    def width(self):
        return self.fmt.width

    @property
    def signed(self):
        return bool(self.fmt.s)


class Rom(NamedTuple):
    """A table that the RTL loads: words of `width` bits."""

    name: str
    width: int
    words: tuple


class Block(NamedTuple):
    """What the exporter has to know of a block.

    inputs      ports of `step`, in order, without `rst`
    cases       {name: Params or None}
    run         kernel(params, reset state, stimulus, registers, pins)
    latency     {port: clocks}
    strobes     1-bit inputs that start an operation
    wait        clocks that an operation takes before the next one is usual; 0 for a pipeline
    dense       whether an operation may start before `wait` has passed
    idle        {input: value} of the quiet state, 0 if not named
    """

    stem: str
    inputs: tuple
    state: tuple
    registers: tuple
    pins: tuple
    cases: dict
    run: object
    latency: dict
    strobes: tuple = ()
    wait: int = 0
    dense: bool = True
    idle: Mapping = MappingProxyType({})
    roms: tuple = ()
    runtime_params: bool = False

    @property
    def module(self):
        return f"gyro_{self.stem}"

    @property
    def columns(self):
        """All columns of the stimulus, `rst` first."""
        return (Port(RESET_INPUT, BIT, 0), *self.inputs)

    @property
    def rules(self):
        """The block's own words on rounding and overflow."""
        text = importlib.import_module(f"fpga_model.{self.stem}").__doc__.splitlines()
        found = {}
        for key in ("Rounding", "Overflow"):
            found[key.lower()] = next(line[len(key) :].strip() for line in text if line.startswith(key))
        return found


def flat(name):
    """Name of a port from a dotted register name."""
    return name.replace(".", "_")


# ---- the registry ------------------------------------------------------------------------------------------------

PI_RULES = {"acc": (None, "saturate"), "y": ("half_up", "saturate")}
LOOP_RULES = {f"loop_{name}": rule for name, rule in PI_RULES.items()}
PI_MODE = bits(2)
FAULT_RULES = dict.fromkeys(("over_range", "stuck", "drive", "rate", "rail"), (None, "saturate")) | {
    "bad_frames": (None, "saturate"),
    "good_frames": (None, "saturate"),
}


def _block(module, inputs, run, latency, cases=None, pins=(), rules=None, **more):
    """A block from its module; `rules` are {register or its tuple: (rounding, overflow)}."""
    rules = rules or {}
    kept = []
    for (path, reset), (_, fmt) in zip(leaves(module.State()), format_leaves(module.STATE_FMT), strict=True):
        name = flat(path)
        rounding, overflow = rules.get(name) or rules.get(name.rstrip("0123456789").rstrip("_")) or (None, None)
        kept.append(Port(name, fmt, int(reset), rounding, overflow))
    return Block(
        stem=module.__name__.rpartition(".")[2],
        inputs=tuple(Port(name, fmt) for name, fmt in inputs),
        state=module.State(),
        registers=tuple(kept),
        pins=tuple(Port(name, fmt) for name, fmt in pins),
        cases=cases or {"default": None},
        run=run,
        latency=latency,
        **more,
    )


def _quick_sequencer():
    """The sequencer with times of a few frames, so that vectors walk through all of its states."""
    seconds = {k: n / 8000 for k, n in zip(("power_up_s", "init_s", "kick_s", "decay_s"), (4, 3, 3, 4))}
    lock = lock_monitor.design(
        **{f"{k}_{way}_s": 3 / 8000 for k in ("agc", "pll", "ftr", "qsc") for way in ("in", "out")}
    )
    faults = fault_monitor.design(
        over_range_s=2 / 8000, stuck_s=4 / 8000, drive_s=3 / 8000, rate_s=3 / 8000, rail_s=5 / 8000, top=ALL_ONES
    )
    return sequencer.design(
        **seconds,
        search_s=24 / 8000,
        retune_s=3 / 8000,
        timeout_s=12 / 8000,
        offline_s=6 / 8000,
        recover_s=3 / 8000,
        search_limit_hz=800.0,
        lock=lock,
        faults=faults,
    )


CODE24 = rate_loop.CODE
LISTED = (
    _block(
        dds,
        [("word", dds.PHASE)]
        + [(f"off_{k}", dds.PHASE) for k in ("drive_sine", "sense_sine", "drive_ref", "sense_ref")],
        runners.run_dds,
        dict.fromkeys(dds.State._fields, 1),
        rules=dict.fromkeys(dds.State._fields, (None, "wrap")),
    ),
    _block(
        sine,
        [("phase", sine.PHASE)],
        runners.run_sine,
        {"y": sine.LATENCY},
        rules={"y": ("half_away", None), "fraction": ("floor", None)},
        roms=(Rom("sine", sine.BASE.width + sine.SLOPE.width, tuple(int(x) for x in sine.ROM)),),
    ),
    _block(
        delay,
        [("x", delay.X)],
        runners.run_delay,
        {"out": "depth"},
        {f"depth{k}": delay.design(k) for k in (0, 1, 3, 8)},
        [("out", delay.X)],
    ),
    _block(
        references,
        [("drive_ref", references.PHASE), ("sense_ref", references.PHASE), ("ce_1m", BIT)],
        runners.run_references,
        {"signs": 1, "pins": "1 + align, and 1 .. 26 more when retimed"},
        {
            f"align{k}_{'retimed' if retimed else 'direct'}": references.design(k, retimed)
            for k, retimed in ((0, True), (0, False), (1, False), (2, True), (3, False))
        },
        [("pins", bits(4))],
        strobes=("ce_1m",),
    ),
    _block(
        modulator,
        [("en_product", BIT), ("en_code", BIT), ("amplitude", modulator.AMPLITUDE), ("sine", modulator.SINE)],
        runners.run_modulator,
        {"product": 1, "code": modulator.LATENCY},
        {
            "dac16": modulator.design(16),
            "dac20": modulator.design(20),
            "dac16_frames1": modulator.design(16, 1),
            "dac20_frames2": modulator.design(20, 2),
            "dac2": modulator.design(2),
            # the negative limit of a real DAC is out of reach of the product: this one is not
            "narrow": modulator.Params(shift=25, lo=-20001, hi=19998, frames=0),
        },
        [("out", modulator.CODE)],
        rules={"code": ("half_up", "saturate")},
        strobes=("en_product", "en_code"),
    ),
    _block(
        pi,
        [("en", BIT), ("mode", PI_MODE), ("e", pi.ERR), ("preset", pi.OUT)],
        runners.run_pi,
        {"prop": 1, "acc": 1, "y": pi.LATENCY},
        {
            "rate": rate_loop.design().loop,
            "frequency": frequency_tracker.design().loop,
            "odd": pi.Params(kp=-((1 << 24) + 12345), ki=(1 << 22) + 77777, lo=-1000, hi=999),
            "extreme": pi.Params(kp=pi.COEF.lo, ki=pi.COEF.hi, lo=pi.OUT.lo, hi=pi.OUT.hi),
        },
        rules=PI_RULES,
        strobes=("en",),
    ),
    _block(
        spi_dac,
        [("load", BIT), ("word", spi_dac.WORD)],
        runners.run_spi_dac,
        {"sdin": "lead + 1 .. lead + bits", "ldac_n": "lead + bits + ldac"},
        {"dac8811": spi_dac.DAC8811, "ad5791": spi_dac.AD5791, "dac82002": spi_dac.DAC82002},
        [("sdin", BIT)],
        rules={"shift": (None, "wrap")},
        strobes=("load",),
        wait=27,
    ),
    _block(
        spi_adc,
        [("drdy_n", BIT), ("dout", BIT)],
        runners.run_spi_adc,
        {"valid": spi_adc.READ_CYCLES},
        rules={"shift": (None, "wrap")},
        idle={"drdy_n": 1},
        wait=spi_adc.READ_CYCLES + spi_adc.TAIL_CYCLES,
    ),
    _block(
        digital_sid,
        [
            ("ce_1m", BIT),
            ("dump", BIT),
            ("refs", bits(4)),
            ("sample_x", digital_sid.SAMPLE),
            ("sample_y", digital_sid.SAMPLE),
        ],
        runners.run_digital_sid,
        {"codes": digital_sid.LATENCY, "valid": digital_sid.LATENCY},
        {
            "default": digital_sid.design(),
            "delay0": digital_sid.design(ref_delay_ticks=0, pole_hz=1900.0)._replace(still=5),
        },
        rules={
            "acc": (None, "saturate"),
            "pole1": ("half_up", None),
            "pole2": ("half_up", None),
            "pole3": ("half_up", None),
            "codes": ("half_up", "saturate"),
            "still": (None, "saturate"),
        },
        strobes=("ce_1m", "dump"),
        wait=4,
    ),
    _block(
        cordic,
        [("start", BIT), ("x_in", cordic.INPUT), ("y_in", cordic.INPUT)],
        runners.run_cordic,
        {"magnitude": cordic.LATENCY, "phase": cordic.LATENCY, "done": cordic.LATENCY},
        rules={
            "x": ("half_up", None),
            "y": ("half_up", None),
            "angle": (None, "wrap"),
            "magnitude": ("half_up", None),
            "phase": ("half_up", "wrap"),
        },
        strobes=("start",),
        wait=cordic.LATENCY,
        roms=(Rom("cordic_atan", cordic.ANGLE.width, tuple(cordic.ATAN)),),
    ),
    _block(
        isqrt,
        [("start", BIT), ("u", isqrt.RADICAND)],
        runners.run_isqrt,
        {"y": isqrt.LATENCY, "done": isqrt.LATENCY},
        rules={"y": ("floor", None), "radicand": (None, "wrap")},
        strobes=("start",),
        wait=isqrt.LATENCY,
    ),
    _block(
        agc,
        [
            ("en", BIT),
            ("en_pi", BIT),
            ("mode", bits(3)),
            ("magnitude", cordic.MAGNITUDE),
            ("setpoint", agc.SETPOINT),
            ("preset", agc.AMPLITUDE),
        ],
        runners.run_agc,
        {"error": 1, "loop_y": agc.LATENCY},
        {"default": agc.design()},
        [("amplitude", agc.AMPLITUDE), ("saturated", BIT)],
        rules=LOOP_RULES,
        strobes=("en", "en_pi"),
    ),
    _block(
        frequency_tracker,
        [
            ("en", BIT),
            ("en_pi", BIT),
            ("mode", PI_MODE),
            ("phase", frequency_tracker.ERROR),
            ("load", BIT),
            ("adjust", BIT),
            ("correction", frequency_tracker.CORRECTION),
            ("preset", frequency_tracker.WORD),
        ],
        runners.run_frequency_tracker,
        {"error": 1, "word": frequency_tracker.LATENCY},
        # the limits of the design are 22,000 frames away: those of the second case are near
        {"default": frequency_tracker.design(), "narrow": frequency_tracker.design(limit_hz=0.05)},
        rules={**LOOP_RULES, "centre": (None, "wrap"), "word": (None, "wrap")},
        strobes=("en", "en_pi"),
    ),
    _block(
        rate_loop,
        [("en", BIT), ("en_pi", BIT), ("mode", PI_MODE), ("sense_sin", CODE24), ("preset", rate_loop.WORD)],
        runners.run_rate_loop,
        {"error": 1, "loop_y": rate_loop.LATENCY},
        {"default": rate_loop.design()},
        [("saturated", BIT)],
        rules=LOOP_RULES,
        strobes=("en", "en_pi"),
    ),
    _block(
        quadrature_loop,
        [
            ("en", BIT),
            ("en_pi", BIT),
            ("en_root", BIT),
            ("mode", PI_MODE),
            ("sense_cos", CODE24),
            ("preset", isqrt.RADICAND),
        ],
        runners.run_quadrature_loop,
        {"error": 1, "loop_y": quadrature_loop.LATENCY, "root_y": isqrt.LATENCY},
        {"default": quadrature_loop.design()},
        [("railed", BIT)],
        rules={**LOOP_RULES, "root_y": ("floor", None), "root_radicand": (None, "wrap")},
        strobes=("en", "en_pi", "en_root"),
        wait=20,
    ),
    _block(
        lock_monitor,
        [
            ("en", BIT),
            ("enable", bits(4)),
            ("judged", bits(4)),
            ("agc_error", agc.ERROR),
            ("setpoint", agc.SETPOINT),
            ("phase", cordic.PHASE),
            ("sense_sin", CODE24),
            ("sense_cos", CODE24),
            ("rail", BIT),
        ],
        runners.run_lock_monitor,
        {"locked": 1},
        {
            "default": lock_monitor.design(),
            "quick": _quick_sequencer().lock,
            "longest": lock_monitor.design()._replace(frames_in=(4095,) * 4, frames_out=(4095,) * 4),
        },
        strobes=("en",),
    ),
    _block(
        fault_monitor,
        [
            ("en", BIT),
            ("armed", BIT),
            ("fresh", BIT),
            *((f"codes_{k}", fault_monitor.CODE) for k in range(4)),
            # its limits are parameters of the same names, and a module has one name space
            *((f"i_{k}", BIT) for k in ("drive", "rate", "rail")),
            ("watch_stuck", BIT),
            ("levels", fault_monitor.FLAGS),
            ("clear", fault_monitor.FLAGS),
        ],
        runners.run_fault_monitor,
        {"flags": 1, "latch": 1},
        {
            "default": fault_monitor.design(),
            "quick": _quick_sequencer().faults,
            "longest": fault_monitor.Params(*[4095] * 5, top=fault_monitor.LONG.hi),
            "off": fault_monitor.Params(over_range=1, stuck=0, drive=0, rate=1, rail=0, top=1),
        },
        rules=FAULT_RULES,
        strobes=("en", "armed"),
    ),
    _block(
        sequencer,
        [
            ("en", BIT),
            ("i_control", sequencer.CONTROL),
            ("i_clear", fault_monitor.FLAGS),
            ("i_adc_ok", BIT),
            ("i_stale", BIT),
            *((f"i_{k}", CODE24) for k in ("drive_sin", "drive_cos", "sense_sin", "sense_cos")),
            ("i_magnitude", cordic.MAGNITUDE),
            ("i_phase", cordic.PHASE),
            ("i_setpoint", agc.SETPOINT),
            ("i_drive_saturated", BIT),
            ("i_rate_saturated", BIT),
            ("i_qsc_rail", BIT),
        ],
        runners.run_sequencer,
        {"state": 1},
        {
            "quick": _quick_sequencer(),
            # every time one frame: 255 failed attempts in a few hundred rows
            "fastest": _quick_sequencer()._replace(**dict.fromkeys(sequencer.Params._fields[:9], 1)),
        },
        [
            (name, bits(3) if name == "agc_mode" else PI_MODE if name.endswith("_mode") else BIT)
            for name in sequencer.Outputs._fields
        ],
        rules={
            "timer": (None, "saturate"),
            "attempts": (None, "saturate"),
            "correction": ("half_up", None),
            **{f"faults_{k}": rule for k, rule in FAULT_RULES.items()},
        },
        strobes=("en", "i_adc_ok"),
    ),
    _block(
        rate_output,
        [
            *zip(rate_output.Params._fields, rate_output.PARAMS_FMT),
            ("en", BIT),
            ("word", rate_output.CODE),
            ("temperature", rate_output.CODE),
        ],
        runners.run_rate_output,
        {"y": rate_output.LATENCY, "valid": rate_output.LATENCY},
        rules={
            "t": ("floor", None),
            "t2": ("half_up", None),
            "scale": ("half_up", "saturate"),
            "corrected": ("half_up", "saturate"),
            "scaled": ("half_up", "saturate"),
            "y": ("half_up", None),
        },
        strobes=("en",),
        wait=rate_output.LATENCY,
        dense=False,
        runtime_params=True,
    ),
    _block(
        registers,
        [("write", BIT), ("address", registers.ADDRESS), ("data", registers.DATA), ("taken", BIT)],
        runners.run_registers,
        dict.fromkeys(registers.State._fields, registers.LATENCY),
        rules=dict.fromkeys(registers.State._fields, (None, "wrap")),
        strobes=("write",),
    ),
    _block(
        watchdog,
        [("ce_1m", BIT), ("frame", BIT)],
        runners.run_watchdog,
        {"stale": "1 after frame; limit + 1 ticks without one"},
        {"default": watchdog.design(), "limit250": watchdog.design(250)},
        rules={"age": (None, "saturate")},
    ),
    _block(
        rates,
        [("go", BIT)],
        runners.run_rates,
        {"slot": rates.LATENCY},
        pins=[("ce_1m", BIT), ("ce_8k", BIT)],
        rules={"tick": (None, "wrap"), "frame": (None, "wrap")},
        strobes=("go",),
        wait=rates.SLOTS,
    ),
)
BLOCKS = {block.stem: block for block in LISTED}


def params_of(block, case):
    """[Port-like (name, raw, format)] of the case's parameters, flattened; empty where they are inputs."""
    params = block.cases[case]
    if params is None:
        return []
    fmt = importlib.import_module(f"fpga_model.{block.stem}").PARAMS_FMT
    pairs = zip(leaves(params), format_leaves(fmt), strict=True)
    return [(flat(path), int(raw), found) for (path, raw), (_, found) in pairs]


def run(block, case, stimulus):
    """(registers, pins) of a case, int64 rows: registers before each edge, pins under that row's inputs.

    stimulus  int64, one row per edge, the columns of `block.columns`
    Raises ValueError if an input, a register or a pin leaves its format.
    """
    stimulus = np.ascontiguousarray(stimulus, np.int64)
    check(block.columns, stimulus, f"{block.stem}: stimulus")
    regs = np.zeros((len(stimulus), len(block.registers)), np.int64)
    pins = np.zeros((len(stimulus), len(block.pins)), np.int64)
    params = block.cases[case]
    block.run(DEFAULT if params is None else params, block.state, stimulus, regs, pins)
    check(block.registers, regs, f"{block.stem}: register")
    check(block.pins, pins, f"{block.stem}: output")
    return regs, pins


def check(ports, rows, what):
    """Raise ValueError if a column leaves the format of its port."""
    if rows.ndim != 2 or rows.shape[1] != len(ports):
        raise ValueError(f"{what}: expected {len(ports)} columns, got an array of shape {rows.shape}")
    if not len(rows):
        return
    for port, least, most in zip(ports, rows.min(axis=0).tolist(), rows.max(axis=0).tolist(), strict=True):
        if not (port.fmt.holds(least) and port.fmt.holds(most)):
            raise ValueError(f"{what} {port.name}: {least} .. {most} leaves format {port.fmt}")


def depth_of(block):
    """Clocks that reset and enable sweeps have to cover: the longest whole-number latency, or the wait."""
    return max([block.wait, *(k for k in block.latency.values() if isinstance(k, int))])
