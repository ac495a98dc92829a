"""Where a part was driven when it was recorded: what carries a law of one part over to another."""

from typing import NamedTuple


class Working(NamedTuple):
    """Where a part was driven: kind of its problem, largest amplitude (V, sqrt(uW) or share of full response), f, Q."""

    kind: str
    amplitude: float
    f_hz: float
    q: float
