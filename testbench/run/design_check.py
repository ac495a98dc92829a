"""What a design record may not ask for: refused before anything is built, with the reason, the value and the limit.

    serial frames   a DAC is loaded at every tick (V_q: when `quadrature_due`), and its frame must fit in between
    serial clocks   SCLK of a DAC or of the ADC is the master clock over its divider
    read            of the ADC: with its tail, and with the 8 kHz work behind it, before the next conversion is ready
    sine            the phase must hold quadrant, address and fraction; a row must rise by more than nothing

Gains that no format holds are refused by the designers of the loops, sample rates by that of the converter.
Source    docs/firmware.md
"""

from analog_frontend.parts import adc
from analog_frontend.parts.device import Device
from fpga_model import rates, spi_adc, spi_dac
from testbench.engines import chips
from testbench.errors import ConfigError

ADC_SCLK_HZ = 20_000_000  # ADS1298, from 2.7 V on: a period of 50 ns
# Keys that only a generic ADC has, and their units
ADC_KEYS = {"adc_bits": " bits", "adc_word_bits": " bits", "adc_channels": "", "adc_tail_clocks": " clocks"}


def default_only(config, what, keys=None):
    """Raise ConfigError for another design than the default one, in what is made for it alone; `keys` that matter."""
    if keys is None and config.scenario.host != "bus":
        raise ConfigError(f'scenario.host = "{config.scenario.host}": {what} supports "bus" only')
    standard = type(config.design)()
    for key in keys or type(config.design).model_fields:
        design_value, default = getattr(config.design, key), getattr(standard, key)
        if design_value != default:
            raise ConfigError(f"design.{key} = {design_value}: {what} supports only the default design, {default}")


def _frame(d, role):
    """Refuse a frame that a role's part does not have, or that does not hold its code."""
    dac, standard = f"{role}_dac", type(d)()
    if getattr(d, dac) != chips.GENERIC:
        for key in (f"{dac}_{name}" for name in chips.GENERIC_KEYS):
            if getattr(d, key) != getattr(standard, key):
                raise ConfigError(f'design.{key} = {getattr(d, key)} needs design.{dac} = "generic"')
        return
    bits = getattr(d, f"{dac}_bits", chips.QUADRATURE_BITS)
    tail, width, command = (getattr(d, f"{dac}_{key}") for key in ("tail_bits", "frame_bits", "command"))
    frame, most = width or bits + tail, spi_dac.WORD.width
    if not bits + tail <= frame <= most:
        raise ConfigError(
            f"design.{dac}_frame_bits = {width} bits: code and tail take {bits + tail} bits, and {most} is the limit"
        )
    if command >> (frame - bits - tail):
        raise ConfigError(
            f"design.{dac}_command = {command} does not fit the {frame - bits - tail} bits before the code of a frame "
            f"of {frame} bits"
        )


def _serial(d, role, ticks):
    """Refuse a frame or an SCLK that a role's part does not allow, and one that does not end within `ticks`."""
    _frame(d, role)
    chip, divider = getattr(chips.dac_chips(d), role), getattr(d, f"{role}_dac_divider")
    text = f"the {'V_q' if role == 'quadrature' else role} DAC {chip.name}"
    if d.master_hz > divider * chip.most_hz:
        bits, ratio = chip.master.bits, f" / {role}_dac_divider = {divider}" if divider > 1 else ""
        raise ConfigError(
            f"design.master_hz = {d.master_hz} Hz{ratio} is above {chip.most_hz} Hz, the SCLK limit of {text}: its "
            f"{bits} bits take {1e9 * bits / chip.most_hz:.0f} ns or more"
        )
    if 2 * d.master_hz * chip.high_s > 1:
        raise ConfigError(
            f"design.master_hz = {d.master_hz} Hz: SCLK is high for half a clock, {5e8 / d.master_hz:.3g} ns, below "
            f"the {1e9 * chip.high_s:g} ns of {text}"
        )
    room, need = d.tick_clocks * ticks, spi_dac.period_cycles(chip.master)
    if need > room:
        raise ConfigError(
            f"design.tick_clocks = {d.tick_clocks} clocks: the serial frame of {text} takes {need} clocks, and there "
            f"are {room} between two loads"
        )


def _adc(config):
    """Refuse steps or a readout that the ADC does not have, and one that does not end within a frame."""
    d, standard = config.design, type(config.design)()
    if d.adc != chips.GENERIC:
        for key, unit in ADC_KEYS.items():
            if getattr(d, key) != getattr(standard, key):
                raise ConfigError(f'design.{key} = {getattr(d, key)}{unit} needs design.adc = "generic"')
        least = -(-d.master_hz // ADC_SCLK_HZ)
        if d.adc_divider < least:
            more = f"; set adc_divider = {2 ** (least - 1).bit_length()}" if least <= 8 else ""
            raise ConfigError(
                f"design.master_hz = {d.master_hz} Hz / adc_divider = {d.adc_divider} is above {ADC_SCLK_HZ} Hz, the "
                f"SCLK limit of the ADC {d.adc}{more}"
            )
    step_code, part = config.plant.adc_step_code, Device._field_defaults["adc_step_code"]
    if d.adc == chips.GENERIC and step_code != part:
        raise ConfigError(
            f'plant.adc_step_code = {step_code} needs design.adc = "ADS1298"; for "generic" adc_bits sets the step'
        )
    if d.adc_bits > d.adc_word_bits:
        raise ConfigError(
            f"design.adc_word_bits = {d.adc_word_bits} bits is below adc_bits = {d.adc_bits}: a word must hold a code"
        )
    record, part = config.design_record(), config.plant
    read, tail = 1 + spi_adc.read_clocks(record), record.adc_tail_clocks
    period = adc.modulator_period(part.adc_clock_ppm, part.adc_modulator_hz, d.master_hz)
    need, room = read + max(tail, rates.SLOTS), period * part.adc_decimation // adc.UNITS_PER_CYCLE
    if need > room:
        raise ConfigError(
            f"design.adc_divider = {d.adc_divider} clocks: {1 + d.adc_channels} words of {d.adc_word_bits} bits take "
            f"{read} clocks, with the longer of tail, {tail}, and 8 kHz work, {rates.SLOTS}: {need}, and there are "
            f"{room} between two conversions"
        )
    last = (1 + adc.CHANNELS) * d.adc_word_bits - 1
    for _, kind, _, bit, _ in config.scenario.faults:
        if kind == "adc_lost_bit" and not d.adc_word_bits < bit <= last:
            raise ConfigError(
                f"scenario.faults: adc_lost_bit = {bit} is outside {d.adc_word_bits + 1} .. {last} bits, the five "
                f"channels of words of {d.adc_word_bits} bits"
            )


def check(config):
    """Raise ConfigError for a design that cannot work; one line with key, value, limit and unit."""
    d, standard = config.design, type(config.design)()
    for role in ("drive", "sense"):
        key = f"{role}_dac_bits"
        if getattr(d, f"{role}_dac") != chips.GENERIC and getattr(d, key) != getattr(standard, key):
            raise ConfigError(f'design.{key} = {getattr(d, key)} bits needs design.{role}_dac = "generic"')
    fast = config.firmware.quadrature_update_khz == 1000
    quadrature_ticks = 1 + rates.quadrature_mask(config.design_record(), fast)
    for role, ticks in zip(chips.Chips._fields, (1, 1, quadrature_ticks)):
        _serial(d, role, ticks)
    _adc(config)
    needed = 2 + d.sine_address_bits + d.sine_fraction_bits
    if d.dds_bits < needed:
        raise ConfigError(
            f"design.dds_bits = {d.dds_bits} bits is below {needed}, the sum of 2, sine_address_bits and "
            "sine_fraction_bits"
        )
    if d.sine_bits <= d.sine_address_bits:
        raise ConfigError(
            f"design.sine_address_bits = {d.sine_address_bits} bits is not below sine_bits = {d.sine_bits}: "
            "neighbouring rows of the table would be equal"
        )
