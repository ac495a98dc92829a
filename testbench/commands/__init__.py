"""The command `gyro`. Ctrl-C is one line, and BLAS has one thread, from the moment that this package is loaded."""

import os

from testbench.interrupts import during_import

# Matrices are small: threads of BLAS would spin for longer than they compute. Arrow obeys OMP_NUM_THREADS as well.
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

during_import()
if not any(name in os.environ for name in (*BLAS_THREADS, "OMP_NUM_THREADS")):
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
