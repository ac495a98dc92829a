"""How a campaign gets on: a bar with what is left, and means of what was found so far; plain lines without a terminal.

The time that is left follows from the points of this run, on all workers together; points that were there already do
not count.
Source  docs/campaigns.md
"""

import math
import sys
import time

from testbench.campaign import work

LINE_EVERY_S = 10.0
MOST_HEADLINE_NUMBERS = 5
HEADLINE_NUMBER_NAMES = ("drive_frequency_hz", "lock_time_s", "rate_lsb_per_dps", "quadrature_v", "rate_word_mean_lsb")


class Running:
    """Count, mean and standard deviation of numbers as they come (Welford)."""

    def __init__(self):
        self.count, self.mean, self._m2 = 0, 0.0, 0.0

    def add(self, value):
        self.count += 1
        delta = value - self.mean
        self.mean += delta / self.count
        self._m2 += delta * (value - self.mean)

    @property
    def std(self):
        return math.sqrt(self._m2 / (self.count - 1)) if self.count > 1 else math.nan


def clock(seconds):
    """h:mm:ss, or -:--:-- where nothing is known."""
    if not math.isfinite(seconds):
        return "-:--:--"
    rounded_s = round(seconds)
    return f"{rounded_s // 3600}:{rounded_s // 60 % 60:02}:{rounded_s % 60:02}"


class Progress:
    """Told of every outcome; shows it on standard error. `quiet` shows nothing."""

    def __init__(self, quiet=False, terminal=None, say=None, now=time.monotonic):
        self._quiet = quiet
        self._terminal = sys.stderr.isatty() if terminal is None else terminal
        self._say = say or (lambda text: print(text, file=sys.stderr, flush=True))
        self._now = now
        self._live = None
        self.total = self.reused = self.done = self.failed = 0
        self.simulated_s = 0.0
        self.numbers = {}
        self._where = ""

    def set_totals(self, total, reused, executor):
        """So many points, of which so many are there already."""
        self.total, self.reused = total, reused
        self._executor = executor
        self._began = self._line = self._now()
        if not self._quiet:
            self._say(f"{total} points, {reused} of them finished earlier")

    def note(self, text):
        """A line of its own."""
        if not self._quiet:
            self._say(text)

    def __enter__(self):
        self._began = self._line = self._now()
        if not self._quiet and self._terminal:
            from rich.console import Console
            from rich.live import Live

            self._live = Live(
                get_renderable=self._picture, console=Console(stderr=True), transient=True, refresh_per_second=4
            )
            self._live.start()
        return self

    def __exit__(self, kind, *_):
        if self._live:
            self._live.stop()
        if not self._quiet and kind is None:
            self._say(self.line())

    def add(self, outcome):
        """A point has ended."""
        self.failed += outcome.status == work.FAILED
        self.done += outcome.status in (work.FINISHED, work.FINISHED_ELSEWHERE)
        self.simulated_s += outcome.simulated_s
        for name, value in outcome.numbers.items():
            if isinstance(value, (int, float)) and math.isfinite(value):
                self.numbers.setdefault(name, Running()).add(float(value))
        if not (self._quiet or self._live) and self._now() - self._line >= LINE_EVERY_S:
            self._line = self._now()
            self._say(self.line())

    @property
    def remaining_s(self):
        """Estimate of the time to the end; nan before the first point."""
        ended = self.done + self.failed
        if not ended:
            return math.nan
        return (self._now() - self._began) / ended * (self.total - self.reused - ended)

    def line(self):
        """One line of what there is to say."""
        ended = self.done + self.failed
        spent = max(self._now() - self._began, 1e-9)
        parts = [f"{self.reused + ended}/{self.total} points"]
        if self.failed:
            parts.append(f"{self.failed} failed")
        parts.append(f"{ended / spent:.3g} points/s")
        if self.simulated_s:
            parts.append(f"{self.simulated_s / spent:.3g} x real time")
        parts.append(f"{self._executor.workers} workers")
        parts.append(f"{clock(self.remaining_s)} left")
        return ", ".join(parts)

    def headline_numbers(self):
        """[(name, mean, std)] of the numbers that are shown: the usual ones first."""
        names = [name for name in HEADLINE_NUMBER_NAMES if name in self.numbers]
        names += [name for name in self.numbers if name not in names and self.numbers[name].std > 0]
        return [(name, self.numbers[name].mean, self.numbers[name].std) for name in names[:MOST_HEADLINE_NUMBERS]]

    def _picture(self):
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        ended = self.reused + self.done + self.failed
        table = Table.grid(padding=(0, 2))
        for name, mean, std in self.headline_numbers():
            table.add_row(name, f"{mean:.10g}", f"+- {std:.3g}")
        bar = Table.grid()  # a bar alone does not end its line
        bar.add_row(ProgressBar(self.total, ended, width=60))
        return Group(bar, self.line(), table)
