"""Which samples of a driven record fit, validate and examine. A published record has its official split, by its bytes.

Half open, from 0. Test samples decide nothing. Another record is split in time: 60 % fit, 20 % validate, 20 % exam.
Source    nonlinearbenchmark.org/benchmarks/silverbox (package nonlinear_benchmarks)
"""

from typing import NamedTuple

SETUP = 50  # first outputs of a stretch: they set up its initial state and are not scored


class Split(NamedTuple):
    """Stretches (first, end) by name."""

    fit: dict
    validate: dict
    exam: dict


OFFICIAL = {
    "5c7413a52255af0cb4e2f93fb6903beb92b08965ba1e6ad0a6ffedfed8477ed4": Split(
        fit={"train": (40650, 57538)},
        validate={"validation": (92690, 105712)},
        exam={
            "multisine": (105712, 127400),
            "arrow_full": (100, 40575),
            "arrow_no_extrapolation": (100, 32100),
        },
    )
}


def split(sha256, samples):
    """`Split` of a record of so many samples."""
    if sha256 in OFFICIAL:
        return OFFICIAL[sha256]
    a, b = (6 * samples) // 10, (8 * samples) // 10
    return Split({"first": (0, a)}, {"then": (a, b)}, {"last": (b, samples)})
