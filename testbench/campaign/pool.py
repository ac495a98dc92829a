"""Worker processes on this machine, one batch at a time each: a dead one takes down its own batch and no other.

    main -- pipe --> worker 1: run_batch     A worker that dies is replaced, and its batch runs again elsewhere, at
         -- pipe --> worker 2: run_batch     most `TRIES` times; then its points have failed. Workers end when main
                                             does, however that ends: a thread of theirs watches main.

Processes and not threads: a point that kills its worker must not kill the campaign.
Source  docs/campaigns.md, docs/decisions/0011-workers-of-a-campaign.md
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from multiprocessing.connection import wait

from testbench.campaign import work
from testbench.errors import FileError

PRELOADED = ["testbench.campaign.work", "typer"]
TRIES = 3
MOST_LOST_WORKERS = 8  # workers lost in a row, nothing finished between: something is wrong with all of them


def exit_with_main():
    """End this worker when main does, however that ends."""
    main = multiprocessing.parent_process().sentinel

    def wait_and_exit():
        wait([main])
        os._exit(1)

    threading.Thread(target=wait_and_exit, daemon=True).start()


def serve(connection):
    """The life of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is main's to act on
    os.dup2(sys.stderr.fileno(), 1)  # standard output holds results
    exit_with_main()
    with contextlib.suppress(EOFError, OSError):
        while True:
            connection.send(work.run_batch(*connection.recv()))


class InProcessExecutor:
    """No worker: batches run in this process, one after the other, where a debugger sees them."""

    workers = 1

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def run(self, store, batches):
        """As `Pool.run`."""
        for batch in batches:
            yield work.run_batch(str(store.path), store.name, batch)


class Pool:
    """`workers` processes for the batches of a store."""

    def __init__(self, workers):
        self.workers = workers
        # a server that has imported everything forks a worker in a moment; it has no threads when it does
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)
        self._busy = {}  # connection -> (process, batch, tries)
        self._idle = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for connection, process in [*self._idle, *((c, p) for c, (p, _, _) in self._busy.items())]:
            process.kill()
            process.join()
            connection.close()

    def _start(self):
        mine, theirs = self._context.Pipe()
        process = self._context.Process(target=serve, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        return mine, process

    def run(self, store, batches):
        """Yield lists of `work.Outcome` as batches end."""
        ahead = [(batch, 1) for batch in reversed(batches)]
        lost = 0
        while ahead or self._busy:
            while ahead and len(self._busy) < self.workers:
                self._give(store, *ahead.pop())
            for connection in wait(list(self._busy)):
                process, batch, tries = self._busy.pop(connection)
                try:
                    outcomes = connection.recv()
                except (EOFError, OSError):
                    connection.close()
                    process.join()
                    lost += 1
                    if lost > MOST_LOST_WORKERS:
                        raise FileError(
                            f"workers: {lost} worker processes died before any point was finished"
                            f" (exit code {process.exitcode})"
                        ) from None
                    if tries < TRIES:  # alone from now on: one of them may be the cause
                        ahead += [(one, tries + 1) for one in batch.split()]
                        continue
                    yield death_notice(batch, tries, process.exitcode)
                    continue
                lost = 0
                self._idle.append((connection, process))
                yield outcomes

    def _give(self, store, batch, tries):
        connection, process = self._idle.pop() if self._idle else self._start()
        # one that died while it was idle is noticed where its answer is read
        with contextlib.suppress(OSError):
            connection.send((str(store.path), store.name, batch))
        self._busy[connection] = process, batch, tries


def death_notice(batch, tries, code):
    """Outcomes of a batch whose workers died."""
    text = f"the worker process died {tries} times while it ran this point (exit code {code})"
    return [work.Outcome(address, work.FAILED, text) for address in batch.addresses]
