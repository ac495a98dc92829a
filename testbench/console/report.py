"""Pictures and the HTML report of a run.

Each picture is a function of plain arrays that returns a matplotlib Figure 1200 pixels wide; `save` writes it whole or
not at all. Colours are Okabe and Ito's, which people with colour-blindness tell apart; line styles differ as well.
The HTML report is one file without scripts or network: pictures inside, tables from `tables`, light or dark.
Source  docs/record.md
"""

import base64
import html
import io
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from testbench.storage.files import write_bytes, write_text
from testbench.version import VERSION

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#666666",
)
CYCLE = (BLUE, VERMILION, GREEN, PURPLE)
STYLES = ("-", "--", "-.", ":")
DPI = 100
WIDTH_IN = 12.0
FONT = {"title": 15, "label": 13, "tick": 12, "small": 11}
VISIBLE = 0.02  # share of the largest amplitude below which a phase means nothing


def plain_axes(axes):
    """Axes with a light grid behind the data and no frame above and at the right."""
    for axis in axes:
        axis.grid(True, color="#dddddd", linewidth=0.8)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)


def make_axes(title, height_in, rows=1, columns=1, **grid):
    """(figure, axes) 1200 pixels wide, axes as an array of rows and columns."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, **grid)
    figure.suptitle(title, fontsize=FONT["title"], x=0.01, ha="left", fontweight="bold")
    plain_axes(axes.flat)
    for axis in axes.flat:
        axis.tick_params(labelsize=FONT["tick"])
    return figure, axes


def _figure(height_in, rows=1, title="", **grid):
    figure, axes = make_axes(title, height_in, rows, **grid)
    return figure, axes[:, 0]


def name_axes(axis, x="", y="", legend=None):
    """Names of both axes, and the legend at a place."""
    axis.set_xlabel(x, fontsize=FONT["label"])
    axis.set_ylabel(y, fontsize=FONT["label"])
    if legend:
        axis.legend(loc=legend, fontsize=FONT["small"], frameon=False)


def _note(axis, text, at, offset, color, **more):
    """A text beside a point, `offset` typographic points away."""
    axis.annotate(text, at, xytext=offset, textcoords="offset points", fontsize=FONT["small"], color=color, **more)


def save(figure, path):
    """Write a figure as PNG."""
    write_bytes(path, png_bytes(figure))
    return Path(path)


def png_bytes(figure, dpi=DPI):
    """PNG of a figure that is laid out and drawn once; `savefig` does both twice."""
    figure.set_dpi(dpi)
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def startup(
    time_s, amplitude_um, phase_deg, frequency_error_hz, state, state_names, lock_time_s=None, setpoint_um=None
):
    """Power-on to lock: amplitude, phase of the displacement, error of the DDS frequency, state of the sequencer.

    time_s              time from power-on, one value per row
    phase_deg           drive phase error (degrees)
    frequency_error_hz  DDS frequency less the plant's lock frequency
    state, state_names  sequencer state and the texts of its values
    """
    figure, axes = _figure(10.0, 4, "Start-up to lock", sharex=True, height_ratios=(3, 2, 2, 3))
    time_s, state = np.asarray(time_s), np.asarray(state)
    axes[0].plot(time_s, amplitude_um, color=BLUE, linewidth=1.6, label="amplitude")
    if setpoint_um is not None:
        axes[0].axhline(
            setpoint_um, color=VERMILION, linestyle="--", linewidth=1.3, label=f"set-point {setpoint_um:g} um"
        )
    axes[0].set_ylim(bottom=0)
    name_axes(axes[0], y="|x| (um)", legend="lower right")
    amplitude_um = np.asarray(amplitude_um, float)
    phase_deg = np.where(amplitude_um > VISIBLE * np.nanmax(amplitude_um), phase_deg, np.nan)
    axes[1].plot(time_s, phase_deg, color=BLUE, linewidth=1.2)
    name_axes(axes[1], y="phase error (deg)")
    _focus(axes[1], phase_deg, 20.0)
    axes[2].plot(time_s, frequency_error_hz, color=BLUE, linewidth=1.2)
    name_axes(axes[2], y="frequency\nerror (Hz)")
    _focus(axes[2], frequency_error_hz, 5.0)
    axes[3].step(time_s, state, where="post", color=BLUE, linewidth=1.6)
    used = [value for value in range(len(state_names)) if np.any(state == value)]
    axes[3].set_yticks(used, [state_names[value] for value in used])
    axes[3].tick_params(axis="y", labelsize=FONT["small"])
    name_axes(axes[3], x="time from power-on (s)", y="state")
    if lock_time_s is not None:
        for axis in axes:
            axis.axvline(lock_time_s, color=GREEN, linestyle="-.", linewidth=1.4)
        note_options = {"xycoords": ("data", "axes fraction")}
        _note(axes[0], f"lock, {lock_time_s:.3f} s", (lock_time_s, 0.03), (6, 0), GREEN, **note_options)
    axes[0].set_xlim(time_s[0], time_s[-1])
    figure.align_ylabels()
    return figure


def _focus(axis, values, floor):
    """Limits that show the last half well: outliers of the search may leave the picture."""
    values = np.asarray(values, float)
    finite = values[np.isfinite(values)]
    if finite.size:
        reach = max(np.max(np.abs(finite[finite.size // 2 :])) * 1.2, min(np.max(np.abs(finite)) * 1.1, floor))
        if reach > 0:
            axis.set_ylim(-reach, reach)


def spectrum_dbfs(codes, bits):
    """Amplitude spectrum in dB of a full-scale sine, and the resolution bandwidth factor in bins.

    Blackman-Harris window, so that a line off the grid leaks less than -92 dB.
    """
    codes = np.asarray(codes, float)
    count = len(codes)
    phase = 2 * np.pi * np.arange(count) / count
    window = 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
    lines = np.abs(np.fft.rfft((codes - codes.mean()) * window)) * 2 / window.sum() / (1 << (bits - 1))
    return 20 * np.log10(np.maximum(lines, 1e-12)), count * np.sum(window**2) / np.sum(window) ** 2


def _thin(frequency_hz, level_db, per_decade=300):
    """The highest level in each of equal steps of the logarithm of frequency."""
    points = 1 + int(per_decade * np.log10(frequency_hz[-1] / frequency_hz[0]))
    edges = np.geomspace(frequency_hz[0], frequency_hz[-1] * (1 + 1e-12), points + 1)
    slot = np.searchsorted(edges, frequency_hz, side="right") - 1
    first = np.flatnonzero(np.diff(slot, prepend=-1))
    return frequency_hz[first], np.maximum.reduceat(level_db, first)


def spectra(outputs, rate_hz, images=3):
    """Spectra of DAC outputs, one panel each, with the images that the hold leaves marked.

    outputs  name -> (codes, bits); equidistant codes at `rate_hz`
    images   multiples of the update rate whose images are drawn
    """
    figure, axes = _figure(4.2 * len(outputs) + 0.6, len(outputs), "Spectra of the DAC outputs", sharex=True)
    for axis, (name, (codes, bits)) in zip(axes, outputs.items()):
        level, width = spectrum_dbfs(codes, bits)
        step_hz = rate_hz / len(codes)
        frequency = np.arange(len(level)) * step_hz
        axis.plot(*_thin(frequency[4:], level[4:]), color=BLUE, linewidth=0.9, label="codes")
        peak = 4 + int(np.argmax(level[4:]))
        # the hold repeats the spectrum around k times the rate, weighted by its sinc
        dbfs = np.concatenate([level[1:], level[-2::-1]] * (images + 1))[: (2 * images + 1) * len(codes) // 2]
        hz = np.arange(1, len(dbfs) + 1) * step_hz
        dbfs = dbfs + 20 * np.log10(np.maximum(np.abs(np.sinc(hz / rate_hz)), 1e-12))
        image = hz > rate_hz / 2
        axis.plot(*_thin(hz[image], dbfs[image]), color=ORANGE, linewidth=0.9, label="images of the hold")
        line_hz = frequency[peak]
        sizes = [level[peak] + 20 * np.log10(line_hz / (k * rate_hz)) for k in range(1, images + 1)]
        centres = np.arange(1, images + 1) * rate_hz
        axis.plot(centres, sizes, marker="v", color=VERMILION, markersize=7, linestyle="none")
        sized = ", ".join(f"{size:.1f}" for size in sizes)
        text = f"images at k x {rate_hz / 1e6:g} MHz +- {line_hz / 1e3:.1f} kHz:\n{sized} dBFS"
        _note(axis, text, (centres[0], sizes[0]), (-8, 4), VERMILION, ha="right")
        text = f"{line_hz:.0f} Hz, {level[peak]:.1f} dBFS"
        _note(axis, text, (line_hz, level[peak]), (-10, -4), BLUE, ha="right")
        axis.set_xscale("log")
        axis.set_title(f"{name}, resolution {width * step_hz:.3g} Hz", fontsize=FONT["label"], loc="left")
        low = np.percentile(level[4:], 5)
        axis.set_ylim(max(low - 15, -220), max(10, level[peak] + 15))
        name_axes(axis, y="level (dBFS)", legend="upper left")
    axes[-1].set_xlim(left=frequency[4])
    name_axes(axes[-1], x="frequency (Hz)", y="level (dBFS)")
    return figure


def jitter(edges_ns, grid_ns=None):
    """Histogram of the reference edges' errors against the ideal zero crossing.

    edges_ns  name -> errors (ns, late is positive)
    grid_ns   grid that the edges sit on, for the title
    """
    on_grid = f" (edges on a {grid_ns:g} ns grid)" if grid_ns else ""
    figure, (axis,) = _figure(6.0, 1, f"Jitter of the reference edges{on_grid}")
    low = min(np.min(errors) for errors in edges_ns.values())
    high = max(np.max(errors) for errors in edges_ns.values())
    margin = max(0.02 * (high - low), 0.5)
    bins = np.linspace(low - margin, high + margin, 101)
    for k, (name, errors) in enumerate(edges_ns.items()):
        errors = np.asarray(errors, float)
        text = f"{name}: mean {errors.mean():.2f} ns, rms {errors.std():.2f} ns, {len(errors)} edges"
        axis.hist(
            errors,
            bins,
            weights=np.full(len(errors), 100 / len(errors)),
            histtype="step",
            linewidth=3.4 - 0.7 * min(k, 3),  # equal histograms stay visible below each other
            color=CYCLE[k % 4],
            linestyle=STYLES[k % 4],
            label=text,
        )
    axis.set_ylim(top=axis.get_ylim()[1] * (1.1 + 0.08 * len(edges_ns)))
    name_axes(axis, x="edge minus ideal zero crossing (ns)", y="share of edges (%)", legend="upper left")
    return figure


def rate_step(time_s, rate_dps, stimulus_dps, bandwidth_hz=None):
    """Response of the rate channel to a step; time counts from the step.

    rate_dps      output word divided by the scale factor (deg/s)
    stimulus_dps  applied rate (deg/s)
    """
    figure, (axis,) = _figure(6.0, 1, "Step of the rate channel")
    time_ms = np.asarray(time_s) * 1e3
    text = "rate output" + (f" (-3 dB at {bandwidth_hz:.1f} Hz)" if bandwidth_hz else "")
    axis.step(time_ms, stimulus_dps, where="post", color=VERMILION, linestyle="--", linewidth=1.5, label="applied rate")
    axis.plot(time_ms, rate_dps, color=BLUE, linewidth=1.6, label=text)
    axis.set_xlim(time_ms[0], time_ms[-1])
    name_axes(axis, x="time from the step (ms)", y="rate (deg/s)", legend="lower right")
    return figure


# ---- HTML ------------------------------------------------------------------------------------------------------------

CSS = """
:root { color-scheme: light dark; --ink: #1a1a1a; --paper: #ffffff; --soft: #f2f4f6; --line: #c8ced4;
        --accent: #00558a; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --paper: #15181b; --soft: #22272c; --line: #444c54; --accent: #7cc4f0; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1240px; padding: 1.5rem; background: var(--paper); color: var(--ink);
       font: 16px/1.5 system-ui, "Liberation Sans", Arial, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.2rem; margin: 2rem 0 .6rem; color: var(--accent); }
table { border-collapse: collapse; margin: .4rem 0; display: block; overflow-x: auto; }
th, td { padding: .3rem .8rem; border-bottom: 1px solid var(--line); text-align: left; }
th { background: var(--soft); font-weight: 600; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.sum td { font-weight: 600; background: var(--soft); }
table.wide { font-size: .75rem; line-height: 1.35; } table.wide th, table.wide td { padding: .25rem .35rem; }
table.wide td:first-child { min-width: 8rem; }
figure { margin: 1rem 0; } img { max-width: 100%; height: auto; background: #fff; border-radius: 6px; }
figcaption, p.note { font-size: .9rem; opacity: .85; margin: .2rem 0; }
pre { background: var(--soft); padding: 1rem; overflow-x: auto; border-radius: 6px; font-size: .85rem; }
summary { cursor: pointer; color: var(--accent); }
"""


WIDE = 9  # columns from which on a table is set small


def _table_html(table):
    def cells(tag, row, kind=""):
        marks = [' class="number"' if k in table.numeric else "" for k in range(len(row))]
        return f"<tr{kind}>" + "".join(f"<{tag}{m}>{html.escape(str(c))}</{tag}>" for m, c in zip(marks, row)) + "</tr>"

    rows = "\n".join(cells("td", row, ' class="sum"' * (k in table.sums)) for k, row in enumerate(table.rows))
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    wide = ' class="wide"' if len(table.heads) >= WIDE else ""
    return f"<table{wide}><thead>{cells('th', table.heads)}</thead><tbody>\n{rows}\n</tbody></table>{note}"


def png(figure, alt="", dpi=DPI):
    """<img> with a matplotlib figure inside."""
    return _image(png_bytes(figure, dpi), alt)


def _image(data, alt):
    return f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def picture_html(picture, caption, links=()):
    """<figure> of a Figure, of a PNG, or of its file; `links` to files, (text, address), stand below the caption."""
    text = html.escape(caption)
    if isinstance(picture, Figure):
        image = png(picture, text)
    else:
        image = _image(picture if isinstance(picture, bytes) else Path(picture).read_bytes(), text)
    files = " ".join(f'<a href="{html.escape(address)}">{html.escape(name)}</a>' for name, address in links)
    links_html = f'<p class="note">{files}</p>' if files else ""
    return f"<figure>{image}<figcaption>{text}</figcaption>{links_html}</figure>"


def tables_html(tables):
    """Parts of a page: each table with its title."""
    return [part for table in tables for part in (f"<h2>{html.escape(table.title)}</h2>", _table_html(table))]


def head_html(title, notes=()):
    """Parts of a page: title, version, notes as a list."""
    notes_html = "".join(f"<li>{html.escape(note)}</li>" for note in notes)
    return [
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="note">ftr-gyro {VERSION}</p>',
        notes_html and f"<ul>{notes_html}</ul>",
    ]


def page_html(title, parts):
    """Page of parts of HTML; what is empty is left out."""
    body = "\n".join(part for part in parts if part)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{html.escape(title)}</title>'
        f"<style>{CSS}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def folded_html(head, text):
    """A text shown folded."""
    return f"<details><summary>{html.escape(head)}</summary><pre>{html.escape(text)}</pre></details>"


def write_html(path, title, tables=(), pictures=(), notes=(), details=()):
    """Write a report in one file.

    tables    `tables.Table`s
    pictures  (caption, Figure or PNG path)
    notes     sentences, printed above everything
    details   (head, text) shown folded, such as the configuration
    """
    parts = [*head_html(title, notes), *tables_html(tables)]
    if pictures:
        parts.append("<h2>Pictures</h2>")
    parts += [picture_html(picture, caption) for caption, picture in pictures]
    parts += [folded_html(head, text) for head, text in details]
    write_text(path, page_html(title, parts))
    return Path(path)
