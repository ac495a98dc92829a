"""An FST dump, read in a process of its own: `python -m testbench.golden.check.fst_log PATH SIGNAL...` prints JSON.

Source    docs/golden.md
"""

import json
import sys

from testbench.errors import FileError
from testbench.golden.check.signal_paths import find_signal, index_signals
from testbench.storage import inputs, sandboxed_read


def read_changes(path, paths):
    """{wanted path: (times, texts of bits, width, high bit of a slice, low bit)} of an FST file."""
    import pywellen

    wave = pywellen.Waveform(str(path))
    variables = list(wave.all_vars())
    signal_index = index_signals((var.full_name, str(var.signal_ref)) for var in variables)
    by_signal = {str(var.signal_ref): var for var in variables}
    out = {}
    for signal_path in paths:
        signal, hi, lo = find_signal(signal_path, signal_index, path)
        var = by_signal[signal_index[signal]]
        if var.bitwidth is None:
            raise FileError(f"{path}: signal {signal} is not bits")
        times, texts = [], []
        for time, value in var.signal:
            times.append(int(time))
            texts.append(f"{value:0{var.bitwidth}b}" if isinstance(value, int) else str(value))
        out[signal_path] = (times, texts, int(var.bitwidth), hi, lo)
    return out


def read_signal_widths(path):
    """[(path, bits or None)] of every signal."""
    import pywellen

    return [(var.full_name, var.bitwidth) for var in pywellen.Waveform(str(path)).all_vars()]


def main(path):
    """Print the changes of the signals that the command line names, or all names with their bits if it has none."""
    with inputs.explain_damage(path, "FST file"):
        json_data = read_changes(path, sys.argv[2:]) if sys.argv[2:] else read_signal_widths(path)
    json.dump(json_data, sys.stdout)


if __name__ == "__main__":
    sandboxed_read.main(main)
