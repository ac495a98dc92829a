"""The one verdict: from the declared role of a number and the combined uncertainty, for every number alike.

    input            we put it in, and the model has it                  fitted      used to choose a default, and met
    predicted        neither, and the model meets it                     contradicted   the model does not meet it
    not comparable   the model has no such number, or it is not computed here

A number may say several things: it is met if each part is, and contradicted if one is.

    met              |model - paper| <= K sqrt(sigma_paper^2 + sigma_model^2); of a bound only the excess counts
    K = 2            the coverage factor of an expanded uncertainty, about 95 %

Source    JCGM 100:2008 (GUM), 6.2 and 6.3; docs/paper.md
"""

import math
from typing import NamedTuple

K, MOST_SIGMA = 2.0, 100.0
NOT_COMPUTED = "not computed here"
DUST = 1e-9  # below it a difference is rounding of the computation
INPUT, FITTED, PREDICTED, CONTRADICTED, NOT_COMPARABLE = VERDICTS = (
    "input",
    "fitted",
    "predicted",
    "contradicted",
    "not comparable",
)
ROLES = {"input": INPUT, "fitted": FITTED, "free": PREDICTED, "none": NOT_COMPARABLE}  # -> verdict if it is met


class Value(NamedTuple):
    """A number of the model with its standard uncertainty."""

    value: float
    sigma: float = 0.0


class Part(NamedTuple):
    """One thing that a number says, beside the model's; `bound`: "<" or ">" where the paper gives a limit."""

    what: str
    paper: float
    sigma: float | None
    model: Value | None
    bound: str = ""

    @property
    def pull(self):
        """Difference over combined uncertainty, 0 on the right side of a bound; None without a model's number."""
        if self.model is None:
            return None
        less = self.model.value - self.paper
        less = max(less, 0.0) if self.bound == "<" else min(less, 0.0) if self.bound == ">" else less
        both = math.hypot(self.sigma or 0.0, self.model.sigma)
        return 0.0 if not less else less / both if both else math.copysign(math.inf, less)


def worst(parts):
    """The part with the largest pull, or None."""
    return max((p for p in parts if p.pull is not None), key=lambda p: abs(p.pull), default=None)


def _value_sigma_text(value, sigma):
    text = f"{value:.5g}" if abs(value) > DUST else "0"
    return text + (f" +- {sigma:.2g}" if sigma else "")


def _text(part):
    """What was compared, and by how many sigma they differ."""
    paper = {"<": "below ", ">": "above "}.get(part.bound, "") + _value_sigma_text(part.paper, part.sigma)
    far = f"{part.pull:+.1f} sigma" if abs(part.pull) < MOST_SIGMA else f"beyond {MOST_SIGMA:g} sigma"
    if not part.sigma and not part.model.sigma:
        far = "different" if part.pull else "equal"
    outcome_text = "within the bound" if part.bound and not part.pull else far
    return f"{part.what}: model {_value_sigma_text(*part.model)}, paper {paper}: {outcome_text}"


def verdict(role, parts, absent=NOT_COMPUTED):
    """(verdict, basis) of a number.

    role    of `ROLES`, declared before
    parts   all that the number says
    absent  why a part has no number of the model
    """
    if role == "none":
        return NOT_COMPARABLE, absent
    most = worst(parts)
    if most and abs(most.pull) > K:
        return CONTRADICTED, _text(most) + {
            "fitted": ", although fitted to the paper",
            "input": ", set to another value",
        }.get(role, "")
    missing = [p.what for p in parts if p.model is None]
    if missing or not parts:
        return NOT_COMPARABLE, f"{absent}: {', '.join(missing[:4])}" if missing else absent
    if all(p.bound and not p.pull for p in parts):
        return ROLES[role], f"{len(parts)} of {len(parts)} within the bound"
    return ROLES[role], _text(most)
