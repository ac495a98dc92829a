"""Register bank of the host, at most 48 bits each; MAP is the single source for the RTL and the documentation.

    write = 1 and address = that of a register    register' = the low bits of data, in its format
    fault_clear' = waiting | the ones written to it
    waiting = 0 at `taken` (the sequencer has read it), else fault_clear

    address, data, write --(decode)--[registers] --> blocks     [..] register

Formats   address [0,8,0]   data [0,48,0]   each register in its own format, two's complement in the low bits of data
Latency   1 clock from write to the register
Rounding  none
Overflow  bits above a register's width are dropped
Cost      538 register bits
Source    docs/register_map.md (the map as words of 32 bits)

A write to an address that is not in the map, or to one that can only be read, changes nothing. A read outside the map
gives 0. A read-only register is the state of another block: `path` is its place in the state of the whole design.
Ones that several writes bring to a w1c address add up; they clear bits at the next frame, unless the fault is live.

CONTROL   RUN = 0 stops the drive; it is 1 after reset. HOLD_* freezes a loop, FIX_* replaces it by its fixed word; its
          lock is then not judged. OPEN_DRIVE applies AMPLITUDE_FIXED and FREQUENCY_FIXED without search or loops.
          CLEAR_FAULTS clears the latch while it is 1
IDENTITY  has the version of the map. In version 1 a second write to FAULT_CLEAR within a frame replaced the first

A step of AMPLITUDE_SETPOINT by more than 20 % while locked is a lost lock.
"""

from collections import namedtuple
from typing import NamedTuple

from fpga_model import agc, cordic, dds, fault_monitor, frequency_tracker, isqrt, rate_loop, rate_output, sequencer
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits, formats, wrap, wrap_unsigned
from fpga_model.jit import inlined

ADDRESS = bits(8)
DATA = bits(48)
LATENCY = 1
FIRST_READ_ONLY = 0x40
VERSION = 2
REPLAYED = (1, VERSION)  # versions with these addresses, formats and bits


class Register(NamedTuple):
    """One row of the map; access is rw, ro, or w1c: reads `path`, and ones written to it clear the bits there."""

    address: int
    name: str
    fmt: Fmt
    reset: int
    access: str
    unit: str
    path: str
    doc: str


def identity(version=VERSION):
    """Word of IDENTITY of a version of the map: 'GYRO' and the version."""
    return int.from_bytes(b"GYRO", "big") << 16 | version


IDENTITY = identity()


def _writable():
    phase, coef = dds.PHASE, rate_output.PARAMS_FMT
    nominal = rate_output.design()
    control = ", ".join(f"{k} {name}" for k, name in enumerate(sequencer.CONTROL_BITS))
    turn, per_clock, full_scale = "turn", "turn per clock", "10 V"
    rows = (
        ("control", sequencer.CONTROL, sequencer.RUN, "bits", control),
        ("fault_clear", fault_monitor.FLAGS, 0, "bits", "fault latch; a one clears the bit unless the fault is live"),
        ("phase_drive_sine", phase, 0, turn, "added to the phase of the drive sine; positive advances it"),
        ("phase_sense_sine", phase, 0, turn, "added to the phase of the sense sine"),
        ("phase_drive_ref", phase, 0, turn, "added to the phase of the drive references"),
        ("phase_sense_ref", phase, 0, turn, "added to the phase of the sense references"),
        ("amplitude_setpoint", agc.SETPOINT, agc.setpoint(), "magnitude LSB", "drive amplitude; reset is 5 um"),
        ("frequency_fixed", phase, frequency_tracker.NOMINAL_WORD, per_clock, "start-up and open-loop frequency"),
        ("amplitude_fixed", agc.AMPLITUDE, 0, full_scale, "drive amplitude while OPEN_DRIVE"),
        ("rate_fixed", rate_loop.WORD, 0, full_scale, "rate word while FIX_FTR"),
        ("quadrature_fixed", isqrt.RADICAND, 0, "(5.5 V)^2 / 2^32", "u = V_q^2 while FIX_QSC"),
        ("rate_bias", coef.bias, nominal.bias, "word LSB", "bias b0"),
        ("rate_bias_t1", coef.bias_t1, 0, "word LSB per t", "bias b1"),
        ("rate_bias_t2", coef.bias_t2, 0, "word LSB per t2", "bias b2"),
        ("rate_scale", coef.scale, nominal.scale, "1", "scale s0; reset gives 2^-20 deg/s at 8651 LSB per deg/s"),
        ("rate_scale_t1", coef.scale_t1, 0, "1 per t", "scale s1"),
        ("rate_scale_t2", coef.scale_t2, 0, "1 per t2", "scale s2"),
        ("decimation", coef.decimation, nominal.decimation, "log2", "k, mean of 2^k frames; 7 counts as 6"),
    )
    for address, (name, fmt, reset, unit, doc) in enumerate(rows):
        if name == "fault_clear":
            yield Register(address, name, fmt, reset, "w1c", unit, "control.sequencer.faults.latch", doc)
        else:
            yield Register(address, name, fmt, reset, "rw", unit, f"registers.{name}", doc)


def _read_only():
    states = ", ".join(f"{k} {name}" for k, name in enumerate(sequencer.STATES))
    flags = ", ".join(f"{k} {name}" for k, name in enumerate(fault_monitor.NAMES))
    seq, out = sequencer.STATE_FMT, rate_output.STATE_FMT
    rows = (
        ("identity", bits(48), IDENTITY, "", "", "'GYRO' and the version of this map"),
        ("state", seq.state, sequencer.POWER_UP, "", "control.sequencer.state", states),
        ("lock", seq.lock.locked, 0, "bits", "control.sequencer.lock.locked", "0 AGC, 1 PLL, 2 FTR, 3 QSC"),
        ("flags", seq.faults.flags, 0, "bits", "control.sequencer.faults.flags", f"live faults: {flags}"),
        ("attempts", seq.attempts, 0, "", "control.sequencer.attempts", "failed searches since power-up"),
        ("frequency", dds.PHASE, 0, "turn per clock", "control.frequency_tracker.word", "DDS word"),
        ("amplitude", agc.AMPLITUDE, 0, "10 V", "control.agc.loop.y", "drive amplitude (not during the kick)"),
        ("magnitude", cordic.MAGNITUDE, 0, "magnitude LSB", "control.cordic.magnitude", "measured drive amplitude"),
        ("phase", cordic.PHASE, 0, "turn", "control.cordic.phase", "measured drive phase, lead of x"),
        ("rate_word", rate_loop.WORD, 0, "10 V", "control.rate_loop.loop.y", "force-to-rebalance word"),
        ("quadrature_code", isqrt.ROOT, 0, "5.5 V / 2^16", "control.quadrature_loop.root.y", "V_q"),
        ("rate", out.y, 0, "deg/s", "control.rate_output.y", "compensated and decimated rate"),
        ("temperature", out.t, 0, "256 code LSB", "control.rate_output.t", "t of the temperature polynomials"),
    )
    for address, (name, fmt, reset, unit, path, doc) in enumerate(rows, FIRST_READ_ONLY):
        yield Register(address, name, fmt, reset, "ro", unit, path, doc)


MAP = (*_writable(), *_read_only())
BY_NAME = {r.name: r for r in MAP}
BY_ADDRESS = {r.address: r for r in MAP}
WRITABLE = tuple(r for r in MAP if r.access != "ro")
WIDTHS = tuple(r.fmt.width for r in WRITABLE)
SIGNED = tuple(r.fmt.s for r in WRITABLE)
assert len(BY_NAME) == len(BY_ADDRESS) == len(MAP), "names and addresses must be unique"
assert all(r.fmt.width <= DATA.width and ADDRESS.holds(r.address) and r.fmt.holds(r.reset) for r in MAP)


# the registers; the defaults are the reset values, and the field number is the address
State = namedtuple("State", [r.name for r in WRITABLE], defaults=[r.reset for r in WRITABLE])
State.__annotations__ = {r.name: r.fmt for r in WRITABLE}
STATE_FMT = formats(State)


def reset(d=DEFAULT):
    """The registers of a design at power-on: the nominal frequency in its words."""
    return State(frequency_fixed=frequency_tracker.reset(d).word)


@inlined
def _load_register(k, width, old, write, address, data):
    if write and address == k:
        return wrap(data, width) if SIGNED[k] else wrap_unsigned(data, width)
    return old


@inlined
def step(d, s, write, address, data, taken):
    """One clock edge."""
    if not write and not taken:
        return s
    waiting, turn = 0 if taken else s.fault_clear, d.dds_bits
    return State(
        control=_load_register(0, WIDTHS[0], s.control, write, address, data),
        fault_clear=waiting | _load_register(1, WIDTHS[1], 0, write, address, data),
        phase_drive_sine=_load_register(2, turn, s.phase_drive_sine, write, address, data),
        phase_sense_sine=_load_register(3, turn, s.phase_sense_sine, write, address, data),
        phase_drive_ref=_load_register(4, turn, s.phase_drive_ref, write, address, data),
        phase_sense_ref=_load_register(5, turn, s.phase_sense_ref, write, address, data),
        amplitude_setpoint=_load_register(6, WIDTHS[6], s.amplitude_setpoint, write, address, data),
        frequency_fixed=_load_register(7, turn, s.frequency_fixed, write, address, data),
        amplitude_fixed=_load_register(8, WIDTHS[8], s.amplitude_fixed, write, address, data),
        rate_fixed=_load_register(9, WIDTHS[9], s.rate_fixed, write, address, data),
        quadrature_fixed=_load_register(10, WIDTHS[10], s.quadrature_fixed, write, address, data),
        rate_bias=_load_register(11, WIDTHS[11], s.rate_bias, write, address, data),
        rate_bias_t1=_load_register(12, WIDTHS[12], s.rate_bias_t1, write, address, data),
        rate_bias_t2=_load_register(13, WIDTHS[13], s.rate_bias_t2, write, address, data),
        rate_scale=_load_register(14, WIDTHS[14], s.rate_scale, write, address, data),
        rate_scale_t1=_load_register(15, WIDTHS[15], s.rate_scale_t1, write, address, data),
        rate_scale_t2=_load_register(16, WIDTHS[16], s.rate_scale_t2, write, address, data),
        decimation=_load_register(17, WIDTHS[17], s.decimation, write, address, data),
    )


def to_bus(raw, fmt):
    """The 48-bit word that carries a raw value: its low bits."""
    return raw & ((1 << fmt.width) - 1)


def from_bus(data, fmt):
    """Raw value of the low bits of a word."""
    return wrap(data, fmt.width) if fmt.s else wrap_unsigned(data, fmt.width)


def read(state, address):
    """Word that a read of `address` returns, from the state of the whole design; 0 outside the map."""
    register = BY_ADDRESS.get(address)
    if register is None:
        return 0
    value = register.reset
    if register.path:
        value = state
        for name in register.path.split("."):
            value = getattr(value, name)
    return to_bus(int(value), register.fmt)


BLOCK = Block(
    place=200,
    inputs={"write": BIT, "address": ADDRESS, "data": DATA, "taken": BIT},
    latency=dict.fromkeys(State._fields, LATENCY),
    rules=dict.fromkeys(State._fields, (None, "wrap")),
    strobes=("write",),
)
