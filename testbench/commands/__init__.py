"""The command `gyro`. Ctrl-C is one line from the moment that this package is loaded."""

from testbench.interrupts import during_import

during_import()
