"""Machine code of a plant is that of the parts that stand in the process, whatever the cache holds."""

import os
import subprocess
import sys

import pytest

from fpga_model import bound, jit
from fpga_model.jit import ROOT

pytestmark = pytest.mark.skipif(jit.DISABLED, reason="nothing is compiled")

CONVERT = """
import numba
from analog_frontend.parts import adc
PATCH
p = adc.design()
s = adc.reset(p)
s.sums[:, 2] = 64**3 / 8.0
adc.convert(p, s.clock, s.sums)
print(*s.clock[adc.CODES :], sum(adc.convert.stats.cache_hits.values()))
"""
PATCHES = {"": (262140, 262140, 3145730, 3145730, 262140), "adc.code = numba.njit(lambda p, c, v: 77)": (77,) * 5}


@pytest.mark.slow
def test_a_part_that_is_patched_in_memory_is_what_runs(tmp_path):
    """Volts of 1/8 at 4 V full scale give 2^23/32 in steps of 10, twelve times that at a gain of 12."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "GYRO_CACHE": str(tmp_path)}
    hits = []
    for patch in (*PATCHES, ""):
        code = CONVERT.replace("PATCH", patch)
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        *codes, hit = map(int, done.stdout.split())
        assert tuple(codes) == PATCHES[patch], patch
        hits.append(hit)
    assert hits[0] == hits[1] == 0
    assert hits[2] == 1


ENGINE = """
import numba
from analog_frontend.parts import adc
PATCH
from testbench.config import Config
from testbench.engines import frame
from testbench.run.simulation import Simulation
sim = Simulation(Config(), 25.0, 25.0, engine="frame")
sim.advance(2_000, 0.0, 25.0)
print(sim.columns()["adc_temperature"][-1], sum(frame.run_blocks.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_an_engine_runs_the_patched_plant_with_a_warm_cache_and_its_own_afterwards():
    """The sensor's 145.3 mV at 25 degC are 304716 codes of 4 V / 2^23; the patch has 1 V, a quarter of full scale."""
    found = []
    for patch in ("", "adc.temperature_volts = numba.njit(lambda t: 1.0)", ""):
        done = subprocess.run([sys.executable, "-c", ENGINE.replace("PATCH", patch)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.append([int(word) for word in done.stdout.split()])
    assert [code for code, _ in found] == pytest.approx([304716, 2**21, 304716], abs=500)
    assert found[2] == [found[0][0], 1]


def one(x):
    return x + STEP


def two(x):
    return one(x) * 2


STEP = 1


def test_the_digest_follows_every_name_that_is_reached(monkeypatch):
    first = bound.digest(two)
    assert bound.digest(two) == first
    monkeypatch.setitem(globals(), "STEP", 2)
    second = bound.digest(two)
    monkeypatch.setitem(globals(), "STEP", 1)
    assert bound.digest(two) == first
    monkeypatch.setitem(globals(), "one", lambda x: x - STEP)
    assert len({first, second, bound.digest(two)}) == 3


def test_functions_may_be_compiled_while_the_compiled_ones_are_compared(monkeypatch):
    """As lanes in other threads do."""
    monkeypatch.setattr(bound, "_compiled", {})
    bound.compiled(two)
    own = bound._digest_function

    def slow(function):
        bound._compiled[lambda: 0] = None
        return own(function)

    monkeypatch.setattr(bound, "_digest_function", slow)
    assert bound.outdated_functions() == []
