"""Pictures of a design: plain results in, matplotlib figures 1200 pixels wide out.

Source  docs/design_of_loops.md
"""

from testbench.console.report import make_axes, name_axes
from testbench.paper.loop import loop_pictures


def margins(margin_map, design_point):
    """Gain and phase margin of a `MarginMap` side by side; `design_point` is (bandwidth, split) of the design."""
    figure, axes = make_axes("Margins of the best rate loop", 5.2, 1, 2)
    panels = ((margin_map.gain_db, "gain margin (dB)", 20), (margin_map.phase_deg, "phase margin (deg)", 90))
    for axis, (values, label, top) in zip(axes[0], panels):
        mesh = axis.pcolormesh(
            margin_map.bandwidth_hz, margin_map.split_hz, values, cmap="viridis", vmin=0, vmax=top, shading="nearest"
        )
        figure.colorbar(mesh, ax=axis, label=label)
        loop_pictures.on_log_plane(axis, design_point)
        name_axes(axis, "bandwidth (Hz)", "split (Hz)")
    return figure
