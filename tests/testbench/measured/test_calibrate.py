"""Calibration: finds planted values, says when it has not converged, and what the data cannot tell apart."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.config import Config
from testbench.errors import ConfigError
from testbench.measured.record import produce, recording_plan
from testbench.measured.residual import calibrate_residual, parameters
from testbench.storage.record import TableColumn

PLANT = Config().plant
SENSE, GAIN = "plant.k_vf_sense_n_per_v", "plant.dcdy_f_per_m"


class Toy:
    """An engine of straight lines: each channel a gain, the rate channels a product of two."""

    name = "toy"

    def driven_codes(self, config, drive):
        p = config.plant
        shape = np.linspace(1.0, 2.0, len(drive.driven))
        gains = (
            p.qx / PLANT.qx,
            p.kxy_n_per_m / PLANT.kxy_n_per_m + 0.1 * (p.qx / PLANT.qx) ** 2,
            p.k_vf_sense_n_per_v * p.dcdy_f_per_m / (PLANT.k_vf_sense_n_per_v * PLANT.dcdy_f_per_m),
            p.kxy_n_per_m / PLANT.kxy_n_per_m,
        )
        codes = np.zeros((len(shape), 5))
        codes[:, :4] = np.outer(shape, gains) * 1e6
        return codes


def priors(rows):
    texts = {"dist": "normal", "unit": "1", "source": "bench", "correlation_group": ""}
    table = {"param": TableColumn(np.array([row[0] for row in rows]), "")}
    table |= {key: TableColumn(np.array([value] * len(rows)), "") for key, value in texts.items()}
    return table | {key: TableColumn(np.array([row[k] for row in rows]), "1") for k, key in ((1, "mean"), (2, "sd"))}


def recorded(small, truth, rows):
    """The record with the codes of the toy at `truth`, and some noise."""
    record, rng = copy.deepcopy(small), np.random.default_rng(4)
    record.tables["priors"] = priors(rows)
    config = SimpleNamespace(plant=PLANT.model_copy(update=truth))
    for session in calibrate_residual.residuals.sessions(record):
        drive = SimpleNamespace(driven=np.zeros(session.frames))
        codes = Toy().driven_codes(config, drive)
        for k, name in enumerate(("adc_xI", "adc_xQ", "adc_yI", "adc_yQ")):
            data = record.streams[name].data
            data[session.rows] = np.round(codes[:, k] + 30 * rng.normal(size=session.frames))
    return record


THREE = [
    ("plant.qx", PLANT.qx, 0.01 * PLANT.qx),
    ("plant.kxy_n_per_m", PLANT.kxy_n_per_m, 0.05 * PLANT.kxy_n_per_m),
]
BOTH = [*THREE, (SENSE, getattr(PLANT, SENSE[6:]), 1e-2 * getattr(PLANT, SENSE[6:]))]
BOTH = [*BOTH, (GAIN, getattr(PLANT, GAIN[6:]), 1e-2 * getattr(PLANT, GAIN[6:]))]


@pytest.fixture(scope="module")
def found(small):
    truth = {
        "qx": PLANT.qx * 1.007,
        "kxy_n_per_m": PLANT.kxy_n_per_m * 0.96,
        SENSE[6:]: getattr(PLANT, SENSE[6:]) * 1.01,
    }
    record = recorded(small, truth, BOTH)
    return truth, calibrate_residual.calibrate(record, starts=3, engine=Toy())


def test_planted_values_are_found_within_their_uncertainty(found):
    truth, result = found
    assert result.is_converged
    for key in ("plant.qx", "plant.kxy_n_per_m"):
        # 30 codes of noise on a channel of about 1.5e6, over two repeats of 400 frames
        sd = 30 / 1.5e6 / np.sqrt(800)
        assert abs(result.values[key] / truth[key[6:]] - 1) < 5 * sd
        assert result.sd[key] < 1e-4 * abs(result.values[key])


def test_the_starts_agree(found):
    assert len(found[1].costs) == 3
    assert max(found[1].costs) - min(found[1].costs) < calibrate_residual.AGREED


def test_a_product_is_seen_and_its_factors_are_not(found):
    truth, result = found
    gauge = result.directions[0]
    assert gauge.eigenvalue < calibrate_residual.UNSEEN < result.directions[1].eigenvalue
    assert {part for part in gauge.words.split() if part.startswith("plant.")} == {SENSE, GAIN}
    product = result.values[SENSE] * result.values[GAIN]
    assert product == pytest.approx(truth[SENSE[6:]] * getattr(PLANT, GAIN[6:]), rel=1e-4)
    # each factor keeps the width of a prior, shared between the two
    assert result.sd[SENSE] == pytest.approx(0.01 * result.values[SENSE] / np.sqrt(2), rel=0.05)


def test_the_calibrated_model_leaves_the_noise_on_what_it_has_not_fitted(found):
    before, after = (
        [row.chi2_per_bin for row in study.rows if row.role == "validate"]
        for study in (found[1].before, found[1].after)
    )
    assert min(before) > 100
    assert max(after) < 12
    assert np.median(after) < 4


def test_a_fit_that_may_not_step_is_not_called_converged(small, monkeypatch):
    monkeypatch.setattr(calibrate_residual, "MOST_ITERATIONS", 1)
    record = recorded(small, {"qx": PLANT.qx * 1.02}, THREE)
    assert not calibrate_residual.calibrate(record, starts=1, engine=Toy()).is_converged


def test_a_value_at_its_limit_is_named(small, monkeypatch):
    field = parameters.LIMITS["plant.qx"]
    monkeypatch.setitem(parameters.LIMITS, "plant.qx", field._replace(hi=PLANT.qx * 1.0001))
    record = recorded(small, {"qx": PLANT.qx * 1.02}, THREE)
    result = calibrate_residual.calibrate(record, starts=1, engine=Toy())
    assert not result.is_converged


@pytest.mark.parametrize(
    ("rows", "line"),
    [([("noise.seed", 1.0, 1.0)], "not a key of"), ([], "names no parameter")],
)
def test_what_cannot_be_fitted_is_refused(small, rows, line):
    record = copy.deepcopy(small)
    record.tables["priors"] = (
        priors(rows) if rows else {k: c._replace(data=c.data[:0]) for k, c in priors(THREE).items()}
    )
    with pytest.raises(ConfigError, match=line):
        parameters.read_parameters(record)


def test_coordinates_and_values_are_inverse(small):
    record = copy.deepcopy(small)
    record.tables["priors"] = priors(BOTH)
    for p in parameters.read_parameters(record):
        assert p.logarithmic == (p.key != "plant.kxy_n_per_m")
        assert p.value(0.0) == p.mean
        assert p.coordinate(p.value(0.37)) == pytest.approx(0.37, rel=1e-12)
        step = (p.value(1e-6) - p.value(-1e-6)) / 2e-6
        assert p.sd(0.0, 1.0) == pytest.approx(step, rel=1e-6)


@pytest.mark.slow
def test_the_frame_engine_is_calibrated_to_a_hidden_plant():
    truth = {"qx": PLANT.qx * 1.004, "kxy_n_per_m": PLANT.kxy_n_per_m * 1.02, "fx_hz": PLANT.fx_hz + 0.7}
    conditions = [
        {"id": "a", "rate_dps": 100.0, "seconds": 0.2, "settle_s": 0.1},
        {"id": "b", "rate_dps": -50.0, "from_dps": 60.0, "seconds": 0.2, "settle_s": 0.1, "role": "validate"},
    ]
    keys = {"fx_hz": 1.0, "qx": 0.01 * PLANT.qx, "kxy_n_per_m": 0.05 * PLANT.kxy_n_per_m}
    rows = [{"param": f"plant.{key}", "mean": getattr(PLANT, key), "sd": sd} for key, sd in keys.items()]
    tree = {"repeats": 3, "seed": 70, "condition": conditions, "prior": rows}
    record = produce.record(recording_plan.from_dict({**tree, "truth": {f"plant.{k}": v for k, v in truth.items()}}))
    assert "truth_sha256" in record.attrs
    assert str(truth["qx"]) not in record.config_toml
    result = calibrate_residual.calibrate(record, starts=1)
    assert result.decrement < calibrate_residual.CONVERGED
    for key in ("qx", "kxy_n_per_m"):
        assert abs(result.values[f"plant.{key}"] - truth[key]) < 4 * result.sd[f"plant.{key}"]
    # the formal sd of f_x, some 1e-8 Hz, is too small: converter steps and open-loop noise are not in it
    assert abs(result.values["plant.fx_hz"] - truth["fx_hz"]) < 1e-6
    held_out = [(a, b) for a, b in zip(result.before.rows, result.after.rows) if a.role == "validate"]
    assert all(b.rms < 0.01 * a.rms for a, b in held_out)
    assert np.median([b.chi2_per_bin for _, b in held_out]) < 8
