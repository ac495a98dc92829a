"""All that the page of the paper needs, in stages; a stage that is finished is read from its file, not done again.

    calibration    the base board through the procedure, its cases; board_NN: random boards
    store/         five cases at three temperatures, a campaign
    law_*, noise_* scale factor over the sense phases, drive loop over xe1, V_q without a rail, shares of the noise
    record_N       phases of case N over two hours

Kill it and start it again; `lock` keeps a second process out.
Source    docs/paper.md
"""

import time
from pathlib import Path
from typing import NamedTuple

from testbench.campaign import collect, execute
from testbench.campaign.campaign_progress import Progress
from testbench.campaign.plan import plan
from testbench.campaign.pool import InProcessExecutor, Pool
from testbench.campaign.store import Store
from testbench.config.toml_text import short_toml
from testbench.errors import ConfigError, FileError
from testbench.paper import cases, phase_laws
from testbench.paper.calibration import calibration_boards, calibrations
from testbench.paper.loop import sensitivity
from testbench.paper.measure import record_phases
from testbench.paper.measure.characterise import choose_engine, decode_curves
from testbench.paper.stages import Job, Stages
from testbench.storage.files import explain, hold_lock

WORKERS = 2


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


def check(config):
    """ConfigError for a key that the study sets itself: of [scenario] and [output]; all others reach its runs."""
    for section in ("scenario", "output"):
        section_config = getattr(config, section)
        for key, value in type(section_config)():
            if getattr(section_config, key) != value:
                value_text = short_toml(getattr(section_config, key))
                raise ConfigError(
                    f"{section}.{key} = {value_text}: the study of the paper sets [{section}] itself; remove this "
                    f"key or set it to {short_toml(value)}, and use --rest-s, --record-s and --out"
                )


def _calibrate_base_board(config, engine):
    return calibrations.many(config, 1, None, 25.0, True, None, engine)[0]


def _board(config, seed, number, engine):
    return calibrations.one(calibration_boards.draw(config, seed, number), 25.0, False, lambda _: None, engine)


class Study:
    """Folder of a study, and its stages. Raises ConfigError as `check` does."""

    def __init__(self, config, directory, size=FULL, seed=4, workers=None, progress=None):
        check(config)
        self.config, self.directory, self.size, self.seed = config, Path(directory), size, seed
        self.workers = WORKERS if workers is None else workers
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise explain(self.directory, problem) from None
        self.stages = Stages(self.directory, config, self.workers, progress)

    def lock_folder(self):
        """Be the one process at work in the folder, or FileError that says who is; for `with`."""
        return hold_lock(self.directory / "lock", f"{self.directory}: another study is running in this folder")

    def run(self):
        """Do all stages, those that do not need each other at the same time; the longest begin first."""
        self.stages.results([self._calibration(), *self._boards()])
        self.stages.results([*self._record(), *self._law_jobs()])
        self.points()

    def _calibration(self):
        return Job("calibration", None, _calibrate_base_board, (self.config, choose_engine(self.config)))

    def calibration(self):
        """The base board, calibrated from words at zero, with the minimum of A_d beside the detuning."""
        return self.stages.results([self._calibration()])["calibration"]

    def _boards(self):
        shared_arguments = self.config, self.seed
        return [
            Job(f"board_{k:03d}", [self.seed, k], _board, (*shared_arguments, k, choose_engine(self.config)))
            for k in range(self.size.boards)
        ]

    def boards(self):
        """Random boards, or none."""
        return list(self.stages.results(self._boards()).values())

    def cases_deg(self):
        """{case: {register: deg}} of the base board."""
        return self.calibration()["cases_deg"]

    def plan(self):
        """`Plan` of the campaign: cases at temperatures, every other key as in the configuration."""
        words_by_case = {str(k): self.cases_deg()[str(k)] for k in self.size.case_numbers}
        sizes = self.size.rest_s, self.size.temperatures_degc
        return plan.read(cases.write_plan(self.directory / "paper.toml", self.config, words_by_case, *sizes))

    def points(self, show=None):
        """{(case, temperature): numbers and curves} of the campaign, run where it is missing."""
        began = time.monotonic()
        campaign_plan = self.plan()
        executor = Pool(self.workers) if self.workers else InProcessExecutor()
        report = execute.run(campaign_plan, self.directory / "store", executor, show or Progress(quiet=True))
        if report.done:
            self.stages.save_duration("campaign", time.monotonic() - began)
        for address, text in report.failures:
            raise FileError(f"{self.directory / 'store'}: point {address[:12]} failed: {text}")
        store = Store.open_folder(self.directory / "store")
        plan_points, _ = plan.points(campaign_plan)
        out = {}
        order = [(str(case), temp) for case in self.size.case_numbers for temp in self.size.temperatures_degc]
        for (case, temp), point in zip(order, plan_points):
            _, variables = collect.read_point(store, point.address)
            values = {}
            for name, variable in variables.items():
                data = variable.data
                values[name] = data.item() if hasattr(data, "item") and getattr(data, "ndim", 1) == 0 else data
            values = decode_curves({k: v.decode() if isinstance(v, bytes) else v for k, v in values.items()})
            out[case, temp] = values
        return out

    def _law_jobs(self):
        """Jobs of the laws by name; the shares of the noise last."""
        shared_arguments = self.config, self.cases_deg()
        jobs = [
            Job("law_scale", None, phase_laws.scale_law, shared_arguments),
            Job("law_sense", None, phase_laws.sense_law, shared_arguments),
            Job("law_drive", None, phase_laws.drive_law, shared_arguments),
            Job("law_rail", None, phase_laws.rail_law, shared_arguments),
        ]
        for name, length_s in self.noise_lengths_s().items():
            file = f"noise_{name.replace(', ', '_').replace(' ', '_')}"
            jobs.append(Job(file, length_s, phase_laws.measure_noise, (*shared_arguments, name, length_s)))
        return jobs

    def laws(self):
        """{"scale", "sense", "drive", "rail": rows of `phase_laws`, "noise": {set: numbers}, if there is any}."""
        result_by_job = self.stages.results(self._law_jobs())
        out = {name.removeprefix("law_"): rows for name, rows in result_by_job.items() if name.startswith("law_")}
        noise = [rows for name, rows in result_by_job.items() if name.startswith("noise_")]
        return out | ({"noise": dict(zip(self.noise_lengths_s(), noise))} if noise else {})

    def noise_lengths_s(self):
        """Flicker alone is five times as long: its floor shows only in averages of minutes."""
        s = self.size.noise_s
        return dict.fromkeys(phase_laws.NOISE_SETS, s) | {"only flicker": 5 * s} if s else {}

    def influence(self, config):
        """Sensitivity of what is seen to what is built: `sensitivity.rows`."""
        return sensitivity.rows(config)

    def _record(self):
        s = self.size
        sizes = s.record_s, s.warm_up_s, s.readings
        return [
            Job(f"record_{k}", sizes, record_phases.record, (self.config, self.cases_deg()[str(k)], *sizes))
            for k in (s.case_numbers if s.record_s else ())
        ]

    def record(self):
        """{case: rows of its phase record}, or none."""
        rows_by_job = self.stages.results(self._record())
        return {name.removeprefix("record_"): rows for name, rows in rows_by_job.items()}
