"""A study that is small enough to be killed often: python -m tests.testbench.paper.killed_study FOLDER.

Stages, campaign, page and files are those of `gyro report paper`; the calibration is the budget, each law has few
angles.
"""

import sys

from testbench.config import Config
from testbench.paper import closed_form, page, paper_study, phase_laws
from testbench.paper.calibration.calibrate_phases import NODES
from testbench.paper.loop import sensitivity
from testbench.paper.stages import Job
from testbench.run.budget import budget


def calibrated(config):
    """As `calibrations.one`, with what the budget says instead of readings."""
    model, small = closed_form.model(config), dict.fromkeys(NODES, 0.001)
    loop = budget(closed_form.bare(config), 25.0).loop_deg()
    return {
        "found_deg": {n: loop.get(n, model.node_deg[n].value) for n in NODES},
        "cases_deg": closed_form.cases_deg(config),
        "seen": {},
        **dict.fromkeys(("found_uncertainty_deg", "second_pass_deg", "residual_deg", "uncertainty_deg"), small),
    }


class Small(paper_study.Study):
    """Cases 1 and 5 at 25 degC for 10 s; few angles of each law, few parameters of the influence."""

    def _calibration(self):
        return Job("calibration", None, calibrated, (self.config,))

    def _law_jobs(self):
        given, cases_deg = self.config, self.cases_deg()
        two = {case: cases_deg[case] for case in ("1", "5")}
        return [
            Job("law_scale", None, phase_laws.scale_law, (given, two, (0.0, 9.0))),
            Job("law_sense", None, phase_laws.sense_law, (given, two, ((0.0, 9.0), (0.0,)))),
            Job("law_drive", None, phase_laws.drive_law, (given, two, (0.0, 9.0))),
            Job("law_rail", None, phase_laws.rail_law, (given, cases_deg)),
        ]

    def influence(self, config):
        return sensitivity.rows(config, sensitivity.PARAMETERS[:2])


def main():
    job = Small(Config(), sys.argv[1], paper_study.SMALL._replace(rest_s=10.0))
    with job.lock_folder():
        job.run()
        page.write(job)


if __name__ == "__main__":
    main()
