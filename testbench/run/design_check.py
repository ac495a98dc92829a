"""What a design record may not ask for: refused before anything is built, with the reason, the value and the limit.

    serial frames   a DAC is loaded at every tick (V_q: when `quadrature_due`), and a clock is a bit: its frame must fit
    serial clocks   the master clock is SCLK of the DACs
    sine            the phase must hold quadrant, address and fraction; a row must rise by more than nothing

Gains that no format holds are refused by the designers of the loops, sample rates by that of the converter.
Source    docs/blocks/design_record.md
"""

from analog_frontend.parts.device import Device
from fpga_model import rates, spi_dac
from testbench.engines import chips
from testbench.errors import ConfigError


def default_only(config, what, keys=None):
    """Raise ConfigError for another design than the default one, in what is made for it alone; `keys` that matter."""
    standard = type(config.design)()
    for key in keys or type(config.design).model_fields:
        found, default = getattr(config.design, key), getattr(standard, key)
        if found != default:
            raise ConfigError(f"design.{key} = {found}: {what} is of the default design, {default}, alone")


def check(config):
    """Raise ConfigError for a design that cannot work; one line with key, value, limit and unit."""
    d, standard = config.design, type(config.design)()
    for role in ("drive", "sense"):
        key = f"{role}_dac_bits"
        if getattr(d, f"{role}_dac") != chips.GENERIC and getattr(d, key) != getattr(standard, key):
            raise ConfigError(f'design.{key} = {getattr(d, key)} bits needs design.{role}_dac = "generic"')
    if d.adc != chips.GENERIC and d.adc_bits != standard.adc_bits:
        raise ConfigError(f'design.adc_bits = {d.adc_bits} bits needs design.adc = "generic"')
    step_code, part = config.plant.adc_step_code, Device._field_defaults["adc_step_code"]
    if d.adc == chips.GENERIC and step_code != part:
        raise ConfigError(
            f'plant.adc_step_code = {step_code} needs design.adc = "ADS1298", not "generic": adc_bits says'
        )
    quadrature_ticks = 1 + rates.quadrature_mask(config.design_record(), config.firmware.quadrature_update_khz == 1000)
    for role, chip in zip(("drive", "sense", "V_q"), chips.of(d)):
        if d.master_hz > chip.most_hz:
            bits = chip.master.bits
            raise ConfigError(
                f"design.master_hz = {d.master_hz} Hz is above {chip.most_hz} Hz, the SCLK limit of the {role} DAC "
                f"{chip.name}: its {bits} bits take {1e9 * bits / chip.most_hz:.0f} ns or more"
            )
        room = d.tick_clocks * (quadrature_ticks if role == "V_q" else 1)
        # loaded at every tick, V_q's SYNC is not high for its time: configuration.md says so
        need = spi_dac.latch_cycles(chip.master) if role == "V_q" else spi_dac.period_cycles(chip.master)
        if need > room:
            raise ConfigError(
                f"design.tick_clocks = {d.tick_clocks} clocks: the serial frame of the {role} DAC {chip.name} takes "
                f"{need} clocks, and there are {room} between two loads"
            )
    needed = 2 + d.sine_address_bits + d.sine_fraction_bits
    if d.dds_bits < needed:
        raise ConfigError(
            f"design.dds_bits = {d.dds_bits} bits is below {needed}, the quadrant, sine_address_bits and "
            "sine_fraction_bits of the sine"
        )
    if d.sine_bits <= d.sine_address_bits:
        raise ConfigError(
            f"design.sine_address_bits = {d.sine_address_bits} bits is not below sine_bits = {d.sine_bits}: "
            "neighbouring rows of the table would be equal"
        )
