"""Progress of a long command, on standard error."""

import sys
import time

SHOW_PROGRESS_AFTER_S = 1.0
SHOW_PROGRESS_EVERY_S = 0.1


class Progress:
    """Progress bar on standard error, when that is a terminal and the work takes more than a second.

    Called as progress(text, done, total); calls are cheap, so an engine may report every block. The time that is left
    follows from the work that was seen: a run that is continued in its middle has not done its first half in no time.
    """

    def __init__(self, quiet=False):
        self._quiet = quiet or not sys.stderr.isatty()
        self._begin = time.monotonic()
        self._bar = None
        self._task = None
        self._text = None
        self._next = 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._bar:
            self._bar.stop()

    def __call__(self, text, completed, total):
        now = time.monotonic()
        if self._quiet or (self._bar is None and now - self._begin < SHOW_PROGRESS_AFTER_S):
            return
        if text == self._text and now < self._next and completed < total:
            return
        self._next = now + SHOW_PROGRESS_EVERY_S
        if self._bar is None:
            self._open_bar()
        if text != self._text:
            self._text = text
            self._bar.reset(self._task, description=text, completed=completed, total=total)
        else:
            self._bar.update(self._task, completed=completed, total=total)

    def _open_bar(self):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = TextColumn("{task.description:24}"), BarColumn(40), TaskProgressColumn(), TimeRemainingColumn()
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self._bar.start()
        self._task = self._bar.add_task("", total=1)
