"""An FST dump, read in a process of its own: `python -m testbench.golden.check.fst_log PATH SIGNAL...` prints JSON.

{wanted path: [times, texts of bits, width, high bit of a slice, low bit]}, as `waves.changes_of` gives them.
Source    docs/golden.md
"""

import json
import sys

from testbench.golden.check.waves import changes_of
from testbench.storage import inputs, trial


def main(path):
    """Print the changes of the signals that the command line names."""
    import pywellen

    with inputs.parsing(path, "FST file"):
        found = changes_of(path, pywellen.Waveform(str(path)), sys.argv[2:])
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    trial.main(main)
