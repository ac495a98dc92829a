"""Batches of predictions: asked for once, checked, kept; one bad point does not spoil the others of its batch."""

from collections import OrderedDict
from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError
from testbench.tracing.problem.problem import PredictionFailed
from testbench.tracing.problem.trace_checkpoint import Store, digest

MOST_CACHED_POINTS = 256  # points in memory


class Failed(NamedTuple):
    """In place of a prediction."""

    reason: str


class Predictor:
    """predict(points, which) of a problem with memory; `asked` counts points, found in the store or not."""

    def __init__(self, problem, store=None, progress=None):
        self.problem, self.store, self.progress = problem, store or Store(), progress
        self.asked, self.text = 0, "predicting"
        self._memory = OrderedDict()
        self._identity = digest(problem.name, problem.hashes)

    def _key(self, theta, effects, which):
        present = sorted((name, float(c).hex()) for name, c in effects.items() if c != 0.0)
        return digest(self._identity, [float(t).hex() for t in theta], present, list(which))

    def __call__(self, points, which):
        """List, per point, of arrays per segment of `which`, or of `Failed`."""
        which = tuple(int(k) for k in which)
        points = [(np.asarray(t, float), {n: float(c) for n, c in e.items() if c != 0.0}) for t, e in points]
        keys = [self._key(theta, effects, which) for theta, effects in points]
        self.asked += len(keys)
        for key in keys:
            if key not in self._memory:
                stored_prediction = self.store.load_arrays(key)
                if stored_prediction is not None:
                    self._cache_prediction(
                        key, Failed(stored_prediction) if isinstance(stored_prediction, str) else stored_prediction
                    )
        prediction_by_key = {key: self._memory[key] for key in keys if key in self._memory}
        missing = {key: point for key, point in zip(keys, points) if key not in prediction_by_key}
        if missing:
            if self.progress:
                self.progress(self.text, 0, len(missing))
            for key, result in zip(missing, self._compute(list(missing.values()), which)):
                self.store.save_arrays(key, result.reason if isinstance(result, Failed) else result)
                self._cache_prediction(key, result)
                prediction_by_key[key] = result
        return [prediction_by_key[key] for key in keys]

    def _cache_prediction(self, key, result):
        self._memory[key] = result
        while len(self._memory) > MOST_CACHED_POINTS:
            self._memory.popitem(last=False)

    def _compute(self, points, which):
        try:
            predictions = self.problem.predict(points, list(which))
        except PredictionFailed as problem:
            if len(points) == 1:
                return [Failed(str(problem) or "prediction failed")]
            return [self._compute([point], which)[0] for point in points]
        return [self._check_prediction(arrays, which) for arrays in predictions]

    def _check_prediction(self, arrays, which):
        arrays = [np.asarray(a, float) for a in arrays]
        for a, k in zip(arrays, which, strict=True):
            feature_shape = np.shape(self.problem.observed_features(k))
            if a.shape != feature_shape:
                name = self.problem.segments[k].name
                raise ConfigError(f"segment {name}: predicted {a.shape} features, measured {feature_shape}")
            if not np.all(np.isfinite(a)):
                return Failed("not finite")
        return arrays
