"""What part each printed number played before it is judged: input, fitted, free, or none; and what it rests on.

    input    the value is put into the model              fitted   a default was chosen or kept for it
    free     no default was                               none     the model has no such number

Declared by rule: symbol, case, temperature. The first rule that matches holds. `rests_on` are the fitted defaults
behind the model's number, for an input the keys that hold it. Nothing here knows a value of the paper or of the model.
Source    testbench/config/provenance.py (what is fitted), docs/paper.md
"""

import re
from typing import NamedTuple


def _keys(section, names):
    return tuple(f"{section}.{name}" for name in names.split())


PATH = _keys("firmware", "pipeline_registers reference_registers reference_retimed")
XE1 = (
    *PATH,
    *_keys("firmware", "frame_latency_drive"),
    *_keys("plant", "drive_pole_1_s drive_pole_2_s drive_pole_3_s"),
)
YE1 = (
    *PATH,
    *_keys("firmware", "frame_latency_sense"),
    *_keys("plant", "sense_pole_1_s sense_pole_2_s sense_pole_3_s"),
)
AMPLIFIERS = _keys("plant", "ina_noise_gain driver_noise_gain")
XE2 = (*_keys("plant", "cref_drive_f"), *AMPLIFIERS)
YE2 = (*_keys("plant", "cref_sense_f"), *AMPLIFIERS)
SWITCH = _keys("plant", "sid_switch_s")
PHASES = tuple(dict.fromkeys((*XE1, *XE2, *YE1, *YE2)))
TURNS = (*YE1, *XE2, *SWITCH)  # what 1/cos(ye1 + xe2') contains
SCALE = (*_keys("plant", "k_vf_sense_n_per_v sense_dac_span_v"), *TURNS)
QUADRATURE = _keys("plant", "kxy_n_per_m kq_n_per_m_per_v2 kxy_tc_below_per_k kxy_tc_above_per_k")
BIAS = (*_keys("plant", "dxy_ratio"), *TURNS, *YE2)
NOISE = _keys("plant", "cv_noise_v_per_rthz dcdx_f_per_m dcdy_f_per_m")
FLICKER = _keys("plant", "sid_flicker_v_per_rthz dcdx_f_per_m dcdy_f_per_m")
LOOP = (*_keys("plant", "sid_r_ohm sid_c_f"), *_keys("firmware", "ftr_crossover_hz ftr_zero_hz"))
DRIVE = (*_keys("plant", "k_vf_drive_n_per_v"), *XE1, *XE2, *SWITCH)

NODE = "node phase: pin to force, or motion to C/V output; the text does not say at which node it was read"
NODE_XE2 = (
    f"{NODE}; it was found by the least A_d through the demodulator, whose switch would lower the model's value by "
    "0.32 deg; 1e-5 of A_d is 0.26 deg, so the printed fluctuation is stability, not accuracy"
)
UNDEFINED = "the text does not print its definition; the definition of IEEE Std 1431 is used"
INSTRUMENT = "the residual of a calibration depends on the instruments of the bench, which the text does not describe"


class Rule(NamedTuple):
    """Numbers of a symbol whose quantity and case match, what they claim, their role and what they rest on."""

    symbol: str
    match: str  # regular expression on "quantity | case | temperature | kind"
    claim: str  # which of `judge.CLAIMS` says the same of the model
    role: str
    rests_on: tuple = ()
    reading: str = ""


ROOM = r"\| room"
RULES = (
    Rule("phi_xe1", r"\| case 1", "phase", "fitted", XE1, NODE),
    Rule("phi_xe2", r"\| case 3", "phase", "fitted", XE2, NODE_XE2),
    Rule("phi_ye1", r"\| case 3", "phase", "fitted", YE1, NODE),
    Rule("phi_ye2", r"\| case 4", "phase", "fitted", YE2, NODE),
    Rule("phi_xe1", r"\| case 2", "residual", "none", (), INSTRUMENT),
    Rule("phi_ye1", r"\| case 4", "residual", "none", (), INSTRUMENT),
    Rule("phi_ye2", r"\| case 5", "residual", "none", (), INSTRUMENT),
    Rule("SF", rf"mean of cases.*{ROOM}", "mean", "fitted", SCALE),
    Rule("SF", "mean of cases", "mean", "free", SCALE),
    Rule("SF nonlinearity", "mean of cases", "mean", "free", (*SCALE, *QUADRATURE, *YE2), UNDEFINED),
    Rule("SF asymmetry", "mean of cases", "mean", "free", (*SCALE, *QUADRATURE, *YE2), UNDEFINED),
    Rule("Vq", "mean of cases", "mean", "fitted", QUADRATURE),
    Rule("bias", rf"mean of cases.*{ROOM}", "mean", "fitted", BIAS),
    Rule("bias", "mean of cases", "mean", "free", BIAS),
    Rule("BI", rf"mean of cases.*{ROOM}", "mean", "fitted", FLICKER),
    Rule("BI", "mean of cases", "mean", "free", FLICKER),
    Rule("ARW", rf"mean of cases.*{ROOM}", "mean", "fitted", NOISE),
    Rule("ARW", "mean of cases", "mean", "free", NOISE),
    Rule("BW", "bandwidth", "bandwidth", "fitted", LOOP),
    Rule("SF", "relative deviation rate", "change", "free", (*TURNS, *YE2)),
    Rule("Vq", "relative deviation rate", "change", "free", (*QUADRATURE, *TURNS, *YE2)),
    Rule("bias", "relative deviation rate", "change", "free", BIAS),
    Rule("phi_xe1, phi_xe2", "over 2 h", "excursion", "free", (*XE1, *XE2)),
    Rule("phi_ye1, phi_ye2", "over 2 h", "excursion", "free", (*YE1, *YE2)),
    Rule("SF,bias,ARW,Vq", "among cases", "among", "free", (*SCALE, *BIAS, *NOISE, *QUADRATURE)),
    Rule("SF,bias,Vq,ARW", "^relative deviation rates", "among", "free", (*SCALE, *BIAS, *NOISE, *QUADRATURE)),
    Rule("SF,bias,Vq,ARW", "^ratio of", "ratio", "free", (*SCALE, *BIAS, *NOISE, *QUADRATURE)),
    Rule("dBW", "simulated bandwidth", "loop change", "free", LOOP),
    Rule("", "simulated phase shift", "loop change", "free", LOOP),
    Rule("phases", "statement", "rise", "free", PHASES, NODE),
    Rule("Ad", "statement", "fall", "free", DRIVE),
    Rule("f", "", "setting", "input", _keys("plant", "fx_hz")),
    Rule("|fy-fx|", "", "setting", "input", _keys("plant", "fx_hz fy_hz")),
    Rule("phi_y", "", "setting", "input", _keys("plant", "fx_hz fy_hz"), "180 deg: the drive mode is the upper one"),
    Rule("Q", "", "setting", "input", _keys("plant", "qx qy")),
    Rule("kxy", "", "setting", "input", _keys("plant", "kxy_n_per_m")),
    Rule("f_c", "", "setting", "input", _keys("plant", "carrier_hz")),
    Rule("f_clk", "", "setting", "input", _keys("design", "master_hz")),
    Rule("f_DAC", "", "setting", "input", _keys("design", "tick_clocks")),
    Rule("f_ADC", "", "setting", "input", _keys("design", "frame_ticks")),
    Rule("", r"^DAC resolution", "setting", "input", _keys("design", "drive_dac sense_dac quadrature_dac")),
    Rule("", r"^ADC resolution", "setting", "input", _keys("design", "adc")),
    Rule("Omega_z", "rate test points", "setting", "input"),
    Rule("", "^warm-up|^length of phase tests", "setting", "input"),
    Rule("Omega_z", "simulation setting", "setting", "input"),
    Rule("phi_ye1", "simulation setting", "setting", "input"),
    Rule("phi_ye2", "simulation setting", "setting", "input"),
    Rule("Aq/AI", "calibration", "absent", "none", (), "the procedure of this model needs no such ratio"),
    Rule("Table", "missing", "absent", "none", (), "not available"),
    Rule("Figures", "missing", "absent", "none", (), "not available"),
)
OTHER = Rule("", "", "absent", "none", (), "no role is declared for it")


def matching_rule(number):
    """The rule of a number; `OTHER` if no rule matches."""
    text = f"{number.quantity} | {number.case} | {number.temperature} | {number.kind}"
    symbol = "Table" if number.symbol.startswith("Table ") else number.symbol
    return next((r for r in RULES if r.symbol == symbol and re.search(r.match, text)), OTHER)
