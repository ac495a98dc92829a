"""Tangents of a closed-loop problem: how its features change per unit of a nuisance or law.

    T = (mu(theta + s) - mu(theta - s)) / 2 s      averaged plant, same noise on both sides, steps s of about AIM
                                                   sigmas; to one side where a law has a sign
    even     re-timed reference edges slip at instants that any change moves: scatter of 3 to 25 % of what nuisances
             leave of a law. So references leave at any clock here, later by what an edge waits for the 1 MHz grid
    smooth   the drive's codes are not rounded: what a law does to the amplitude word would depend on the step
    held     the drive frequency is that of the base run; what its change does is put back by `slope`, 1 Hz per Hz
Source    docs/measured.md
"""

import numpy as np

from fpga_model.rates import MASTER_HZ, TICK_CYCLES
from testbench import config as configuration
from testbench.tracing.problem import PredictionFailed

EVEN_S = (TICK_CYCLES + 1) / 2 / MASTER_HZ  # 1 .. 26 clocks of waiting (fpga_model/references.py)
HELD_HZ = 1e-3  # of the drive frequency
AIM, NEAR = 300.0, 2.5  # sigmas by which a step moves all features together, and how far off it may be
SEEN = 10.0  # sigmas of all features together, that a law's largest step must move
LARGEST_SCALES = 1e4  # of a law of the grammar


def even(config):
    """A configuration whose references leave evenly, at the same mean phase."""
    if not config.firmware.reference_retimed:
        return config
    late = {"firmware.reference_retimed": False, "plant.sid_switch_s": config.plant.sid_switch_s + EVEN_S}
    return configuration.changed(config, late)


class Tangents:
    """{condition: change of the features per unit} of nuisances and laws of a `LoopProblem`, made when asked for."""

    def __init__(self, of):
        self.of, self.slope, self.kept = of, of.slope, of.kept.columns
        self.late = {law.name for law in of.library}
        # the same a few mHz further on
        self._where = of.key([c._replace(role="") for c in of.conditions.values()])
        self.kept[self._where, "plant.fx_hz"] = of.slope

    def column(self, name):
        """{condition: column}; nan where the plant fails. The library's are made together, when one is asked for."""
        if (self._where, name) not in self.kept:
            self.make([law.name for law in self.of.library] if name in self.late else [name])
        return self.kept[self._where, name]

    def make(self, names):
        """Columns of nuisances and laws that are not there yet."""
        of, columns = self.of, {}
        steps = {n.name: 0.1 * n.prior_sd for n in of.nuisances}
        steps |= {name: c.law.scale * (c.law.sign or 1) for name, c in of.candidates.items()}
        missing = [name for name in names if (self._where, name) not in self.kept]
        if not missing:
            return
        base, todo = self._many([(of.first, {})])[0], list(missing)
        self._guess(todo, steps, base)
        for _ in range(4):
            if not todo:
                break
            again = []
            for name, moved in zip(todo, self._held([self._stepped(name, steps[name]) for name in todo], base)):
                if moved is None:
                    steps[name] *= 0.03
                    again.append(name)
                    continue
                size = of.size(moved)
                # what the largest step hardly moves is noise, and no law that these data see
                seen = size >= SEEN or name not in of.candidates
                columns[name] = {g: v * (seen / steps[name]) for g, v in moved.items()}
                if not AIM / NEAR <= size <= AIM * NEAR and self._aimed(name, steps, size):
                    again.append(name)
            todo = again
        # to both sides where both are allowed: what is of second order in a law falls out
        both = [n for n, v in columns.items() if self._sided(n) and any(np.any(x) for x in v.values())]
        for name, moved in zip(both, self._held([self._stepped(n, -steps[n]) for n in both], base)):
            if moved is not None:
                columns[name] = {g: (v - moved[g] / steps[name]) / 2 for g, v in columns[name].items()}
        nan = {g: np.full(len(v), np.nan) for g, v in base.items()}
        for name in missing:
            self.kept[self._where, name] = columns.get(name, nan)

    def _guess(self, names, steps, base):
        """Steps that move all features by about AIM sigmas, from one condition alone. Mutates `steps`."""
        one = max(self.of.conditions.values(), key=lambda c: (c.a_um, abs(c.rate_dps)))
        moved = self._many([self._stepped(name, steps[name]) for name in names], only=(one,))
        for name, found in zip(names, moved):
            if found is not None:
                self._aimed(name, steps, self.of.size({one.id: found[one.id] - base[one.id]}) * np.sqrt(len(base)))

    def _aimed(self, name, steps, size):
        """True if a step that moves `size` sigmas could be changed so that it moves AIM. Mutates `steps`."""
        factor = np.clip(AIM / max(size, 1e-3), 1e-3, 100.0)
        if factor * abs(steps[name]) > self.largest(name):
            return False
        steps[name] *= factor
        return True

    def _sided(self, name):
        """True if steps to both sides are allowed."""
        return name not in self.of.candidates or not self.of.candidates[name].law.sign

    def largest(self, name):
        """How far a step may go: half the limit of a key."""
        if name in self.of.candidates:
            key = self.of.candidates[name].key
            if key:
                info = type(self.of.model.effects).model_fields[key.partition(".")[2]]
                return 0.5 * next(m.le for m in info.metadata if hasattr(m, "le"))
            return LARGEST_SCALES * self.of.candidates[name].law.scale
        n = next(n for n in self.of.nuisances if n.name == name)
        return 0.2 * max(abs(n.value), n.prior_sd)

    def _stepped(self, name, step):
        theta, effects = self.of.first.copy(), {}
        if name in self.of.candidates:
            effects[name] = step
        else:
            theta[[n.name for n in self.of.nuisances].index(name)] += step
        return theta, effects

    def _held(self, points, base):
        """Changes {group: values} from `base` to points, None where the averaged plant fails.

        The drive frequency is held, in two steps; what its change does is put back by `slope`.
        """
        hertz, changes = [dict.fromkeys(base, 0.0) for _ in points], [None] * len(points)
        todo = range(len(points))
        for _ in range(3):
            found = self._many([points[i] for i in todo], [hertz[i] for i in todo])
            left = []
            for i, moved in zip(todo, found):
                if moved is None:
                    changes[i] = None
                    continue
                rest = {g: moved[g] - base[g] for g in base}
                changes[i] = {g: v + self.slope[g] * hertz[i][g] for g, v in rest.items()}
                more = {g: self.of.hertz(v, g) for g, v in rest.items()}
                if max(map(abs, more.values())) > HELD_HZ:
                    hertz[i] = {g: hertz[i][g] + v for g, v in more.items()}
                    left.append(i)
            todo = left
        return changes

    def _many(self, points, hertz=None, only=None):
        """Features {group: values} of points in the averaged plant, None where it fails.

        hertz  see `of.smooth`;   only  conditions, if not all
        """
        of, models = self.of, []
        hertz = hertz or [dict.fromkeys(of.conditions, 0.0) for _ in points]
        for theta, effects in points:
            try:
                told = of.told(theta, effects)
                models.append(told._replace(config=even(told.config)))
            except PredictionFailed:
                models.append(None)
        every = only or of.conditions.values()
        wanted = [(m, c, 0, h[c.id]) for m, h in zip(models, hertz) if m is not None for c in every]
        found, out = iter(of.smooth(wanted)), []
        for m in models:
            values = None if m is None else {c.id: next(found) for c in every}
            out.append(None if values is None or any(v is None for v in values.values()) else values)
        return out
