"""Telling rivals apart when none of them is the whole truth: evidence would be far too sure of itself then.

    l_b = sum over block b of (z_rival^2 - z_best^2) / 2        V = sum l_b / (sd(l_b) sqrt(B))
New data confirm a change D of a fixed prediction by their projection on it: D'z / |D| is normal if D is nothing.
V is about normal if both are equally near to the truth, whatever that is; below CLEAR the two are confounded.
Source    Vuong, Econometrica 57 (1989); docs/tracing.md
"""

import numpy as np

CLEAR = 2.326  # one-sided 1 %
LEAST_BLOCKS = 24


def _parts(space):
    """Rows of LEAST_BLOCKS blocks or more."""
    parts = max(1, -(-LEAST_BLOCKS // max(len(space.blocks), 1)))
    for block in space.blocks:
        rows = np.arange(block.rows.start, block.rows.stop)
        yield from np.array_split(rows, min(parts, len(rows)))


def vuong(best, rival):
    """V of two fits on the same space: how clearly `best` is nearer to the truth."""
    difference = (rival.z**2 - best.z**2) / 2
    sums = [float(difference[part].sum()) for part in _parts(best.model.space)]
    spread = float(np.std(sums, ddof=1)) if len(sums) > 1 else 0.0
    return float(np.sum(sums) / (spread * np.sqrt(len(sums)))) if spread > 0 else 0.0


def confirmation(space, before, after):
    """How many sigmas of the predicted change new data show; 0 if they do not fit better with it.

    before, after  whitened residuals of data that neither fit has seen
    """
    change = before - after
    if not change.any() or after @ after >= before @ before:
        return 0.0
    return float(change @ before / np.linalg.norm(change) / change_noise_sd(space, change, after))


def change_noise_sd(space, change, after):
    """Noise along a change, in units of the declared one: 1, or the blocks' own scatter about it if that is larger.

    So it is not too small in a noise that is slower or larger than declared.
    """
    scatter = np.sqrt(sum(float(change[part] @ after[part]) ** 2 for part in _parts(space)))
    return max(1.0, float(scatter / np.linalg.norm(change)))


def open_rivals(search_result):
    """[(law of the best set, rival set, V)] that the data do not rule out although the model is not adequate."""
    if not search_result.best:
        return []
    best, out = search_result.fit(search_result.best), []
    for names, c in search_result.candidates.items():
        if c.refitted and len(names) == len(search_result.best) and names != search_result.best:
            v = vuong(best, c.fit)
            if v < CLEAR:
                out += [(law, names, v) for law in search_result.best if law not in names]
    return sorted(out, key=lambda row: (row[2], row[1]))
