"""What the model says of the paper's numbers without a simulation: phase budget and linear loop of a configuration.

    phases          budget                      scale factor, bias, V_q, ARW, floor, bandwidth   the linear loop
    cases 1 to 5    words that are the budget's own phases; A_d = m w_x^2 A_x / (Q_x k_vf cos(xe1 + xe2'))

Not here: nonlinearity, asymmetry and records, which take a simulation. The values have no scatter.
Source    docs/paper.md, docs/loop.md
"""

import functools
import math

from analog_frontend.parts import thermal
from testbench import config as configuration
from testbench.engines import chips
from testbench.judge.judge import TEMPERATURES, Model
from testbench.judge.number_verdict import Value
from testbench.paper import phase_laws
from testbench.paper.calibration.calibrations import NODES, REGISTER, case_config
from testbench.paper.loop import advisor, derived, loop_parameters, sense_grid
from testbench.paper.loop import loop as loops
from testbench.paper.measure import measure_scale, record_phases
from testbench.run.budget import budget

SOURCE = "phase budget and linear loop"


def bare(config):
    """The configuration with the four compensation words at zero."""
    return case_config(config, dict.fromkeys(REGISTER.values(), 0.0))


def cases_deg(config):
    """{case: {register: deg}} of cases 1 to 5, calibrated by the budget at 25 degC."""
    phase_budget = budget(bare(config), 25.0)
    node, loop = phase_budget.node_deg(), phase_budget.loop_deg()
    words = {REGISTER[n]: -loop[n] if n in loop else node[n] for n in NODES}
    return {str(k + 1): {REGISTER[n]: words[REGISTER[n]] if i < k else 0.0 for i, n in enumerate(NODES)}
            for k in range(len(NODES) + 1)}  # fmt: skip


def case_values(config, temp_degc):
    """{name: Value} of one register set at a temperature, names as `measure.characterise` has them."""
    derived_values, p = derived.derive(config, temp_degc), loop_parameters.loop_parameters(config, temp_degc)
    device = thermal.device_at_temperature(config.device(), temp_degc)
    psi_rad = math.radians(derived_values.xe1_deg + derived_values.xe2_deg)
    force_n = device.mass_kg * (2 * math.pi * device.fx_hz) ** 2 * p.amplitude_m / device.qx
    values = {
        "scale_lsb_per_dps": derived_values.lsb_per_dps,
        "bias_dps": derived_values.bias_dps,
        "quadrature_v": derived_values.quadrature_v,
        "bandwidth_hz": advisor.bandwidth(loops.close(p))[0],
        "arw_deg_per_rt_h": derived_values.arw_deg_per_rt_h,
        "instability_deg_per_h": derived_values.instability_deg_per_h,
        "drive_v": force_n / (abs(device.k_vf_drive_n_per_v) * math.cos(psi_rad)),
    }
    return {name: Value(value) for name, value in values.items() if value is not None and math.isfinite(value)}


def instability_values(config, temp_degc):
    """{name: Value} of the bias instability, of words at zero; empty where there is no 1/f noise."""
    value = derived.derive(bare(config), temp_degc).instability_deg_per_h
    return {"instability_deg_per_h": Value(value)} if value is not None and math.isfinite(value) else {}


def settings(config):
    """{quantity: numbers} of what the model has as the paper has it; with the symbol where two share one."""
    plant, record, board = config.plant, config.design_record(), chips.dac_chips(config.design)
    return {
        "resonator operating frequency": (plant.fx_hz / 1e3,),
        "modal frequency split": (abs(plant.fy_hz - plant.fx_hz),),
        "quality factor after encapsulation": (min(plant.qx, plant.qy),),
        "carrier frequency": (plant.carrier_hz / 1e6,),
        "FPGA external clock": (record.master_hz / 1e6,),
        "DAC update rate (three DACs)": (record.tick_hz / 1e6,),
        "ADC sampling rate": (record.frame_hz / 1e3,),
        "DAC resolution, drive excitation (DAC8811)": (board.drive.bits,),
        "DAC resolution, FTR control (AD5791)": (board.sense.bits,),
        "DAC resolution, quadrature stiffness correction (DAC82002)": (board.quadrature.bits,),
        "ADC resolution (ADS1298)": (config.design.adc_bits,),
        "stiffness coupling equal to 100 deg/s of quadrature rate": (plant.kxy_n_per_m,),
        "rate test points": measure_scale.POSITIVE_DPS,
        "warm-up before phase tests": (record_phases.WARM_UP_S,),
        "length of phase tests": (record_phases.RECORD_S / 3600,),
        "simulation of drive-phase influence: rate": (phase_laws.DRIVE_DPS,),
        "simulation of drive-phase influence: sense phase error, phi_ye1": (phase_laws.DRIVE_YE1_DEG,),
        "simulation of drive-phase influence: sense phase error, phi_ye2": (phase_laws.DRIVE_YE2_DEG,),
        "phase phi_y from modal parameters": (180.0 if plant.fy_hz < plant.fx_hz else 0.0,),
    }


def loop_change(config):
    """{"bandwidth" (Hz), "phase" (deg at 10 Hz): Value}: largest change of the linear loop over both sense phases."""
    rows = sense_grid.sense_grid(config)
    return {name: Value(max(values) - min(values))
            for name, values in (("bandwidth", [r[2] for r in rows]), ("phase", [r[3] for r in rows]))}  # fmt: skip


def rise_deg(config):
    """{node: Value}: node phase at 50 degC less that at -20 degC, each at its drive frequency."""
    low, high = (
        budget(bare(config), t, thermal.device_at_temperature(config.device(), t).fx_hz).node_deg()
        for t in (TEMPERATURES[0], TEMPERATURES[-1])
    )
    return {n: Value(high[n] - low[n]) for n in NODES}


def model(config):
    """`Model` of a configuration: all that takes no simulation."""
    cases = {case: case_config(config, words) for case, words in cases_deg(config).items()}
    return Model(
        SOURCE,
        node_deg={n: Value(v) for n, v in budget(bare(config), 25.0).node_deg().items()},
        points={(case, t): case_values(of_case, t) for case, of_case in cases.items() for t in TEMPERATURES},
        rise_deg=rise_deg(config),
        loop_change=loop_change(config),
        settings=settings(config),
    )


@functools.cache
def default():
    """`model` of the default configuration, the paper's board."""
    return model(configuration.Config())


def rounded_default():
    """`default` with changes of the linear loop to the third decimal: more digits depend on the processor.

    Kernels of OpenBLAS move its bandwidth by 5e-6 Hz.
    """
    paper_model = default()
    changes = {name: v._replace(value=round(v.value, 3)) for name, v in paper_model.loop_change.items()}
    return paper_model._replace(loop_change=changes)
