"""All that the page of the paper needs, in stages; a stage that is finished is read from its file, not done again.

    calibration.json   the base board through the procedure, its cases; boards.json: random boards
    store/             five cases at three temperatures, a campaign
    law.json           scale factor over ye1, drive loop over xe1, shares of the noise
    record.json        phases over two hours

A stage's file names what it was made from: configuration, sizes and sources of the code, and has the SHA-256 of its
result. A damaged one is done again. Kill it and start it again; `lock` keeps a second process out.
Source    docs/paper.md
"""

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from testbench.campaign import collect, execute
from testbench.campaign.plan import plan
from testbench.campaign.pool import Here, Pool
from testbench.campaign.store import Store
from testbench.config.toml_text import toml_of
from testbench.errors import ConfigError, FileError
from testbench.paper import cases, law
from testbench.paper.calibration import calibrations
from testbench.paper.loop import sensitivity
from testbench.paper.measure import record_phases
from testbench.paper.measure.characterise import engine_of, unflat
from testbench.storage import inputs, lock
from testbench.storage.files import explain, write_text
from testbench.storage.sources import code_sha256


class Size(NamedTuple):
    """How much is done."""

    boards: int = 20
    rest_s: float = 600.0
    temperatures_degc: tuple = cases.TEMPERATURES_DEGC
    case_numbers: tuple = cases.CASES
    noise_s: float = 200.0
    record_s: float = record_phases.RECORD_S
    warm_up_s: float = record_phases.WARM_UP_S
    readings: int = 12


FULL = Size()
SMALL = Size(boards=0, rest_s=20.0, temperatures_degc=(25.0,), case_numbers=(1, 5), noise_s=0.0, record_s=0.0)


@dataclass
class Kept:
    """The file of a stage: what it was made from, how long it took, the result and its SHA-256."""

    made_from: str
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    result: Any
    sha256: str


def _sha256(result):
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()


def _kept(path):
    """`Kept` stage; None if there is none, or if it is damaged: then it is done again."""
    try:
        kept = inputs.read_json(path, Kept, inputs.most_bytes())
        return kept if kept.sha256 == _sha256(kept.result) else None
    except FileError:
        return None


def check(config):
    """ConfigError for a key that the study sets itself: of [scenario] and [output]; all others reach its runs."""
    for section in ("scenario", "output"):
        given = getattr(config, section)
        for key, value in type(given)():
            if getattr(given, key) != value:
                said = toml_of(getattr(given, key))
                raise ConfigError(
                    f"{section}.{key} = {said}: the study of the paper sets [{section}] itself; leave it out or at "
                    f"{toml_of(value)}; --rest-s, --record-s and --out are its options"
                )


class Study:
    """Folder of a study, and its stages. Raises ConfigError as `check` does."""

    def __init__(self, config, directory, size=FULL, seed=4, workers=None, progress=None):
        check(config)
        self.config, self.directory, self.size, self.seed = config, Path(directory), size, seed
        self.workers, self.progress = workers, progress
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise explain(self.directory, problem) from None
        self.seconds = {}

    def alone(self):
        """Be the one process at work in the folder, or FileError that says who is; for `with`."""
        return lock.alone(self.directory / "lock", f"{self.directory}: another study is at work here")

    def _stage(self, name, key, work):
        """Result of a stage: from its file if that was made from the same things."""
        text = json.dumps(
            [
                key,
                self.config.model_dump(),
                code_sha256(
                    "testbench.paper.calibration.calibrations",
                    "testbench.paper.law",
                    "testbench.paper.measure.record_phases",
                    "testbench.run.simulate",
                ),
            ],
            sort_keys=True,
            default=str,
        )
        digest = hashlib.sha256(text.encode()).hexdigest()
        path = self.directory / f"{name}.json"
        kept = _kept(path)
        if kept is None or kept.made_from != digest:
            began = time.monotonic()
            result = json.loads(json.dumps(work(), default=float))
            kept = Kept(digest, time.monotonic() - began, result, _sha256(result))
            write_text(path, json.dumps(vars(kept)))
        self.seconds[name] = kept.seconds
        return kept.result

    def calibration(self):
        """The base board, calibrated from words at zero, with the minimum of A_d beside the detuning."""
        return self._stage(
            "calibration",
            None,
            lambda: calibrations.many(self.config, 1, None, 25.0, True, self.progress, engine_of(self.config))[0],
        )

    def boards(self):
        """Random boards, or none."""
        n = self.size.boards
        if not n:
            return []
        return self._stage(
            "boards",
            [n, self.seed],
            lambda: calibrations.many(self.config, n, self.seed, progress=self.progress, engine=engine_of(self.config)),
        )

    def cases_deg(self):
        """{case: {register: deg}} of the base board."""
        return self.calibration()["cases_deg"]

    def plan(self):
        """`Plan` of the campaign: cases at temperatures, every other key as in the configuration."""
        wanted = {str(k): self.cases_deg()[str(k)] for k in self.size.case_numbers}
        sizes = self.size.rest_s, self.size.temperatures_degc
        return plan.read(cases.write_plan(self.directory / "paper.toml", self.config, wanted, *sizes))

    def points(self, show=None):
        """{(case, temperature): numbers and curves} of the campaign, run where it is missing."""
        began = time.monotonic()
        told = self.plan()
        executor = Here() if self.workers == 0 else Pool(self.workers or 2)
        from testbench.campaign.progress import Progress

        report = execute.run(told, self.directory / "store", executor, show or Progress(quiet=True))
        self.seconds["campaign"] = time.monotonic() - began
        for address, text in report.failures:
            raise FileError(f"{self.directory / 'store'}: point {address[:12]} failed: {text}")
        store = Store.at(self.directory / "store")
        found, _ = plan.points(told)
        out = {}
        order = [(str(case), temp) for case in self.size.case_numbers for temp in self.size.temperatures_degc]
        for (case, temp), point in zip(order, found):
            _, variables = collect.read_point(store, point.address)
            values = {}
            for name, variable in variables.items():
                data = variable.data
                values[name] = data.item() if hasattr(data, "item") and getattr(data, "ndim", 1) == 0 else data
            values = unflat({k: v.decode() if isinstance(v, bytes) else v for k, v in values.items()})
            out[case, temp] = values
        return out

    def laws(self):
        """Scale-factor law, drive law, shares of the noise."""

        def work():
            wanted = self.cases_deg()
            out = {"scale": law.scale_law(self.config, wanted), "drive": law.drive_law(self.config, wanted)}
            unit = next(row for row in out["scale"] if row["name"] == "case 5")["lsb_per_dps"]
            if self.size.noise_s:
                out["noise"] = law.noise_law(self.config, wanted, self._noise_lengths_s(), unit)
            return out

        return self._stage("law", self.size.noise_s, work)

    def _noise_lengths_s(self):
        """Flicker alone is five times as long: its floor shows only in averages of minutes."""
        s = self.size.noise_s
        return dict.fromkeys(law.NOISE_SETS, s) | {"only flicker": 5 * s}

    def influence(self, config):
        """Sensitivity of what is seen to what is built: `sensitivity.rows`."""
        return sensitivity.rows(config)

    def record(self):
        """Phase records of case 1 and case 5, or none."""
        s = self.size
        if not s.record_s:
            return {}

        def work():
            wanted = self.cases_deg()
            return {
                case: record_phases.record(
                    self.config, wanted[case], s.record_s, s.warm_up_s, s.readings, self.progress
                )
                for case in ("1", "5")
            }

        return self._stage("record", [s.record_s, s.warm_up_s, s.readings], work)
