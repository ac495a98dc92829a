"""What may be hidden in a record, as texts for the second plant.

    inside   laws of catalogue and grammar, as the tracer lists them; the catalogue's from the equations of its pages
    outside  mechanisms of tests/sealed/plant/laws.h, which neither has
Source    docs/effects.md, docs/sealed.md
"""

import math
from typing import NamedTuple

from testbench.config import Config
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_laws

MASS_KG = 2.325e-7
K_VF_N_PER_V = 2.72e-7
# {name: laws with the coefficient left open, as the page of the effect states them}
CATALOGUE = {
    "duffing_k3_per_um2": (("force_x", -MASS_KG * (2 * math.pi * 11002.3) ** 2 * 1e12, "x^3"),),
    "drive_cubic_per_v2": (("force_x", K_VF_N_PER_V, "u^3"),),
    "feedthrough_y": (("cv_y", 1.0, "u"),),
    "feedthrough_x": (("cv_x", 1.0, "u"),),
    "damping_cubic": (("force_x", -1.0, "x^2 vx"),),
    "damping_quadratic": (("force_x", -1.0, "abs(vx) vx"),),
    "coulomb_friction": (("force_x", -1.0, "sgn(vx)"),),
    "pickoff_cubic_x": (("cv_x", 1.0, "cx^3"),),
    "damping_coupling": (("force_y", -1.0, "vx"),),
    "softening_drive": (("force_x", 1.0, "u^2 x"),),
    "centrifugal": (("force_x", MASS_KG, "rate^2 x"), ("force_y", MASS_KG, "rate^2 y")),
    "dispersive": (("force_y", -1.0, "x^2 y"), ("force_x", -1.0, "x y^2")),
    "quadrature_cubic": (("force_y", -1.0, "x^3"),),
    "bias_cubic": (("force_y", -1.0, "x^2 vx"),),
    "sense_cubic": (("force_y", 1.0, "w^3"),),
    "pickoff_drift": (("cv_x", 1.0, "temp cx"), ("cv_y", 1.0, "temp cy")),
    "carrier_beat": (("cv_y", 1.0, "cos(160.0) w"),),
    # 3 k 2 R C / tau of 10 kOhm, 159 nF and 10 s
    "sid_absorption": tuple(
        (f"cv_{a}", s * 3 * 2 * 10e3 * 159e-9 / 10.0, f"{f}c{a}")
        for a in "xy"
        for s, f in ((-1, ""), (1, "lag(10.0) "))
    ),
    "parasitic_mode": (("cv_y", 1.7772364912212181e-4, "w"),),
}


class Effect(NamedTuple):
    """Something to hide: `texts` are (kind, text with {} for a number, factor of the coefficient in it).

    key  a field of the plant instead, to whose value the coefficient is added
    """

    name: str
    texts: tuple
    first: float  # a coefficient to begin with
    sign: int = 0
    low: float = -math.inf
    high: float = math.inf
    same: str = ""
    key: str = ""

    def lines(self, value):
        """Lines of the plant's own text for a coefficient."""
        rows = [(kind, text.format(repr(float(factor * value)))) for kind, text, factor in self.texts]
        return "".join(f'{kind}.{n} = "{text}"\n' for n, (kind, text) in enumerate(rows, 1))

    def values(self, value, board):
        """{key: value} of a board's configuration for a coefficient; `board` has what differs from the default."""
        if not self.key:
            return {}
        default = getattr(Config().plant, self.key.removeprefix("plant."))
        return {self.key: board.get(self.key, default) + value}


def inside():
    """`Effect`s of catalogue and grammar; ConfigError for one that `CATALOGUE` lacks."""
    out = []
    for c in (*loop_laws.from_catalogue(), *loop_laws.from_grammar()):
        rows = CATALOGUE.get(c.law.name) or (((c.port, 1.0, c.factors),) if c.factors else ())
        key = c.key if c.key.startswith("plant.") else ""
        if not (rows or key):
            raise ConfigError(f"tests/sealed/effects.py: CATALOGUE lacks {c.law.name}, which the tracer may name")
        texts = tuple(("law", f"{port} = {{}} {factors}", factor) for port, factor, factors in rows)
        law = c.law
        out.append(Effect(law.name, texts, law.scale, law.sign, law.low, law.high, law.same, key))
    return tuple(out)


def outside(rows):
    """`Effect`s of [outside] of the strata; ConfigError for one that the grammar has."""
    known = {text for effect in inside() for _, text, _ in effect.texts}
    out = []
    for name, (text, first) in rows.items():
        kind, _, rest = text.partition(" ")
        if rest in known:
            raise ConfigError(f"strata: outside.{name} = {rest} is a law of catalogue or grammar")
        out.append(Effect(f"outside.{name}", ((kind, rest, 1.0),), first))
    return tuple(out)
