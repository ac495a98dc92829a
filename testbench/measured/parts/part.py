"""What all measured parts share: segments with rows that set up local unknowns and rows that are scored.

A segment that is only judged still has unknowns of its own: initial state, level, place of the peak. They are fitted
inside `predict` on its `setup` rows, which are never scored; everything that the trace decides comes from elsewhere.

    fit        nuisances of the problem, scored rows
    validate   local unknowns from setup rows, coefficients of the laws from the fit; scored rows
    exam       as validate, but the trace never sees them: `exam()` swaps them in when all is decided
"""

import copy
from typing import NamedTuple

import numpy as np

from testbench.measured.models.part_problem import PartProblem
from testbench.tracing.problem.problem import Observable, PredictionFailed, Segment


class Piece(NamedTuple):
    """One segment: all measured rows in the observable's unit, which are scored, which set up; its noise."""

    name: str
    role: str  # fit, validate, exam
    rows: np.ndarray
    scored: np.ndarray  # indices
    setup: np.ndarray  # indices
    noise: object  # noise.Noise of all rows
    floor: float
    data: object  # whatever the model needs
    condition: dict


MEMBERS = "unit observable f_ref_hz working working_at all_pieces pieces notes exam abscissa where repeatability"


class Part(PartProblem, adds=f"{MEMBERS} nuisance_values model locate predict_rows simulate_data"):
    """Base of the problems of parts. A subclass gives `model` and `locate`."""

    unit, observable = "", "residual"
    heldout_by = "group"
    working = None  # working.Working

    def model(self, piece, values, effects, local):
        """All rows of a piece for nuisances {name: value}, laws {name: coefficient} and its local unknowns."""
        raise NotImplementedError

    def locate(self, piece, values, effects):
        """Local unknowns of a piece; None: it has none."""
        return None

    def working_at(self, values):
        """`Working` of the part at fitted nuisances {name: value}."""
        return self.working

    def __init__(self, name, nuisances, laws, pieces, hashes, notes=(), visible_role="validate"):
        self.name, self.nuisances, self.laws = name, tuple(nuisances), tuple(laws)
        self.all_pieces, self.hashes, self.notes = tuple(pieces), dict(hashes), tuple(notes)
        self._show(visible_role)

    def _show(self, visible_role):
        self.pieces = tuple(p for p in self.all_pieces if p.role in ("fit", visible_role))
        self._noises = tuple(p.noise.select_rows(p.scored) for p in self.pieces)
        self.segments = tuple(
            Segment(
                p.name,
                p.condition,
                p.name,
                0,
                "fit" if p.role == "fit" else "validate",
                (Observable(self.observable, self.unit, slice(0, len(p.scored))),),
            )
            for p in self.pieces
        )

    def exam(self):
        """The same problem with the segments that decide nothing in place of those that validate."""
        other = copy.copy(self)
        other.hashes = self.hashes | {"shown": "exam"}
        other._show("exam")
        return other

    def axis(self, segment, observable):
        """(abscissa of the scored rows, its label) of a segment, judged or examined."""
        piece = next(p for p in self.all_pieces if p.name == segment)
        x, label = self.abscissa(piece)
        return x[piece.scored], label

    def abscissa(self, piece):
        """(abscissa of all rows, its label)."""
        return np.arange(len(piece.rows)), "row"

    def where(self, piece, residual, values, laws):
        """{.., "words"}: where the rest (scored rows) of a piece sits, by a test of the part's own; None: no such."""
        return None

    def repeatability(self, values, laws):
        """{segment: rms of what its repeats do not share}, where the part has repeats that its noise does not tell."""
        return {}

    def observed_features(self, k):
        return self.pieces[k].rows[self.pieces[k].scored]

    def whiten(self, k, v):
        return self._noises[k].whiten(v)

    def noise_draw(self, k, rng):
        return self.noise_draws(k, 1, rng)[:, 0]

    def noise_draws(self, k, count, rng):
        return self._noises[k].draw_many(len(self.pieces[k].scored), count, rng)

    def repeatability_rms(self, k):
        return {self.observable: self.pieces[k].floor}

    def nuisance_values(self, theta):
        return dict(zip((n.name for n in self.nuisances), (float(t) for t in theta)))

    def predict(self, points, which):
        out = []
        for theta, effects in points:
            values, segment_predictions = self.nuisance_values(theta), []
            for k in which:
                piece = self.pieces[k]
                rows = self.predict_rows(piece, values, effects)[piece.scored]
                if not np.all(np.isfinite(rows)) or np.max(np.abs(rows)) > 1e3 * (np.max(np.abs(piece.rows)) + 1e-12):
                    raise PredictionFailed(f"{piece.name}: diverges")
                segment_predictions.append(rows)
            out.append(segment_predictions)
        return out

    def predict_rows(self, piece, values, effects):
        """All rows of a piece, its local unknowns fitted on its setup rows."""
        return self.model(piece, values, effects, self.locate(piece, values, effects))

    def simulate_data(self, theta, effects, rng):
        """The same experiment with data from the model: local unknowns as in the measured data, declared noise."""
        other, values = copy.copy(self), self.nuisance_values(theta)
        pieces = []
        for piece in self.all_pieces:
            clean = self.predict_rows(piece, values, effects)
            rows = clean + piece.noise.draw(len(clean), rng)
            pieces.append(piece._replace(rows=rows))
        other.all_pieces = tuple(pieces)
        other.hashes = self.hashes | {"simulated": str(rng.bit_generator.state["state"]["state"])}
        other._show("validate")
        return other
