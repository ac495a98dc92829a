"""Laws at ports: the text, the kernel, and the same bits in the clocked, frame and lanes engines."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config as numba_config

from analog_frontend import linear
from analog_frontend.effects import catalogue, law, ports
from analog_frontend.parts import device
from fpga_model.jit import kernel
from testbench import config
from testbench.run.simulation import Simulation

MASS, H, W = 2.325e-7, 1e-6, 2 * math.pi * 11000.0
IDENTITY = np.arange(16)


@kernel
def _impulses(force, table, gain, z, places):
    return law.impulses(force, table, gain, z, places, 0, 0, law.NO_LEADS)


@kernel
def _stepped(p, gain, w, places):
    return law.impulses(p.force, p.table, gain, w, places, 0, 1, p.leads)


@kernel
def _gains(p, rate, temp, t_s, out):
    law.gains(p.force, p.cv, p.temp_ref_degc, p.table, p.numbers, rate, temp, t_s, out)


@kernel
def _volts(p, gain, w, places):
    return law.volts(p.force, p.cv, p.table, p.numbers, gain, w, places, 0, 1)


def pushed(texts, z, rate=0.0, temp=25.0, t_s=0.0):
    p = law.design([law.parse(t) for t in texts], MASS, H, W, 25.0)
    gain = np.zeros(law.SLOTS)
    _gains(p, rate, temp, t_s, gain)
    return _impulses(p.force, p.table, gain, z, IDENTITY)


# the text -------------------------------------------------------------------------------------------------------------

TEXTS = (
    "force_x = -2500000000.0 x^3",
    "force_y = 1e-09 abs(vx) vx",
    "cv_y = 1e-06 u",
    "force_y = -1e-05 lag(600) x",
    "force_x = 1.0 rate^2 x",
    "cv_x = 0.0001 temp cx",
    "cv_x = 1e-05 cos(50) cx",
    "force_x = 2e-11 sgn(vx)",
)


@pytest.mark.parametrize("text", TEXTS)
def test_text_is_read_and_written_back(text):
    assert str(law.parse(text)) == text
    assert law.parse(str(law.parse(text))) == law.parse(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("force_z = 1 x", "PORT"),
        ("force_x = x", "coefficient"),
        ("force_x = nan x", "finite"),
        ("force_x = 1 q", "none of"),
        ("force_x = 1 x^4 y^4", "more than 6"),
        ("force_x = 1 cx", "only at the ports cv_x and cv_y"),
        ("cv_x = 1 vx", "only at the force ports"),
        ("force_x = 1 cos(2000) x", "outside"),
        ("force_x = 1 lag(5) step(3) x", "duplicate factor lag"),
        ("force_x = 1 x^", "not a factor"),
    ],
)
def test_what_no_engine_can_run_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        law.parse(text)


def test_unit_of_a_coefficient_makes_the_port_s_unit():
    assert law.parse("force_x = 1 x^2 vx").unit == "N/(m)^2/(m/s)"
    assert law.parse("cv_y = 1 u").unit == "V/(V)"
    assert law.parse("force_x = 1 sgn(vx)").unit == "N"


# the kernel -----------------------------------------------------------------------------------------------------------

number = st.floats(-2.0, 2.0).filter(lambda v: v == 0 or abs(v) > 1e-6)


@given(number, number, number, number, number)
def test_force_is_the_product_times_h_over_m_w(x, vx, y, vy, u):
    z = np.zeros(16)
    z[[2, 6, 7, 8, 9]] = u, x, vx / W, y, vy / W
    scale = H / (MASS * W)
    fx, fy = pushed(["force_x = 3.0 x^2 vx", "force_y = -2.0 abs(y) vy u", "force_x = 0.5 sgn(vx)"], z)
    assert fx == pytest.approx(scale * (3.0 * x * x * vx + 0.5 * np.sign(vx / W)), rel=1e-12, abs=1e-300)
    assert fy == pytest.approx(scale * -2.0 * abs(y) * vy * u, rel=1e-12, abs=1e-300)


@given(st.floats(-10, 10), st.floats(-55, 125), st.floats(0, 1e5), st.floats(0.001, 1000), st.floats(1, 1e5))
def test_surroundings(rate, temp, t_s, hz, tau):
    z = np.zeros(16)
    z[6] = 1.0
    scale = H / (MASS * W)

    def factor(text):
        return pushed([f"force_x = 1.0 {text} x"], z, rate, temp, t_s)[0] / scale

    assert factor("rate^2") == pytest.approx(rate * rate, rel=1e-12, abs=1e-300)
    assert factor("abs(temp)") == pytest.approx(abs(temp - 25.0), rel=1e-12, abs=1e-300)
    phase = 2 * math.pi * math.fmod(hz * t_s, 1.0)
    # a phase of many turns is known to that many roundings
    assert factor(f"cos({hz!r})") == pytest.approx(math.cos(phase), abs=1e-8 + 1e-14 * hz * t_s)
    assert factor(f"sin({hz!r})") == pytest.approx(math.sin(phase), abs=1e-8 + 1e-14 * hz * t_s)
    assert factor(f"lag({tau!r})") == pytest.approx(-math.expm1(-t_s / tau), abs=1e-8)
    assert factor(f"step({tau!r})") == (1.0 if t_s >= tau else 0.0)


@given(*[st.floats(-10, 10)] * 6)
def test_a_voltage_is_the_mean_over_the_tick_as_each_state_moves_in_it(u, u1, w, w1, cx, cx1):
    """Electrodes by their shares, what moves little by the middle of both ends; of u w the mean of the shares."""
    texts = ("cv_x = 2.0 u", "cv_y = 3.0 w", "cv_y = 0.5 cx", "cv_x = 1.0 abs(u) w")
    p = law.design([law.parse(t) for t in texts], MASS, H, W, 25.0, leads=(-0.25, 0.25))
    gain, at = np.zeros(law.SLOTS), np.zeros((max(law.STATES.values()) + 1, 2))
    _gains(p, 0.0, 25.0, 0.0, gain)
    for name, pair in (("u", (u, u1)), ("w", (w, w1)), ("cx", (cx, cx1))):
        at[law.STATES[name]] = pair
    x, y = _volts(p, gain, at.ravel(), 2 * np.arange(len(at)))
    assert x == pytest.approx(2 * (0.75 * u + 0.25 * u1) + (abs(u) * w + abs(u1) * w1) / 2, abs=1e-12)
    assert y == pytest.approx(3 * (0.25 * w + 0.75 * w1) + (cx + cx1) / 4, abs=1e-12)


@given(*[st.floats(-10, 10)] * 5)
def test_a_force_takes_the_mean_of_an_electrode_about_the_first_instant(u, u1, w, w1, x):
    p = law.design(
        [law.parse(t) for t in ("force_x = 1.0 u x", "force_y = 2.0 w^2")], MASS, H, W, 25.0, 0, (-0.25, 0.25)
    )
    gain, at = np.zeros(law.SLOTS), np.zeros((max(law.STATES.values()) + 1, 2))
    _gains(p, 0.0, 25.0, 0.0, gain)
    for name, pair in (("u", (u, u1)), ("w", (w, w1)), ("x", (x, 1e3))):
        at[law.STATES[name]] = pair
    found = np.array(_stepped(p, gain, at.ravel(), 2 * np.arange(len(at)))) * MASS * W / H
    assert found[0] == pytest.approx((1.25 * u - 0.25 * u1) * x, abs=1e-9)
    assert found[1] == pytest.approx(2 * (0.75 * w + 0.25 * w1) ** 2, abs=1e-9)


def test_zero_coefficient_is_off_and_too_many_are_refused():
    assert law.design([law.parse("force_x = 0.0 x")], MASS, H, W, 25.0).force == 0
    with pytest.raises(ValueError, match="9 laws are more than the 8 of a plant"):
        law.design([law.parse("force_x = 1.0 x")] * 9, MASS, H, W, 25.0)


def test_every_state_has_a_place_in_both_arenas():
    from analog_frontend.lanes import side_by_side

    assert len(linear.STATE_OFFSETS) == len(side_by_side.STATE_OFFSETS) == 16
    assert len(set(linear.STATE_OFFSETS.tolist())) == len(set(side_by_side.STATE_OFFSETS.tolist())) == 16


# the catalogue --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect", catalogue.LAWS, ids=lambda e: e.INFO.name)
def test_catalogue_says_where_what_and_whence(effect):
    d = device.Device()
    laws = catalogue.laws(effect, effect.EXAMPLE, d)
    assert laws[0].port == effect.INFO.port
    assert effect.INFO.port in ports.NAMES
    assert effect.INFO.mechanism.split()[0] in ports.MECHANISMS
    assert effect.__name__.endswith("." + effect.INFO.name)
    assert abs(effect.EXAMPLE) < effect.LIMIT
    assert all((*effect.INFO, effect.IDS, effect.DOC))
    # twice the size is twice every coefficient; nothing is no law
    twice = catalogue.laws(effect, 2 * effect.EXAMPLE, d)
    assert [b.coefficient for b in twice] == pytest.approx([2 * a.coefficient for a in laws], rel=1e-15)
    assert catalogue.laws(effect, 0.0, d) == []


# engines --------------------------------------------------------------------------------------------------------------

MIXED = [
    "force_x = -2e9 x^3",
    "force_y = -1e-9 abs(vx) vx",
    "force_y = 3e-9 rate vy",
    "cv_x = 1e-5 cx^3",
    "cv_y = 1e-4 u",
    "cv_y = 1e-3 cos(50) cy",
    "force_x = 1e-9 lag(0.5) x y",
]


def _begun(engine, laws, seed):
    values = {"effects.laws": laws, "noise.seed": seed}
    sim = Simulation(config.changed(config.Config(), values), 25.0, 25.0, engine=engine)
    sim.now = (np.full(1, 0.2), np.full(1, 25.0))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    return sim


def _run(engine, laws, ticks=4000, seed=1):
    sim = _begun(engine, laws, seed)
    sim.advance(ticks, np.linspace(0.1, 0.3, ticks // 125 + 2), 25.0)
    return sim


@pytest.mark.skipif(numba_config.DISABLE_JIT, reason="minutes without the compiler")
def test_engines_agree_to_the_last_bit_and_no_law_is_no_change():
    clocked, frame = _run("clocked", MIXED), _run("frame", MIXED)
    assert clocked.codes_sha256() == frame.codes_sha256()
    assert (clocked.state.plant.z == frame.state.plant.z).all()
    plain = _run("frame", [])
    assert frame.codes_sha256() != plain.codes_sha256()
    assert _run("frame", ["force_x = 0.0 x^3"]).codes_sha256() == plain.codes_sha256()


@pytest.mark.skipif(numba_config.DISABLE_JIT, reason="minutes without the compiler")
def test_lanes_have_the_bits_of_the_frame_engine():
    from testbench.engines.lanes import Lanes

    each = [MIXED, [], MIXED[:1], MIXED[3:5], ["force_y = 1e-10 step(0.003) x"]]
    alone = [_run("frame", laws, 9000, seed) for seed, laws in enumerate(each)]
    beside = [_begun("frame", laws, seed) for seed, laws in enumerate(each)]
    rate = np.linspace(0.1, 0.3, 9000 // 125 + 2)
    Lanes(beside).advance(9000, [rate] * len(each), [25.0] * len(each))
    for a, b in zip(alone, beside):
        assert a.codes_sha256() == b.codes_sha256()
        assert (a.state.plant.z == b.state.plant.z).all()
