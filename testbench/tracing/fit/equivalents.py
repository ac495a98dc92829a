"""Laws of the library that would do as well as one of those found: what exchanging the two costs, from one Gram matrix.

    chi2 = b_B' G_B^-1 b_B - b_S' G_S^-1 b_S      B: the laws found; S: B with one of them exchanged; < 0: fits better
The catalogue comes first, so such a law was never asked: the reader is told of it, the verdict stays.
Source    docs/tracing.md
"""

from testbench.tracing.fit.evidence import linear_fit
from testbench.tracing.fit.search import WORTH

AS_GOOD = 2 * WORTH  # chi2 that odds of 20 are worth


def exchanges(ranking, best, library, laws):
    """[{law, instead_of, chi2, value, unit}] below AS_GOOD, best first; `ranking` holds all of them at the base fit."""
    whole = linear_fit(ranking, best)
    if whole is None:
        return []
    rows = []
    for own in best:
        rest = [name for name in best if name != own]
        for other in library:
            if other in best or other not in ranking.names:
                continue
            found = linear_fit(ranking, (*rest, other))
            if found is None:
                continue
            chi2, value = whole[0] - found[0], float(found[1][-1])
            if chi2 < AS_GOOD and laws[other].sign * value >= 0:
                row = {"law": other, "instead_of": own, "chi2": chi2, "value": value}
                rows.append(row | {"unit": laws[other].unit})
    return sorted(rows, key=lambda row: (row["chi2"], row["law"]))
