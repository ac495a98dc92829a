"""What a calibration from wide priors has fixed and what no record of the loop can fix, in lines for the report.

Source    docs/wide_priors.md
"""

from testbench.measured.closed_loop.loop_symmetries import MASS, MASS_EXPERIMENT, tied


def lines(estimate):
    """Lines on an `Estimate`: how it ended, what is not identifiable, the products that are, the experiment."""
    keys = [p.key for p in estimate.parameters]
    end = f"rms of the features {estimate.rms:.3g} sigmas" + ("" if estimate.converged else ", NOT converged")
    out = [f"wide priors: {len(keys)} parameters from the record itself, {end}"]
    out += [f"wide priors: {key} is at the edge of its prior" for key in estimate.at_wall]
    for s in tied(keys).values():
        out.append(
            f"not identifiable: {s.name} ({', '.join((s.held, *s.partners))}); identifiable: {'; '.join(s.products)}; "
            f"to fix it: {s.experiment}"
        )
    if tied(keys):
        out.append(f"not identifiable: {MASS}; to fix it: {MASS_EXPERIMENT}")
    return tuple(out)
