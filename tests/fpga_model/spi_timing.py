"""Pin timing of the DAC masters against the data sheets; analog_frontend/parts/dac_serial.py says what is confirmed."""

from fractions import Fraction

from fpga_model import spi_dac
from fpga_model.rates import MASTER_HZ, TICK_CYCLES

DRIVE_PERIOD_CYCLES = TICK_CYCLES
SENSE_PERIOD_CYCLES = TICK_CYCLES
QUADRATURE_PERIOD_CYCLES = 2 * TICK_CYCLES


# name: ns, least, from the data sheets (analog_frontend/parts/dac_serial.py says which are confirmed)
DAC8811_LIMITS_NS = {
    "SCLK period": 20,
    "SCLK high": 10,
    "SCLK low": 10,
    "CS fall to first SCLK edge": 5,
    "SDIN setup": 5,
    "SDIN hold": 10,
    "last SCLK edge to CS rise": 10,
}
AD5791_LIMITS_NS = {
    "SCLK period": 28,
    "SYNC fall to first SCLK edge": 5,
    "last SCLK edge to SYNC rise": 2,
    "SYNC high": 48,
    "SYNC rise to LDAC fall": 20,
    "LDAC low": 14,
}
DAC82002_LIMITS_NS = {
    "SCLK period": 20,
    "SCLK high": 9,
    "SCLK low": 9,
    "SYNC fall to first SCLK edge": 13,
    "SDIN setup": 5,
    "SDIN hold": 10,
    "last SCLK edge to SYNC rise": 10,
    "SYNC high": 160,
    "update to update": 1000,
}


def limits_ns(p):
    """Data sheet minima of the part that speaks this frame, {name: ns}."""
    if p.ldac:
        return AD5791_LIMITS_NS
    return DAC8811_LIMITS_NS if p.bits == spi_dac.DAC8811.bits else DAC82002_LIMITS_NS


def timing_report(p, period_clocks):
    """Pin timing of the master against the part: list of (name, actual_ns, limit_ns, ok).

    period_clocks  26 MHz clocks between loads
    SCLK has 50 % duty; pin-to-pin skew and rise times are not counted. Raises ValueError if frames would overlap.
    """
    if period_clocks < spi_dac.period_cycles(p):
        raise ValueError(
            f"period_clocks: {period_clocks} is below {spi_dac.period_cycles(p)} clocks, the length of a frame"
        )
    half = Fraction(1, 2)
    clocks = {
        "SCLK period": 1,
        "SCLK high": half,
        "SCLK low": half,
        "CS fall to first SCLK edge": p.lead + half,
        "SYNC fall to first SCLK edge": p.lead + half,
        "SDIN setup": half,
        "SDIN hold": half,
        "last SCLK edge to CS rise": half,
        "last SCLK edge to SYNC rise": half,
        "SYNC high": period_clocks - p.lead - p.bits,
        "SYNC rise to LDAC fall": 1,
        "LDAC low": 1,
        "update to update": period_clocks,
    }
    report = []
    for name, limit_ns in limits_ns(p).items():
        actual_ns = Fraction(clocks[name]) * 1_000_000_000 / MASTER_HZ
        report.append((name, float(actual_ns), float(limit_ns), actual_ns >= limit_ns))
    return report
