"""Deviations of a data sheet's parameters: each is that of the envelope's board, products in place of what is tied."""

import math

import numpy as np
import pytest

from testbench.config import Config
from testbench.measured.closed_loop import loop_symmetries
from testbench.measured.wide import data_sheet
from tests.sealed import coverage, strata
from tests.sealed.draw import DELAY_SHARE

QX = 1.9e5
SD = 1e-3  # of each parameter, relative
PRINTED = 0.05  # of an sd with two digits


def made(moved):
    """(envelope, result) of a fit that ends at the board, but for {key: factor}; it began 2 % off the board."""
    cfg = Config()
    priors = data_sheet.parameters(cfg, data_sheet.read(data_sheet.BUNDLED_PATH))
    truth = {p.key: p.mean for p in priors} | {"plant.qx": QX}
    values = {key: x * moved.get(key, 1.0) for key, x in truth.items()}
    rows = []
    for p in priors:
        x = truth[p.key] * 1.02
        after = x * (1 + math.log(values[p.key] / x)) if p.logarithmic else values[p.key]
        if p.key in ("plant.qx", "plant.qy"):
            after = x * (2 - x / values[p.key])
        prior_sd, sd = (p.scale * x, SD * x) if p.logarithmic else (p.scale, abs(SD * truth[p.key]))
        rows.append({"name": p.key, "prior_sd": prior_sd, "after": after, "sd": sd})
    covariance = np.diag([(SD * x) ** 2 for x in values.values()])
    lines = loop_symmetries.identifiability_lines(list(values), list(values.values()), covariance)
    return {"values": {"plant.qx": QX}}, {"nuisances": rows, "notes": lines}


def test_a_fit_at_the_board_is_off_by_nothing():
    found = coverage.offs(*made({}))
    tied = {k for s in loop_symmetries.SYMMETRIES for k in (s.dependent_key, *s.partners)}
    assert not tied & set(found)
    assert len(found) == len(data_sheet.read(data_sheet.BUNDLED_PATH)) - len(tied) + sum(
        len(s.partners) for s in loop_symmetries.SYMMETRIES
    )
    assert max(map(abs, found.values())) < 1e-2


def test_what_is_off_is_off_by_its_sds():
    found = coverage.offs(*made({"plant.qx": 1.003, "plant.k_vf_sense_n_per_v": 1.002, "plant.sense_pole_1_s": 1.01}))
    assert found["plant.qx"] == pytest.approx(1.02 * (1 - 1 / 1.003) / SD, rel=1e-6)
    # a product of two, both with their sd
    assert found["k_vf_sense_n_per_v * dcdx_f_per_m"] == pytest.approx(2 / math.sqrt(2), rel=PRINTED)
    plant, own = Config().plant, DELAY_SHARE * strata.read().plant["delay_sd_s"]
    sd = math.hypot(SD * 1.01 * plant.sense_pole_1_s, SD * plant.sid_switch_s, own)
    assert found["sense_pole_1_s - sid_switch_s"] == pytest.approx(0.01 * plant.sense_pole_1_s / sd, rel=PRINTED)
    assert sum(abs(x) > 0.5 for x in found.values()) == 3
