"""What a configuration gives at a temperature, in closed form: scale factor, bias, V_q, noise, phases; nothing runs.

    scale factor, bias, V_q   the loops at rest                         `loop.steady_state`
    ARW                       60/sqrt(2) times the density of the rate  `sensitivity.density_dps`
    bias instability          sqrt(2 ln 2) times the density at 1 Hz behind the demodulator, as rate
    phases                    node phases of xe1, ye1, loop phases xe2', ye2'  `budget`

bias = d_xy/(2 m_c) + (d rate/d sin + d rate/d cos) o;  o = 6 R f dQ + dQ/(4 C), dQ left behind: `bias_parts_dps`
Source    docs/loop.md
"""

import math
from typing import NamedTuple

from testbench.paper.loop import advisor, sensitivity
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import LoopParameters, loop_parameters
from testbench.run.budget import budget


class Derived(NamedTuple):
    """Observables at one temperature; phases are lags in deg, xe2 and ye2 as the demodulator sees them."""

    temp_degc: float
    lsb_per_dps: float
    bias_dps: float
    quadrature_v: float
    arw_deg_per_rt_h: float
    instability_deg_per_h: float
    frequency_hz: float
    xe1_deg: float
    xe2_deg: float
    ye1_deg: float
    ye2_deg: float


def per_volt_dps(loop):
    """deg/s by which a volt behind each demodulator turns the word, both together (rms)."""
    columns = lp.OFFSET_SIN, lp.OFFSET_COS
    channel_gains = (abs(lp.response(loop, sensitivity.ARW_HZ, column)[0]) for column in columns)
    return math.hypot(*channel_gains) / abs(advisor.dc_gain(loop) * lp.DEG)


def instability_deg_per_h(p: LoopParameters, loop):
    """Floor of the Allan deviation under 1/f noise of one-sided density h/f: sqrt(2 ln 2 h)."""
    return 3600 * math.sqrt(2 * math.log(2)) * p.flicker_v_per_rthz * per_volt_dps(loop)


def bias_parts_dps(p: LoopParameters, loop):
    """{source: deg/s}: coupling of damping, and the demodulators' offsets."""
    lsb = advisor.dc_gain(loop) * lp.DEG
    sources = {
        "damping": (p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg), 0.0, 0.0, 0.0),
        "sine": (0.0, 0.0, p.sid_offset_v[0], 0.0),
        "cosine": (0.0, 0.0, 0.0, p.sid_offset_v[1]),
    }
    return {name: float(lp.steady_state(loop, inputs)[lp.WORD_BEFORE]) / lsb for name, inputs in sources.items()}


def derive(config, temp_degc):
    """`Derived` of a configuration at a temperature; ConfigError as `loop_parameters`. About 0.1 s."""
    p = loop_parameters(config, temp_degc)
    loop = lp.close(p)
    still = lp.steady_state(loop, (p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg), p.kxy_n_per_m, *p.sid_offset_v))
    lsb = advisor.dc_gain(loop) * lp.DEG
    frequency_hz = p.w_rad_s / (2 * math.pi)
    phases = budget(config, temp_degc, frequency_hz)
    node, loop_deg = phases.node_deg(), phases.loop_deg()
    return Derived(
        temp_degc=float(temp_degc),
        lsb_per_dps=lsb,
        bias_dps=float(still[lp.WORD_BEFORE]) / lsb,
        quadrature_v=advisor.volts(p, still[lp.U]),
        arw_deg_per_rt_h=sensitivity.arw_deg_per_rth(p, loop),
        instability_deg_per_h=instability_deg_per_h(p, loop),
        frequency_hz=frequency_hz,
        xe1_deg=node["xe1"],
        xe2_deg=loop_deg["xe2"],
        ye1_deg=node["ye1"],
        ye2_deg=loop_deg["ye2"],
    )
