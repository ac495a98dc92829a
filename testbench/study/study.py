"""The study: predictions of all designs of a plan are written down, then its points are run, then both are compared.

    STORE/predictions/NAME-HASH.json    written once, before the first point; HASH is that of its predictions

The plan has an axis `design` of cases, the first of which all others are compared with, and an axis of noise seeds.
Source    docs/word_lengths.md
"""

import hashlib
import json
import math
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from testbench import config as configuration
from testbench.campaign import collect
from testbench.campaign.plan import plan as plans
from testbench.campaign.plan.plan_points import canonical
from testbench.campaign.store import Store
from testbench.errors import ConfigError
from testbench.storage import inputs
from testbench.storage.files import write_text
from testbench.study import cost, prediction
from testbench.study.points import BAND_HZ

AXES = ("seed", "design")
NUMBERS = (
    "locked",
    "density_lsb2_per_hz",
    "band_line_lsb",
    "noise_lsb",
    "bias_lsb",
    "scale_lsb_per_dps",
    "bandwidth_hz",
    "spur_dbc",
    "spur_harmonic",
)
TAU_S = prediction.TAU_S
# what "keeps the figures" means: at most so much more than the first design
KEEP_SHARE, KEEP_PPM, KEEP_HZ = 0.05, 100.0, 0.3


def read(path, sets=(), engine_options=()):
    """`Plan` of a study, as `campaign.plan.plan.read`; ConfigError for one without its two axes."""
    plan = plans.read(path, sets, engine_options)
    axes = {axis.name: axis for axis in plan.axes}
    if set(axes) != set(AXES) or not axes["design"].cases or list(axes["seed"].values) != ["noise.seed"]:
        raise ConfigError(
            f"{path}: a study needs exactly two axes: seed, with noise.seed alone, and design, with cases"
        )
    if TAU_S not in plan.keep.tau_s:
        raise ConfigError(f"{path}: [keep] tau_s = {list(plan.keep.tau_s)} lacks {TAU_S:g} s, which a study needs")
    return plan


def designs(plan):
    """{case: configuration}, with the first seed."""
    cases = next(axis for axis in plan.axes if axis.name == "design").cases
    out = {}
    for k, name in enumerate(cases):
        point_index = [k if axis.name == "design" else 0 for axis in plan.axes]
        out[name] = configuration.from_dict(plans.point_config_tree(plan, point_index)[0], f"{plan.source}: {name}")
    return out


class Written(NamedTuple):
    """Predictions as the store keeps them."""

    sha256: str
    utc: str
    designs: dict  # {case: {"predicted": {...}, "cost": {...}}}


def write_predictions(plan, store, progress=None):
    """`Written` predictions of a plan; what is there already stays, with its time."""
    out = {}
    for k, (name, config) in enumerate(designs(plan).items()):
        if progress:
            progress("predictions", k, 0)
        out[name] = {"predicted": prediction.predict(config)._asdict(), "cost": cost.design_cost(config)._asdict()}
    sha256 = hashlib.sha256(canonical(out).encode()).hexdigest()
    path = store.path / "predictions" / f"{plan.name}-{sha256[:16]}.json"
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        written = Written(sha256, datetime.now(UTC).isoformat(timespec="seconds"), out)
        write_text(path, json.dumps(written._asdict(), indent=1))
    return Written(**inputs.read_json(path))


class SimulatedDesign(NamedTuple):
    """What the runs of a design show, means over their seeds."""

    locked: int  # runs that end in lock
    runs: int
    arw_deg_per_rt_h: float
    arw_share: float  # standard error by the value
    arw_rise: float  # by that of the first design, same seeds
    band_line_dps: float  # largest spectral line in the band, left out of the ARW
    adev_deg_per_h: float
    adev_rise: float
    noise_lsb: float
    bias_dps: float
    scale_lsb_per_dps: float
    scale_ppm: float  # against the first design
    quadrature_dps: float
    bandwidth_hz: float
    bandwidth_moved_hz: float
    spur_dbc: float
    spur_harmonic: int

    @property
    def keeps(self):
        """Whether the figures are those of the first design."""
        steady = self.arw_rise <= KEEP_SHARE and self.adev_rise <= KEEP_SHARE
        is_response_close = abs(self.scale_ppm) <= KEEP_PPM and abs(self.bandwidth_moved_hz) <= KEEP_HZ
        return bool(self.locked == self.runs and steady and is_response_close)


def _columns(plan, store):
    """{case: {name: values over the seeds that are finished}}."""
    stored_plan = collect.read_stored_plan(store, plan.name)
    finished_points, _ = collect.load(store, stored_plan.addresses)
    names = [axis.name for axis in plan.axes]
    tau = list(plan.keep.tau_s).index(TAU_S)
    out = {case: [] for case in designs(plan)}
    for point_index, address in zip(np.ndindex(*plan.shape), stored_plan.addresses):
        if address in finished_points:
            one = finished_points[address]
            row = {name: float(one[name].data) for name in NUMBERS}
            row["adev"] = float(one["rate_word.adev"].data[tau])
            row["sense_cos"] = float(one["adc_sense_cos.mean"].data)
            row["seed"] = point_index[names.index("seed")]
            out[list(out)[point_index[names.index("design")]]].append(row)
    return {case: {key: np.array([row[key] for row in rows]) for key in rows[0]} for case, rows in out.items() if rows}


def simulated_designs(plan, store, predicted):
    """{case: SimulatedDesign} of the finished points; designs without one are left out."""
    columns = _columns(plan, store)
    first = next(iter(predicted))
    if first not in columns:
        raise ConfigError(f"{store.path}: no finished point of the first design, {first!r}")
    base, out = columns[first], {}
    for case, c in columns.items():
        scale = float(c["scale_lsb_per_dps"].mean())
        both, mine, its = np.intersect1d(c["seed"], base["seed"], return_indices=True)
        if not len(both):
            continue
        power = c["density_lsb2_per_hz"] / c["scale_lsb_per_dps"] ** 2
        of_base = base["density_lsb2_per_hz"] / base["scale_lsb_per_dps"] ** 2
        adev, adev_base = ((x["adev"] / x["scale_lsb_per_dps"]) ** 2 for x in (c, base))
        bins = (BAND_HZ[1] - BAND_HZ[0]) * next(iter(designs(plan).values())).scenario.seconds
        out[case] = SimulatedDesign(
            locked=int(c["locked"].sum()),
            runs=len(c["locked"]),
            arw_deg_per_rt_h=60 * math.sqrt(power.mean() / 2),
            arw_share=0.5 / math.sqrt(bins * len(power)),
            arw_rise=math.sqrt(power[mine].mean() / of_base[its].mean()) - 1,
            band_line_dps=float(np.median(c["band_line_lsb"])) / scale,
            adev_deg_per_h=3600 * math.sqrt(adev.mean()),
            adev_rise=math.sqrt(adev[mine].mean() / adev_base[its].mean()) - 1,
            noise_lsb=math.sqrt(float(np.mean(c["noise_lsb"] ** 2))),
            bias_dps=float(np.mean(c["bias_lsb"] / c["scale_lsb_per_dps"])),
            scale_lsb_per_dps=scale,
            scale_ppm=1e6 * float(np.mean(c["scale_lsb_per_dps"][mine] / base["scale_lsb_per_dps"][its] - 1)),
            quadrature_dps=float(c["sense_cos"].mean()) / predicted[case]["predicted"]["code_per_dps"],
            bandwidth_hz=float(c["bandwidth_hz"].mean()),
            bandwidth_moved_hz=float(np.mean(c["bandwidth_hz"][mine] - base["bandwidth_hz"][its])),
            spur_dbc=10 * math.log10(float(np.mean(10 ** (c["spur_dbc"] / 10)))),
            spur_harmonic=int(np.sort(c["spur_harmonic"])[len(c["spur_harmonic"]) // 2]),
        )
    return out


class Deviation(NamedTuple):
    """Run less prediction of a design: shares of the prediction, and dB."""

    arw: float
    noise: float
    spur_db: float


LIMITS = Deviation(arw=0.03, noise=0.10, spur_db=1.5)


def deviation(simulated_design, predicted):
    """`Deviation` of a design."""
    return Deviation(
        simulated_design.arw_deg_per_rt_h / predicted["arw_deg_per_rt_h"] - 1,
        simulated_design.noise_lsb / predicted["noise_lsb"] - 1,
        simulated_design.spur_dbc - predicted["spur_dbc"],
    )


def front(costs, losses):
    """Places of the designs that no other one beats in both, cheapest first; of equals the first."""
    order = sorted(range(len(costs)), key=lambda k: (costs[k], losses[k]))
    best, out = math.inf, []
    for k in order:
        if losses[k] < best:
            best = losses[k]
            out.append(k)
    return out


def first_start(store, plan):
    """UTC of the first start of a point of the plan, or '': the predictions are older."""
    plan_addresses = set(collect.read_stored_plan(store, plan.name).addresses)
    for event in store.events():
        if event.event == "start" and event.point in plan_addresses:
            return datetime.fromtimestamp(event.t, UTC).isoformat(timespec="seconds")
    return ""


class Result(NamedTuple):
    """A study as far as its points are finished."""

    name: str
    written: Written
    started_utc: str
    simulated_by_case: dict  # {case: SimulatedDesign}

    @property
    def rows(self):
        """(case, predicted, cost, SimulatedDesign, Deviation) of each design that has run."""
        for case, simulated in self.simulated_by_case.items():
            one = self.written.designs[case]
            yield case, one["predicted"], cost.Cost(**one["cost"]), simulated, deviation(simulated, one["predicted"])


def run(path, out, executor, progress, sets=(), engine_options=(), write_page=None, say=None):
    """Predict, run what is missing, compare: (`Result`, the campaign's report). As `campaign.execute.run`.

    write_page  (`Result`) -> path of its page, which is published with the campaign's results
    """
    from testbench.campaign import execute

    plan = read(path, sets, engine_options)
    plans.points(plan)  # refused before anything is written
    store = Store.open_folder(out, create=True)
    written = write_predictions(plan, store, say)
    study_results = []

    def compare():
        study_results.append(
            Result(plan.name, written, first_start(store, plan), simulated_designs(plan, store, written.designs))
        )
        return [write_page(study_results[0])] if write_page else []

    report = execute.run(plan, out, executor, progress, compare)
    return study_results[0], report
