"""All that the page of the paper needs, in stages; a stage that is finished is read from its file, not done again.

    calibration.json   the base board through the procedure, its cases; boards.json: random boards
    store/             five cases at three temperatures, a campaign
    law.json           scale factor over ye1, drive loop over xe1, shares of the noise
    record.json        phases over two hours

A stage's file names what it was made from: configuration, sizes and sources of the code. Kill it and start it again.
Source    docs/paper.md
"""

import hashlib
import json
import time
from pathlib import Path
from typing import NamedTuple

from testbench.campaign import collect, execute
from testbench.campaign.plan import plan
from testbench.storage.sources import code_sha256
from testbench.campaign.pool import Here, Pool
from testbench.campaign.store import Store
from testbench.paper import cases, law
from testbench.paper.calibration import calibrations
from testbench.paper.loop import sensitivity
from testbench.paper.measure import record_phases
from testbench.paper.measure.characterise import unflat
from testbench.storage.files import write_text


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
    engine: str | None = "baseband"  # of the calibration; None: that of the configuration


FULL = Size()
SMALL = Size(boards=0, rest_s=20.0, temperatures_degc=(25.0,), case_numbers=(1, 5), noise_s=0.0, record_s=0.0)


class Study:
    """Folder of a study, and its stages."""

    def __init__(self, config, directory, size=FULL, seed=4, workers=None, progress=None):
        self.config, self.directory, self.size, self.seed = config, Path(directory), size, seed
        self.workers, self.progress = workers, progress
        self.directory.mkdir(parents=True, exist_ok=True)
        self.seconds = {}

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
        if path.exists():
            kept = json.loads(path.read_text())
            if kept.get("made_from") == digest:
                self.seconds[name] = kept["seconds"]
                return kept["result"]
        began = time.monotonic()
        result = work()
        self.seconds[name] = time.monotonic() - began
        write_text(
            path, json.dumps({"made_from": digest, "seconds": self.seconds[name], "result": result}, default=float)
        )
        return json.loads(path.read_text())["result"]

    def calibration(self):
        """The base board, calibrated from words at zero, with the minimum of A_d beside the detuning."""
        return self._stage(
            "calibration",
            self.size.engine,
            lambda: calibrations.many(self.config, 1, None, 25.0, True, self.progress, self.size.engine)[0],
        )

    def boards(self):
        """Random boards, or none."""
        n = self.size.boards
        if not n:
            return []
        return self._stage(
            "boards",
            [n, self.seed, self.size.engine],
            lambda: calibrations.many(self.config, n, self.seed, progress=self.progress, engine=self.size.engine),
        )

    def cases_deg(self):
        """{case: {register: deg}} of the base board."""
        return self.calibration()["cases_deg"]

    def points(self, show=None):
        """{(case, temperature): numbers and curves} of the campaign, run where it is missing."""
        wanted = {str(k): self.cases_deg()[str(k)] for k in self.size.case_numbers}
        settings = [(f"plant.{k}", v) for k, v in self.config.plant.model_dump().items()
                    if v != type(self.config.plant)().model_dump()[k]]  # fmt: skip
        settings += [("noise.seed", self.config.noise.seed)]
        path = cases.write_plan(
            self.directory / "paper.toml", wanted, self.size.rest_s, self.size.temperatures_degc, settings
        )
        began = time.monotonic()
        told = plan.read(path)
        executor = Here() if self.workers == 0 else Pool(self.workers or 2)
        from testbench.campaign.progress import Progress

        report = execute.run(told, self.directory / "store", executor, show or Progress(quiet=True))
        self.seconds["campaign"] = time.monotonic() - began
        for address, text in report.failures:
            raise RuntimeError(f"campaign: point {address[:12]} failed: {text}")
        store = Store.at(self.directory / "store")
        found, _ = plan.points(told)
        out = {}
        order = [(case, temp) for case in wanted for temp in self.size.temperatures_degc]
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
