"""Numbers of docs/why_ye1.md, computed in closed form: scale factor, V_q and bias over the four phase errors."""

import math
from pathlib import Path

import pytest

from testbench.config import Config, changed
from testbench.judge import judge, numbers
from testbench.judge.judge import phase_rows
from testbench.judge.number_verdict import CONTRADICTED, FITTED, PREDICTED, Value
from testbench.paper import closed_form
from testbench.paper.loop import advisor, derived, loop_parameters
from testbench.paper.loop import loop as loops
from testbench.run.budget import PAPER_DEG, budget

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = DOCS / "why_ye1.md"
STEPS = {"xe1": ("1", "2"), "xe2": ("2", "3"), "ye1": ("3", "4"), "ye2": ("4", "5")}
QUANTITIES = {
    "scale factor": "scale_lsb_per_dps", "V_q at rest": "quadrature_v", "bias (deg/s)": "bias_dps",
    "bandwidth": "bandwidth_hz",
}  # fmt: skip
SYMBOLS = {"scale factor": "SF", "V_q at rest": "Vq", "bias (deg/s)": "bias"}
COMPENSATED = {"firmware.phase_sense_sine_deg": 9.2324}


def page(name=PAGE.name):
    return " ".join((DOCS / name).read_text().split())


def row(name):
    """Cells of a row of the page's tables."""
    (line,) = (line for line in PAGE.read_text().splitlines() if line.startswith(f"| {name} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def relative_change(name, node, temp_degc=25.0):
    points = closed_form.default().points
    before, after = (points[(case, temp_degc)][QUANTITIES[name]].value for case in STEPS[node])
    return abs(after - before) / abs(before)


def printed_numbers(name, pair):
    """[Number, ...] of a change between two cases, cold, room and warm."""
    rows = [n for n in numbers.numbers() if n.quantity.startswith("relative deviation rate of")]
    return [n for n in rows if n.symbol == SYMBOLS[name] and n.case == f"case {pair[0]} vs case {pair[1]}"]


def printed_change(name, pair):
    """[what the paper prints, ...], cold, room and warm."""
    return [n.values[0] for n in printed_numbers(name, pair)]


def rest(rate_dps, values=None):
    """(scale factor, V_q, psi in rad, Omega_q in deg/s, bias in deg/s) of the loops at rest at a rate."""
    config = changed(Config(), values or {})
    p = loop_parameters.loop_parameters(config)
    loop = loops.close(p)
    damping = p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg)
    still = loops.steady_state(loop, (math.radians(rate_dps) + damping, p.kxy_n_per_m, *p.sid_offset_v))
    omega_q = math.degrees(p.kxy_n_per_m / (2 * p.coriolis_mass_kg * p.w_rad_s))
    scale = advisor.dc_gain(loop) * loops.DEG
    bias = derived.derive(config, 25.0).bias_dps
    return scale, advisor.volts(p, still[loops.U]), p.ye1_rad + p.xe2_rad, omega_q, bias


def test_the_four_phases():
    planned = budget(Config())
    for node, deg in planned.node_deg().items():
        assert row(node)[1:] == [f"{PAPER_DEG[node]:.4f}", f"{deg:.4f}"]
    ns = sum(part.ns for part in planned.rows["ye1"])
    assert f"{planned.node_deg()['ye1']:.4f} deg are {ns:.0f} ns" in page()
    switch_deg = planned.node_deg()["ye2"] - planned.loop_deg()["ye2"]
    assert f"the delay of its switch ({switch_deg:.4f} deg)" in page()


def test_the_forward_phases_at_the_demodulator():
    """Loop phases in place of node phases: ye2 is contradicted, too; what the pages say of it."""
    found = phase_rows({node: Value(deg) for node, deg in budget(Config()).loop_deg().items()})
    xe2, ye2 = found["xe2"].part, found["ye2"].part
    assert (found["xe2"].verdict, found["ye2"].verdict) == (FITTED, CONTRADICTED)
    sigmas = f"{xe2.pull:.1f} sigma", f"{ye2.pull:.0f} sigma"
    assert f"{xe2.model.value:.3f} deg ({sigmas[0]}) and {ye2.model.value:.3f} deg ({sigmas[1]})" in page()
    assert f"xe2' = {xe2.model.value:.3f} deg ({sigmas[0]}) and ye2' = {ye2.model.value:.3f} deg ({sigmas[1]})" in page(
        "phases.md"
    )
    assert f"the model is {-ye2.pull:.0f} sigma lower" in page("limits.md")


@pytest.mark.parametrize("name", QUANTITIES)
def test_changes_by_each_compensation(name):
    cells = row(name)
    assert cells[:4] == [f"{100 * relative_change(name, node):.2f}" for node in STEPS]
    if name in SYMBOLS:
        printed = [printed_change(name, STEPS[node])[1] for node in ("ye1", "ye2")]
        assert cells[4:] == [f"{100 * value:.2f}" for value in printed]


def test_the_scale_factor_goes_with_the_cosine():
    """The change by ye1 is 1 - cos(ye1), where the drive is compensated; ye1 changes it more than all others."""
    planned = budget(closed_form.bare(Config()))
    ye1, xe2 = math.radians(planned.node_deg()["ye1"]), math.radians(planned.loop_deg()["xe2"])
    assert relative_change("scale factor", "ye1") == pytest.approx(1 - math.cos(ye1), rel=1e-4)
    assert relative_change("scale factor", "ye1") > 4 * sum(
        relative_change("scale factor", node) for node in ("xe1", "xe2", "ye2")
    )
    alone = [100 * (1 / math.cos(angle) - 1) for angle in (xe2, ye1)]
    drift_ppm = 1e6 * math.tan(ye1) * math.radians(0.1)
    assert f"xe2' alone raises it by {alone[0]:.3f} %, ye1 alone by {alone[1]:.2f} %" in page()
    assert f"a drift of ye1 by 0.1 deg is {drift_ppm:.0f} ppm" in page()
    own = 100 * (1 - math.cos(math.radians(PAPER_DEG["ye1"])))
    cold, room, warm = (100 * value for value in printed_change("scale factor", ("3", "4")))
    assert f"gives {own:.2f} %; it prints {cold:.2f}, {room:.2f} and {warm:.2f} %" in page()
    sigmas = ", ".join(f"{100 * n.sigma:.2f}" for n in printed_numbers("scale factor", ("3", "4")))
    assert f"with a sigma of {' and '.join(sigmas.rsplit(', ', 1))} %" in page()


@pytest.mark.parametrize("rate_dps", [100.0, 300.0])
@pytest.mark.parametrize("values", [{}, COMPENSATED])
def test_the_quadrature_voltage_follows_the_formula(rate_dps, values):
    """V_q^2 = k_xy/k_q (1 - Omega/Omega_q tan(psi)), but for a constant by offsets and damping."""
    p = loop_parameters.loop_parameters(changed(Config(), values))
    _, at_rest, psi, omega_q, _ = rest(0.0, values)
    _, volts, *_ = rest(rate_dps, values)
    null_v2 = p.kxy_n_per_m * p.quad_span_v**2 / p.u_full_n_per_m
    assert volts**2 == pytest.approx(at_rest**2 - null_v2 * rate_dps / omega_q * math.tan(psi), rel=1e-4)
    assert omega_q == pytest.approx(100.0, abs=0.01)


def test_quadrature_voltages_of_the_page():
    (_, zero, psi, _, bias), (_, turning, *_), (_, compensated, *_) = rest(0), rest(300), rest(300, COMPENSATED)
    assert f"tan(psi) = {100 * math.tan(psi):.0f} % of the rate" in page()
    assert f"falls from {zero:.2f} V to {turning:.2f} V. With ye1 compensated it falls to {compensated:.2f} V" in page()
    p = loop_parameters.loop_parameters(Config())
    null_v2 = p.kxy_n_per_m * p.quad_span_v**2 / p.u_full_n_per_m
    assert f"and {zero:.2f} V instead of {math.sqrt(null_v2):.2f} V for V_q at rest" in page()
    ceiling_v = Config().firmware.quadrature_ceiling_v
    ceiling_dps = (zero**2 - ceiling_v**2) / null_v2 * 100 / math.tan(psi)
    assert rest(ceiling_dps)[1] == pytest.approx(ceiling_v, abs=1e-4)
    assert f"Uncompensated, at {ceiling_dps:.0f} deg/s it reaches its ceiling of {ceiling_v:g} V" in page()
    kxy = p.kxy_n_per_m * (1 + (ceiling_v**2 - zero**2) / null_v2)
    assert rest(0, {"plant.kxy_n_per_m": kxy})[1] == pytest.approx(ceiling_v, abs=1e-3)
    assert f"its ceiling of {ceiling_v:g} V beyond {ceiling_dps:.0f} deg/s" in page("limits.md")
    assert f"at rest it does so with k_xy above {kxy:.3f} N/m" in page("limits.md")
    for values in ({}, COMPENSATED):
        assert f"V_q near {rest(100, values)[1]:.2f} V" in page()
    ye1 = math.radians(budget(Config()).node_deg()["ye1"])
    assert relative_change("V_q at rest", "ye1") == pytest.approx(0.5 * bias / 100 * math.tan(ye1), rel=0.03)
    change = printed_change("V_q at rest", ("3", "4"))[1]
    rate_dps = 100 * (1 - 1 / (1 + change) ** 2) / math.tan(math.radians(PAPER_DEG["ye1"]))
    assert f"A change of {100 * change:.2f} % would need a rate of {rate_dps:.0f} deg/s" in page()


def test_the_bias_does_not_depend_on_ye1():
    """The paper prints 17 to 40 %; in the model the bias in deg/s has no ye1, at any temperature."""
    for temp_degc in (-20.0, 25.0, 50.0):
        assert relative_change("bias (deg/s)", "ye1", temp_degc) < 1e-6
        assert relative_change("bias (deg/s)", "xe2", temp_degc) > 0.01
    p = loop_parameters.loop_parameters(Config())
    parts = derived.bias_parts_dps(p, loops.close(p))
    points = closed_form.default().points
    model_dps = sum(points[(case, 25.0)]["bias_dps"].value for case in "123") / 3
    (paper,) = (n for n in numbers.numbers() if n.symbol == "bias" and n.case == numbers.MEAN and n.temp_degc == 25.0)
    charge_dps = parts["sine"] + parts["cosine"]
    assert (
        f"{model_dps:+.2f} deg/s in the model, of which {charge_dps:.2f} are charge injection, "
        f"and {paper.values[0]:.2f} deg/s in the paper" in page()
    )
    printed = printed_change("bias (deg/s)", ("3", "4"))
    assert f"The paper prints {', '.join(f'{100 * value:.0f}' for value in printed[:2])} and" in page()
    assert f"and {100 * printed[2]:.0f} % for ye1" in page()


def test_what_the_commands_print():
    (scale, _, _, _, bias), (turned, _, _, _, same) = rest(0), rest(0, COMPENSATED)
    assert bias == pytest.approx(same, rel=1e-6)
    bandwidths = [
        advisor.bandwidth(loops.close(loop_parameters.loop_parameters(changed(Config(), values))))[0]
        for values in ({}, COMPENSATED)
    ]
    assert f"scale factor {scale:.1f} LSB/(deg/s), bias {bias:.4f} deg/s, bandwidth {bandwidths[0]:.1f} Hz" in page()
    assert f"{turned:.1f} LSB/(deg/s), the same bias, {bandwidths[1]:.1f} Hz" in page()
    case_3, case_4 = (closed_form.default().points[(case, 25.0)]["scale_lsb_per_dps"].value for case in "34")
    assert f"{case_3:.1f} and {case_4:.1f} LSB/(deg/s)" in page()
    ye1, xe2 = math.radians(budget(Config()).node_deg()["ye1"]), math.radians(budget(Config()).loop_deg()["xe2"])
    alone, steps = 1 - turned / scale, 1 - case_4 / case_3
    assert alone == pytest.approx(1 - math.cos(ye1 + xe2) / math.cos(xe2), rel=1e-4)
    assert f"changes the scale factor by {100 * alone:.2f} %" in page()
    assert f"without xe2', it is {100 * steps:.2f} %" in page()
    more = budget(Config()).node_deg()["ye1"] - PAPER_DEG["ye1"]
    assert f"{more:.2f} deg more" in page()


def test_what_the_predicted_rows_are():
    """docs/paper.md: changes of about one sigma, bounds, and three changes of the scale factor by a fitted ye1."""
    predicted = [r for r in judge.rows(closed_form.default()) if r.verdict == PREDICTED]
    bounds = [r for r in predicted if r.number.bound]
    small = [r for r in predicted if r.number.case == "case 4 vs case 5" and not r.number.bound]
    scale = [r for r in predicted if r.number.case == "case 3 vs case 4"]
    assert (len(small), len(bounds), len(scale), len(predicted)) == (9, 3, 3, 15)
    assert {r.number.symbol for r in scale} == {"SF"}
    sigmas = sorted(r.number.values[0] / r.number.sigma for r in small)
    assert f"whose printed value is {sigmas[0]:.1f} to {sigmas[-1]:.1f} sigma" in page("paper.md")
    assert f"the {len(predicted)} predicted rows" in page("paper.md")


def test_fitted_values_that_are_not_met():
    """docs/paper.md: without 1/cos and offsets the three would be the paper's, within their size."""
    room = [
        r for r in judge.rows(closed_form.default()) if r.number.case == numbers.MEAN and r.number.temp_degc == 25.0
    ]
    scale, volts, bias = (next(r for r in room if r.number.symbol == symbol) for symbol in ("SF", "Vq", "bias"))
    assert {(r.rule.role, r.verdict) for r in (scale, volts, bias)} == {("fitted", CONTRADICTED)}
    assert bias.part.model.value > 0 > bias.number.values[0]
    assert f"scale factor ({scale.part.pull:+.1f} sigma), V_q ({volts.part.pull:+.1f} sigma)" in page("paper.md")
    p = loop_parameters.loop_parameters(Config())
    loop = loops.close(p)
    aligned = closed_form.default().points[("5", 25.0)]["scale_lsb_per_dps"].value
    null_v = math.sqrt(p.kxy_n_per_m / p.u_full_n_per_m) * p.quad_span_v
    damping_dps = derived.bias_parts_dps(p, loop)["damping"]
    printed = [r.number.text for r in (scale, volts, bias)]
    assert (
        f"{aligned:.0f} LSB/(deg/s), {null_v:.2f} V and {damping_dps:.2f} deg/s; "
        f"the paper prints {printed[0]}, {printed[1]} and {printed[2]}" in page("paper.md")
    )
