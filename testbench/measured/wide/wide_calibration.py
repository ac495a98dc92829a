"""Wide priors of a record: its own, those of a data sheet behind them, and the calibration that tracing begins from.

    priors = sheet   the tolerances of data_sheet.toml    priors = FILE   those of a file    none: the record's alone
A record whose priors are all narrow is left as it is.
Source    docs/wide_priors.md
"""

from pathlib import Path

from testbench.measured.residual import parameters
from testbench.measured.wide import data_sheet
from testbench.measured.wide.estimate import estimate


class Calibrated:
    """What `loop_record.open_record` asks: (model, parameters, lines), or None if nothing is wide."""

    def __init__(self, priors=None, progress=None):
        self.priors, self.progress = priors, progress

    def __call__(self, data, model, record, bench):
        declared = parameters.read_parameters(record) if len(record.tables["priors"]["param"].data) else ()
        if self.priors:
            path = data_sheet.BUNDLED_PATH if self.priors == data_sheet.BUNDLED_NAME else Path(self.priors)
            declared = data_sheet.parameters(model, data_sheet.read(path), declared)
        if not data_sheet.wide(declared):
            return (model, declared, ()) if self.priors else None
        board_estimate = estimate(data, model, declared, bench, self.progress)
        return board_estimate.config, board_estimate.parameters, board_estimate.lines()
