"""What a run leaves in its folder: record, pictures, report, waveforms, state; each whole or absent.

`Result` is what an engine hands over; nothing here computes, it only writes.
Source  docs/record.md
"""

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from testbench.errors import FileError
from testbench.storage.files import refuse_foreign_links


class Result(NamedTuple):
    """A finished run.

    summary  the object that `--json` prints
    notes    sentences for a person: what is assumed, what remains unexplained
    record   what `write(path, progress)` makes a record of: `record.Record`, `spool.Recording`, or None
    plots    name -> keyword arguments of the function of that name in `report`
    window   (rows, signals, first edge, master clock in Hz) of the waveform window, or None
    state    (values, source format, meta) of `state_file.save_state`, or None
    """

    summary: dict
    notes: tuple = ()
    record: Any = None
    plots: dict = {}  # noqa: RUF012  (nobody writes to it)
    window: Any = None
    state: Any = None


CAPTIONS = {
    "startup": "Start-up to lock",
    "spectra": "Spectra of both DAC outputs",
    "jitter": "Jitter of the reference edges",
    "rate_step": "Step of the rate channel",
}


CURVES = ("pins.drive_code", "pins.sense_code")  # drawn as curves in GTKWave


def check_folder(directory):
    """Make the folder and try to write in it, before hours are spent on what cannot be kept."""
    folder = Path(directory)
    refuse_foreign_links(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as problem:
        raise FileError(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    return folder


def write(result, config, tables=(), progress=None, directory=None):
    """Write what [output] asks for; returns the paths.

    tables     go into the report
    directory  instead of that of [output]
    """
    output_section, files = config.output, []
    folder = check_folder(directory or output_section.directory)

    def step(text):
        if progress:
            progress(text, len(files), 8)

    if output_section.record and result.record is not None:
        step("record")
        result.record.write(folder / "run.h5", progress)
        files.append(folder / "run.h5")
    if result.window is not None:
        step("waveforms")
        from testbench.storage.vcd import write_window

        files += write_window(folder / "run.vcd", *result.window, analog=CURVES)
    pictures = []
    if output_section.pictures or output_section.html:
        step("pictures")
        pictures = _pictures(result, folder)
        files += [path for _, path in pictures]
    if output_section.html:
        step("report")
        from testbench.config import to_toml
        from testbench.console import report

        title = f"gyro run: {config.scenario.seconds:g} s, seed {config.noise.seed}"
        details = [("Configuration", to_toml(config))]
        report.write_html(folder / "run.html", title, tables, pictures, result.notes, details)
        files.append(folder / "run.html")
    if output_section.state and result.state is not None:
        step("state")
        from testbench.storage.state_file import save_state

        values, source_format, meta = result.state
        save_state(folder / "state.h5", values, source_format, meta)
        files.append(folder / "state.h5")
    return files


def _pictures(result, folder):
    from testbench.console import report

    pictures = []
    for name, caption in CAPTIONS.items():
        if name in result.plots:
            figure = getattr(report, name)(**result.plots[name])
            pictures.append((caption, report.save(figure, folder / f"{name}.png")))
    return pictures
