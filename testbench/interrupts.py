"""Ctrl-C while compiled code runs: held back until it has returned. `defer_interrupts()` is for `with` and functions.
While modules are loaded it is one line, as it is afterwards: `during_import()`.

Compiled code that makes Python objects on its way out, or calls Python to write a file, does not expect an exception
there: the process dies of it, or a file is damaged. A second Ctrl-C does not wait: it may be a compilation that the
user is tired of.
"""

import contextlib
import os
import signal
import sys
import threading

EXIT_INTERRUPTED = 130


def during_import():
    """Say in one line, instead of a traceback, that Ctrl-C came before a command could catch it."""
    before = sys.excepthook

    def hook(kind, problem, trace):
        if not issubclass(kind, KeyboardInterrupt):
            return before(kind, problem, trace)
        print("gyro: interrupted", file=sys.stderr, flush=True)
        os._exit(EXIT_INTERRUPTED)

    sys.excepthook = hook


@contextlib.contextmanager
def defer_interrupts():
    """Raise KeyboardInterrupt at the end of the block if SIGINT came during it."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    received_signals = []

    def note(number, where):
        received_signals.append(number)
        if len(received_signals) > 1:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if received_signals:
        raise KeyboardInterrupt
