"""What a board gives over temperature, and the sources of its C/V noise, as tables at three temperatures.

Source    analog_frontend/parts/cv_noise.py
"""

import math

from analog_frontend.parts.cv_noise import cv_noise_shares
from testbench.console.text_table import Table, to_decimals
from testbench.paper.loop import derived

TEMPS_DEGC = (-20.0, 25.0, 50.0)
SOURCES = {
    "rest": "cv_noise_v_per_rthz, the same at every temperature",
    "carrier": "noise of the carrier, by the imbalance at rest",
    "ring": "diodes of the ring",
    "resistors": "resistors (Johnson)",
    "voltage": "amplifier, voltage noise",
    "current": "amplifier, current noise",
}
# field of Derived -> (text, unit, digits)
NUMBERS = {
    "lsb_per_dps": ("scale factor", "LSB/(deg/s)", 2),
    "bias_dps": ("bias", "deg/s", 4),
    "quadrature_v": ("V_q at rate 0", "V", 4),
    "arw_deg_per_rt_h": ("angle random walk", "deg/sqrt(h)", 4),
    "instability_deg_per_h": ("bias instability, 1/f noise alone", "deg/h", 3),
    "xe1_deg": ("node phase xe1", "deg", 4),
    "xe2_deg": ("loop phase xe2'", "deg", 4),
    "ye1_deg": ("node phase ye1", "deg", 4),
    "ye2_deg": ("loop phase ye2'", "deg", 4),
}


def _columns(rows):
    heads = ("what", *(f"{temp:g} degC" for temp in TEMPS_DEGC), "unit")
    return {"heads": heads, "rows": rows, "numeric": tuple(range(1, len(TEMPS_DEGC) + 1))}


def shares(config):
    """`Table` of the C/V noise by source (nV/rtHz at the ring's output, sense channel); sources that are 0 left out."""
    noise_shares = [cv_noise_shares(config.device(), temp) for temp in TEMPS_DEGC]
    rows = [
        (text, *(to_decimals(1e9 * share[name], 3) for share in noise_shares), "nV/rtHz")
        for name, text in SOURCES.items()
        if any(share[name] for share in noise_shares)
    ]
    rows.append(("total", *(to_decimals(1e9 * math.hypot(*share.values()), 3) for share in noise_shares), "nV/rtHz"))
    return Table("C/V noise by source, at the ring's output", **_columns(rows))


def numbers(config):
    """`Table` of what is derived at each temperature."""
    derived_values = [derived.derive(config, temp) for temp in TEMPS_DEGC]
    rows = [
        (text, *(to_decimals(getattr(at, name), digits) for at in derived_values), unit)
        for name, (text, unit, digits) in NUMBERS.items()
    ]
    return Table("Derived values over temperature", **_columns(rows))


def as_json(config):
    """[{field of `Derived`: number, "cv_noise_v_per_rthz": {source: V/rtHz}}, ...] at each temperature."""
    return [
        derived.derive(config, temp)._asdict() | {"cv_noise_v_per_rthz": cv_noise_shares(config.device(), temp)}
        for temp in TEMPS_DEGC
    ]
