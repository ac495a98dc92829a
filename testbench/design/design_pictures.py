"""Pictures of a design: plain results in, matplotlib figures 1200 pixels wide out.

Source  docs/design_of_loops.md
"""

from matplotlib.ticker import LogLocator, NullFormatter

from testbench.console.report import axes_of, name_axes


def margins(found, here):
    """Gain and phase margin of a `MarginMap` side by side; `here` is (bandwidth, split) of the design."""
    figure, axes = axes_of("Margins of the best rate loop", 5.2, 1, 2)
    shown = ((found.gain_db, "gain margin (dB)", 20), (found.phase_deg, "phase margin (deg)", 90))
    for axis, (values, label, top) in zip(axes[0], shown):
        axis.grid(False)
        axis.set_facecolor("#9a9a9a")
        mesh = axis.pcolormesh(
            found.bandwidth_hz, found.split_hz, values, cmap="viridis", vmin=0, vmax=top, shading="nearest"
        )
        figure.colorbar(mesh, ax=axis, label=label)
        axis.plot(*here, marker="*", color="white", markeredgecolor="black", markersize=16, linestyle="none")
        axis.set_xscale("log")
        axis.set_yscale("log")
        for ruler in (axis.xaxis, axis.yaxis):
            ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ruler.set_major_formatter("{x:g}")
            ruler.set_minor_formatter(NullFormatter())
        name_axes(axis, "bandwidth (Hz)", "split (Hz)")
    return figure
