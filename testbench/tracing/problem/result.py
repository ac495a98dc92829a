"""The result of a trace, as one JSON object: plain numbers, null for what is not known, never NaN."""

import json
import math
from dataclasses import asdict, dataclass, field

import numpy as np


def plain_value(value):
    """Python numbers, lists and dicts of anything; what is not finite becomes None."""
    if isinstance(value, dict):
        return {str(k): plain_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, frozenset, set)):
        return [plain_value(v) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if isinstance(value, np.ndarray):
        return plain_value(value.tolist())
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value


@dataclass
class Result:
    """What `trace` has found; docs/tracing.md describes every key."""

    problem: str
    verdict: str
    sentence: str
    effects: list = field(default_factory=list)
    causes: list = field(default_factory=list)
    rivals: list = field(default_factory=list)
    unphysical: list = field(default_factory=list)
    heldout: dict = field(default_factory=dict)
    heldout_chi2: dict = field(default_factory=dict)
    p_global: float | None = None
    looks: dict = field(default_factory=dict)
    power_d90: dict = field(default_factory=dict)
    certificates: dict = field(default_factory=dict)
    hashes: dict = field(default_factory=dict)
    ranking: list = field(default_factory=list)
    models: list = field(default_factory=list)
    next_experiment: list = field(default_factory=list)
    alarms: dict = field(default_factory=dict)
    noise: dict = field(default_factory=dict)
    null: dict = field(default_factory=dict)
    identifiability: dict = field(default_factory=dict)
    nuisances: list = field(default_factory=list)
    unexplained: dict = field(default_factory=dict)
    discovery: dict = field(default_factory=dict)
    tables: dict = field(default_factory=dict)
    options: dict = field(default_factory=dict)
    notes: list = field(default_factory=list)

    def to_json(self):
        """Plain dictionary, ready for `json.dumps(..., allow_nan=False)`."""
        return plain_value(asdict(self))

    def text(self):
        return json.dumps(self.to_json(), indent=1, sort_keys=True, allow_nan=False) + "\n"
