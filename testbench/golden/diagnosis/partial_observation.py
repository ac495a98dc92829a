"""Which hypotheses explain a design of which only some ports are seen: the whole block goes on from golden rows.

    first row where the hypothesis is active  -->  the block with it, row by row  -->  it must give what is seen

Before that row the design was golden. A hypothesis that would have been seen before the first difference is left out.
The share is that of the wrong rows up to the first one that the block with the fault does not give.
Source  docs/diagnosis.md
"""

import collections

import numpy as np

from testbench.golden.diagnosis import condition_hypotheses, simulate_faults
from testbench.golden.diagnosis.net import wrap_column
from testbench.golden.diagnosis.node_rows import Rows
from testbench.golden.diagnosis.perturb import Hypothesis, node_hypotheses, with_argument
from testbench.golden.diagnosis.perturb_control import is_reset_choice

ROWS_BEFORE, ROWS_AFTER = 800, 2000  # rows before and behind the first difference
MOST_RUN = 3000  # hypotheses that are run: of each cause the cheapest ones, as many of each


def _interleave_causes(activations):
    """[(hypothesis, row)] in the order in which they are run: the cheapest of each cause, then the next ones."""
    activations, count = sorted(activations, key=lambda pair: (pair[0].cost, pair[0].site.id)), collections.Counter()
    turns = []
    for h, _ in activations:
        turns.append(count[h.cause])
        count[h.cause] += 1
    return [activations[k] for k in sorted(range(len(activations)), key=lambda k: turns[k])]


class HiddenRegisterSearch:
    """The visible rows of a design against a net.

    leaves    {("in" or "reg", name): golden column}
    got       {name: column} of the ports that are seen;  care  {name: rows that count};  expected  {name: golden}
    """

    def __init__(self, net, leaves, got, care, expected):
        self.net = net
        self.visible = [name for name in net.roots if name in got]
        wrong = np.logical_or.reduce([care[name] & (got[name] != expected[name]) for name in self.visible])
        first = int(np.argmax(wrong))
        window = slice(max(first - ROWS_BEFORE, 0), first + ROWS_AFTER)
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

    def _active_hypotheses(self, node):
        """(hypotheses at a node, first row of each where it differs): those that differ before what is seen."""
        row_numbers = np.arange(self.first + 1)
        was = self.rows.node_values(node, row_numbers) + np.zeros(len(row_numbers), np.int64)
        hypotheses, rows = [], []
        words = condition_hypotheses.condition_bit_hypotheses(self.net, node)
        for h in (*node_hypotheses(self.net, node, self.rows.observed_range), *words):
            if any(n.op == "ahead" for n in (h.by, *h.by.args, *[b for a in h.by.args for b in a.args])):
                continue
            differs = self.rows.node_values(h.by, row_numbers) != was
            if differs.any():
                hypotheses.append(h)
                rows.append(int(row_numbers[np.argmax(differs)]))
        return hypotheses, np.array(rows, np.int64)

    def _replace_reset_hypotheses(self, node, hypotheses, firsts):
        """With other reset values, which show from row 0 on; that of a register that is seen is what is seen."""
        if node.value in self.got and self.care[node.value][0]:
            value = self.net.const(self.got[node.value][0])
            resets = [
                Hypothesis("reset", f"{value!r} for {node.args[1]!r}", node, with_argument(self.net, node, 1, value), 0)
            ]
        else:
            resets = [h for h in node_hypotheses(self.net, node, self.rows.observed_range) if h.cause == "reset"]
        indices = [k for k, h in enumerate(hypotheses) if h.cause != "reset"]
        return [*resets, *(hypotheses[k] for k in indices)], np.array([*[0] * len(resets), *firsts[indices]], np.int64)

    def _consistent_hypotheses(self, node, hypotheses, firsts):
        """Those of the hypotheses at a node that give, where first active, what is seen."""
        consistent_mask = np.ones(len(hypotheses), bool)
        by = np.array(
            [np.sum(self.rows.node_values(h.by, firsts[k : k + 1])) for k, h in enumerate(hypotheses)], np.int64
        )
        for name in self.visible:
            root, fmt = self.net.roots[name], self.net.fmts[name]
            if not root.cone >> node.id & 1:
                continue
            value = wrap_column(self.rows.values_with_faults(root, ((node, by),), firsts), fmt.width, bool(fmt.s))
            rows = np.minimum(firsts + (root.op == "next"), self.count - 1)
            consistent_mask &= (
                (value == self.got[name][rows]) | ~self.care[name][rows] | (is_reset_choice(node) & (firsts == 0))
            )
        return [(h, int(row)) for h, row, is_consistent in zip(hypotheses, firsts, consistent_mask) if is_consistent]

    def async_reset_port(self):
        """The first port at fault if the whole block is reset in the row of its reset, before the edge; else None."""
        reset = self.leaves["in", "rst"] != 0
        leaves = {
            (kind, name): np.where(reset, self.net.reset[name], column) if kind == "reg" else column
            for (kind, name), column in self.leaves.items()
        }
        rows = Rows(self.net, leaves, self.count)
        for name in self.visible:
            root, fmt = self.net.roots[name], self.net.fmts[name]
            column = (
                leaves["reg", name]
                if root.op == "next"
                else wrap_column(rows.node_column(root), fmt.width, bool(fmt.s))
            )
            if np.any(self.care[name] & (column != self.got[name])):
                return None
        return min(self.differs, key=self.differs.get, default=None)

    def hypothesis_shares(self):
        """[(hypothesis, share)] of those that explain some wrong rows, the best first."""
        activations = []
        for node in self.net.nodes[: self.net.model_size]:
            if node.op in ("const", "next", "pin") and not node.args:
                continue
            hypotheses, activation_rows = self._active_hypotheses(node)
            if is_reset_choice(node) and self.begin == 0:
                hypotheses, activation_rows = self._replace_reset_hypotheses(node, hypotheses, activation_rows)
            if hypotheses:
                activations += self._consistent_hypotheses(node, hypotheses, activation_rows)
        activations = _interleave_causes(activations)
        inputs = sorted({n.value for n in self.net.nodes[: self.net.model_size] if n.op == "in"})
        input_rows = np.stack([self.leaves["in", name] for name in inputs], axis=1).tolist()
        want = list(zip(*[np.where(self.care[n], self.got[n], None).tolist() for n in self.visible]))
        registers = [name for name, root in self.net.roots.items() if root.op == "next"]
        total, out, runs = np.count_nonzero(self.wrong), [], {}
        for h, row in activations[:MOST_RUN]:
            if simulate_faults.adds_a_register(self.net, h.by):
                by, (run, added_registers) = None, simulate_faults.compile_block(self.net, h.site, h.by, self.visible)
            else:
                by = simulate_faults.compile_node(self.net, h.by)
                if h.site.id not in runs:
                    runs[h.site.id] = simulate_faults.compile_block(self.net, h.site, None, self.visible)
                run, added_registers = runs[h.site.id]
            state = [int(self.leaves["reg", name][row]) for name in registers]
            if row == 0 == self.begin and is_reset_choice(h.site) and h.cause == "reset" and h.by.args[1].op == "const":
                state[registers.index(h.site.value)] = h.by.args[1].value
            added_register_values = [int(self.rows.node_column(node)[row]) for node in added_registers]
            end = run(by, tuple(state), added_register_values, input_rows, row, self.count, want)
            share = np.count_nonzero(self.wrong[:end]) / total
            if share > 0:
                out.append((h, share))
        return sorted(out, key=lambda pair: (-pair[1], pair[0].cost))

    def affected_port(self, hypothesis):
        """The port that differs and that a hypothesis reaches through the fewest registers; the first of several."""
        reached, ports = set(), [name for name, root in self.net.roots.items() if root.cone >> hypothesis.site.id & 1]
        while ports:
            differing_ports = [name for name in ports if name in self.differs]
            if differing_ports:
                return min(differing_ports, key=self.differs.get)
            reached.update(ports)
            registers = [self.net.node("reg", (), name) for name in ports if self.net.roots[name].op == "next"]
            ports = [
                name
                for name, root in self.net.roots.items()
                if name not in reached and any(root.cone >> register.id & 1 for register in registers)
            ]
        raise ValueError(f"{hypothesis.what}: reaches no port that differs")
