"""Which hypotheses explain a design of which only some ports are seen: the whole block goes on from golden rows.

    first row where the hypothesis is active  -->  the block with it, row by row  -->  it must give what is seen

Before that row the design was golden. A hypothesis that would have been seen before the first difference is left out.
The share is that of the wrong rows up to the first one that the block with the fault does not give.
Source  docs/diagnosis.md
"""

import collections

import numpy as np

from testbench.golden.diagnosis import of_conditions, simulate
from testbench.golden.diagnosis.net import wrapped
from testbench.golden.diagnosis.perturb import Hypothesis, of_node, with_argument
from testbench.golden.diagnosis.perturb_control import is_reset_choice
from testbench.golden.diagnosis.rows import Rows

BEFORE, BEHIND = 800, 2000  # rows before and behind the first difference
MOST_RUN = 3000  # hypotheses that are run: of each cause the cheapest ones, as many of each


def _in_turn(found):
    """[(hypothesis, row)] in the order in which they are run: the cheapest of each cause, then the next ones."""
    found, count = sorted(found, key=lambda pair: (pair[0].cost, pair[0].site.id)), collections.Counter()
    turns = []
    for h, _ in found:
        turns.append(count[h.cause])
        count[h.cause] += 1
    return [found[k] for k in sorted(range(len(found)), key=lambda k: turns[k])]


class Hidden:
    """The visible rows of a design against a net.

    leaves    {("in" or "reg", name): golden column}
    got       {name: column} of the ports that are seen;  care  {name: rows that count};  expected  {name: golden}
    """

    def __init__(self, net, leaves, got, care, expected):
        self.net = net
        self.visible = [name for name in net.roots if name in got]
        wrong = np.logical_or.reduce([care[name] & (got[name] != expected[name]) for name in self.visible])
        first = int(np.argmax(wrong))
        window = slice(max(first - BEFORE, 0), first + BEHIND)
        self.begin, self.first = window.start, first - window.start
        self.wrong = wrong[window]
        self.count = len(self.wrong)
        self.leaves = {key: column[window] for key, column in leaves.items()}
        self.got = {name: got[name][window] for name in self.visible}
        self.care = {name: care[name][window] for name in self.visible}
        self.expected = {name: expected[name][window] for name in self.visible}
        self.rows = Rows(net, self.leaves, self.count)
        # {port: row in which it differs first}, those that never do left out
        wrong = {name: self.care[name] & (self.got[name] != self.expected[name]) for name in self.visible}
        self.differs = {name: int(np.argmax(rows)) for name, rows in wrong.items() if rows.any()}

    def _activated(self, node):
        """(hypotheses at a node, first row of each where it differs): those that differ before what is seen."""
        at = np.arange(self.first + 1)
        was = self.rows.plain(node, at) + np.zeros(len(at), np.int64)
        found, rows = [], []
        for h in (*of_node(self.net, node, self.rows.seen), *of_conditions.of_words(self.net, node)):
            if any(n.op == "ahead" for n in (h.by, *h.by.args, *[b for a in h.by.args for b in a.args])):
                continue
            differs = self.rows.plain(h.by, at) != was
            if differs.any():
                found.append(h)
                rows.append(int(at[np.argmax(differs)]))
        return found, np.array(rows, np.int64)

    def _reset(self, node, found, at):
        """With other reset values, which show from row 0 on; that of a register that is seen is what is seen."""
        if node.value in self.got and self.care[node.value][0]:
            value = self.net.const(self.got[node.value][0])
            own = [
                Hypothesis("reset", f"{value!r} for {node.args[1]!r}", node, with_argument(self.net, node, 1, value), 0)
            ]
        else:
            own = [h for h in of_node(self.net, node, self.rows.seen) if h.cause == "reset"]
        others = [k for k, h in enumerate(found) if h.cause != "reset"]
        return [*own, *(found[k] for k in others)], np.array([*[0] * len(own), *at[others]], np.int64)

    def _unseen(self, node, found, at):
        """Those of the hypotheses at a node that give, where first active, what is seen."""
        keep = np.ones(len(found), bool)
        by = np.array([np.sum(self.rows.plain(h.by, at[k : k + 1])) for k, h in enumerate(found)], np.int64)
        for name in self.visible:
            root, fmt = self.net.roots[name], self.net.fmts[name]
            if not root.cone >> node.id & 1:
                continue
            value = wrapped(self.rows.changed(root, ((node, by),), at), fmt.width, bool(fmt.s))
            rows = np.minimum(at + (root.op == "next"), self.count - 1)
            keep &= (value == self.got[name][rows]) | ~self.care[name][rows] | (is_reset_choice(node) & (at == 0))
        return [(h, int(row)) for h, row, kept in zip(found, at, keep) if kept]

    def at_once(self):
        """The first port at fault if the whole block is reset in the row of its reset, before the edge; else None."""
        reset = self.leaves["in", "rst"] != 0
        leaves = {
            (kind, name): np.where(reset, self.net.reset[name], column) if kind == "reg" else column
            for (kind, name), column in self.leaves.items()
        }
        rows = Rows(self.net, leaves, self.count)
        for name in self.visible:
            root, fmt = self.net.roots[name], self.net.fmts[name]
            shown = leaves["reg", name] if root.op == "next" else wrapped(rows.full(root), fmt.width, bool(fmt.s))
            if np.any(self.care[name] & (shown != self.got[name])):
                return None
        return min(self.differs, key=self.differs.get, default=None)

    def explained(self):
        """[(hypothesis, share)] of those that explain some wrong rows, the best first."""
        ahead = []
        for node in self.net.nodes[: self.net.own]:
            if node.op in ("const", "next", "pin") and not node.args:
                continue
            found, at = self._activated(node)
            if is_reset_choice(node) and self.begin == 0:
                found, at = self._reset(node, found, at)
            if found:
                ahead += self._unseen(node, found, at)
        ahead = _in_turn(ahead)
        inputs = sorted({n.value for n in self.net.nodes[: self.net.own] if n.op == "in"})
        given = np.stack([self.leaves["in", name] for name in inputs], axis=1).tolist()
        want = list(zip(*[np.where(self.care[n], self.got[n], None).tolist() for n in self.visible]))
        registers = [name for name, root in self.net.roots.items() if root.op == "next"]
        total, out, runs = np.count_nonzero(self.wrong), [], {}
        for h, row in ahead[:MOST_RUN]:
            if simulate.adds_a_register(self.net, h.by):
                by, (run, held) = None, simulate.compiled(self.net, h.site, h.by, self.visible)
            else:
                by = simulate.value_of(self.net, h.by)
                if h.site.id not in runs:
                    runs[h.site.id] = simulate.compiled(self.net, h.site, None, self.visible)
                run, held = runs[h.site.id]
            state = [int(self.leaves["reg", name][row]) for name in registers]
            if row == 0 == self.begin and is_reset_choice(h.site) and h.cause == "reset" and h.by.args[1].op == "const":
                state[registers.index(h.site.value)] = h.by.args[1].value
            kept = [int(self.rows.full(node)[row]) for node in held]
            end = run(by, tuple(state), kept, given, row, self.count, want)
            share = np.count_nonzero(self.wrong[:end]) / total
            if share > 0:
                out.append((h, share))
        return sorted(out, key=lambda pair: (-pair[1], pair[0].cost))

    def driven(self, hypothesis):
        """The port that differs and that a hypothesis reaches through the fewest registers; the first of several."""
        reached, ahead = set(), [name for name, root in self.net.roots.items() if root.cone >> hypothesis.site.id & 1]
        while ahead:
            found = [name for name in ahead if name in self.differs]
            if found:
                return min(found, key=self.differs.get)
            reached.update(ahead)
            registers = [self.net.node("reg", (), name) for name in ahead if self.net.roots[name].op == "next"]
            ahead = [
                name
                for name, root in self.net.roots.items()
                if name not in reached and any(root.cone >> register.id & 1 for register in registers)
            ]
        raise ValueError(f"{hypothesis.what}: reaches no port that differs")
