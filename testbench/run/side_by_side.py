"""Runs side by side: each as if it were alone, the arithmetic of their plants together in the lanes engine.

    run A  ==25000===|w|====25000====|==25000==| end      A run asks its engine for some ticks, and waits. When all
    run B  ==25000===|w|====25000====|====== 100000       wait or have ended, those at one tick move on together, up to
    run C  ==25000===|=probe=|                            the nearest end of what any of them asked for; and so on.

Each run has a thread, for its place in its own code; one thread works at a time. What lanes cannot do (host writes,
register windows, probes, the digital board), and what is not worth it (few runs, few ticks), the frame engine does run
by run. Both engines give the same bits however a run is cut, so nothing of a run hangs on who stands beside it.
Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

import threading

import numpy as np

from analog_frontend.numeric.vector import LANES
from fpga_model.rates import FRAME_TICKS
from testbench.engines import frame, lanes
from testbench.storage.code_hash import frames_begun

LEAST_RUNS = 3  # fewer are faster one by one
LEAST_TICKS = 1000  # shorter pieces are clocked for the most part
NEAR_TICKS = 1000  # a run so far behind catches up with the others


class Abandoned(BaseException):
    """The other runs were given up."""


class _Wish:
    """What one run asks for, and how far it has come."""

    def __init__(self, params, state, ticks, rate_rad_s, temp_degc, faults, streams):
        self.params, self.state, self.faults, self.streams = params, state, faults, streams
        self.begin, self.end = state.tick, state.tick + ticks
        self.rate_rad_s, self.temp_degc = rate_rad_s, temp_degc
        self.kind = lanes.kind(params)
        self.problem = None

    @property
    def ended(self):
        return self.problem is not None or self.state.tick == self.end

    def told(self, until):
        """(ticks, rates, temperatures, streams) of an engine's call from here to `until`."""
        done, ticks = self.state.tick - self.begin, until - self.state.tick
        first = self.state.tick // FRAME_TICKS - self.begin // FRAME_TICKS
        frames = first + np.arange(ticks // FRAME_TICKS + 2)
        row, o = frames_begun(self.begin, done), self.streams
        rows, span = slice(row, row + frames_begun(self.state.tick, ticks)), slice(done, done + ticks)
        streams = o._replace(
            drive_code=o.drive_code[span], sense_code=o.sense_code[span], frames=o.frames[rows], truth=o.truth[rows]
        )
        return ticks, *(x.take(frames, mode="clip") for x in (self.rate_rad_s, self.temp_degc)), streams

    def alone(self, until):
        """Move on to `until` by the frame engine."""
        ticks, rate_rad_s, temp_degc, streams = self.told(until)
        try:
            self.state = frame.run(self.params, self.state, ticks, rate_rad_s, temp_degc, 0, 0, 0, self.faults, streams)
        except Exception as problem:
            self.problem = problem


NAME = "side by side"  # of the threads


class Table:
    """Where runs meet: `run` is what each of them has for an engine."""

    def __init__(self, runs):
        self.turn = threading.Condition(threading.Lock())  # held by the one thread that works
        self.abandoned = False
        self._playing, self._waiting, self._engines = runs, [], {}

    def run(self, params, state, ticks, rate_rad_s, temp_degc, write, address, data, faults, streams):
        """As `frame.run`, with the same result to the last bit; the caller holds `turn`."""
        wish = _Wish(params, state, ticks, rate_rad_s, temp_degc, faults, streams)
        special = write or len(streams.registers) or len(streams.pins) or len(streams.probe_ints)
        if special or wish.kind is None:
            return frame.run(params, state, ticks, rate_rad_s, temp_degc, write, address, data, faults, streams)
        self._waiting.append(wish)
        self._move()
        self.turn.wait_for(lambda: wish.ended or self.abandoned)
        if self.abandoned:
            raise Abandoned
        if wish.problem is not None:
            raise wish.problem
        return wish.state

    def leave(self):
        """A run has ended."""
        self._playing -= 1
        self._move()

    def _move(self):
        """If all wait, move on until one has what it asked for."""
        while not self.abandoned and self._waiting and len(self._waiting) == self._playing:
            first = min(wish.state.tick for wish in self._waiting)
            near = [wish for wish in self._waiting if wish.state.tick <= first + NEAR_TICKS]
            begin = max(wish.state.tick for wish in near)
            for wish in near:
                if wish.state.tick < begin:
                    wish.alone(min(begin, wish.end))
            if not any(wish.ended for wish in near):
                until = min([wish.end for wish in near] + [w.state.tick for w in self._waiting if w not in near])
                self._together(near, until)
            self._waiting = [wish for wish in self._waiting if not wish.ended]
        self.turn.notify_all()

    def _together(self, near, until):
        """Move wishes that are at one tick on to `until`."""
        kinds = {}
        for wish in near:
            kinds.setdefault(wish.kind, []).append(wish)
        for alike in kinds.values():
            for k in range(0, len(alike), LANES):
                group = alike[k : k + LANES]
                if len(group) < LEAST_RUNS or until - group[0].state.tick < LEAST_TICKS:
                    for wish in group:
                        wish.alone(until)
                else:
                    self._in_lanes(group, until)

    def _in_lanes(self, group, until):
        group.sort(key=lambda wish: id(wish.params))  # they come in any order; those of an engine keep theirs
        key = tuple(id(wish.params) for wish in group)  # kept by the engine, so no other has this id
        told = [wish.told(until) for wish in group]
        ticks, (_, rates, temps, streams) = told[0][0], zip(*told)
        try:
            engine = self._engines.get(key)
            if engine is None:
                engine = self._engines[key] = lanes.Engine([wish.params for wish in group])
            states = engine.run(
                [wish.state for wish in group], ticks, rates, temps, [wish.faults for wish in group], streams
            )
        except Exception as problem:
            for wish in group:
                wish.problem = problem
            return
        for wish, state in zip(group, states):
            wish.state = state


def play(works):
    """Call functions side by side, each with the engine it is to use; [what it returned, or its exception, ...]."""
    table, out = Table(len(works)), [None] * len(works)

    def one(k, work):
        with table.turn:
            try:
                out[k] = work(table.run)
            except Exception as problem:
                out[k] = problem
            except Abandoned:
                pass
            finally:
                table.leave()

    threads = [
        threading.Thread(target=one, args=item, daemon=True, name=f"{NAME} {item[0]}") for item in enumerate(works)
    ]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    except BaseException:
        table.abandoned = True
        with table.turn:
            table.turn.notify_all()
        raise
    return out
