"""Kinds of recordings of single parts, by their modules: what `gyro measured trace` and the page of all sets can open.

jobs    (paths) -> [(label, paths, options)]: which files of a set belong together
opener  (paths, options) -> `PartProblem`, or None if the content is not of this kind
report  (paths, options) -> (JSON, picture) of what is no problem of the core, or None
"""

from collections.abc import Callable
from typing import NamedTuple

from testbench.measured.parts import (
    adc_linearity,
    dac_levels,
    driven_resonator,
    gyro_stationary,
    paper,
    ringdown,
    swept_resonator,
    thermal_spectrum,
)


def reject_content(paths, options):
    """A kind without an opener or without a report of its own knows no content."""
    return None


class Kind(NamedTuple):
    """How files of one kind are found and opened."""

    jobs: Callable
    opener: Callable = reject_content
    report: Callable = reject_content


KINDS = (
    Kind(adc_linearity.jobs, adc_linearity.opener),
    Kind(dac_levels.jobs, dac_levels.opener),
    Kind(driven_resonator.jobs, driven_resonator.opener),
    Kind(gyro_stationary.jobs, gyro_stationary.opener),
    Kind(paper.jobs, report=paper.report),
    Kind(ringdown.jobs, ringdown.opener),
    Kind(swept_resonator.jobs, swept_resonator.opener),
    Kind(thermal_spectrum.jobs, thermal_spectrum.opener),
)


def first_not_none(optional_results):
    """The first that is not None, or None."""
    return next((x for x in optional_results if x is not None), None)
