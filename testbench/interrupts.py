"""Ctrl-C while compiled code runs: held back until it has returned. `held()` is for `with` and for functions.

Compiled code that makes Python objects on its way out, or calls Python to write a file, does not expect an exception
there: the process dies of it, or a file is damaged. A second Ctrl-C does not wait: it may be a compilation that the
user is tired of.
"""

import contextlib
import signal
import threading


@contextlib.contextmanager
def held():
    """Raise KeyboardInterrupt at the end of the block if SIGINT came during it."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    came = []

    def note(number, where):
        came.append(number)
        if len(came) > 1:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if came:
        raise KeyboardInterrupt
