"""`python -m testbench.bench`: measure, print, write build/bench.json and the tables in docs/speed.md."""

import sys

from testbench.bench.measure_speed import main

if __name__ == "__main__":
    sys.exit(main())
