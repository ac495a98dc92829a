"""Values of a net's nodes on rows: all of them once, and a root again where some nodes are replaced by others.

    node_column(node)                     column of the node over all rows
    values_with_faults(root, faults, at)  values of the root at the rows `at`, with `by` for `site` for each (site, by)

`by` may be values already, of several hypotheses: an array (hypotheses, rows) gives one of that shape.
What stands for a site may read the site itself: there it is sound. A "held" node is a register beside those of the
block: it takes its argument at the end of each row where its condition holds. An "ahead" node is its argument a row on.
Source  docs/diagnosis.md
"""

import numpy as np

from testbench.golden.diagnosis.net import OPERATIONS, permute_bits

TIMED = ("held", "ahead", "odd")


def apply_operation(node, args):
    """Column of a node from the columns of its arguments; not for leaves and held nodes."""
    if node.op == "table":
        words = np.array(node.value, np.int64)
        return words[np.clip(args[0], 0, len(words) - 1)]
    if node.op == "moved":
        return permute_bits(args[0], node.value)
    return OPERATIONS[node.op][0](*args)


def _enabled_register_column(load, x, rst, reset):
    """Column of a register: what `x` was in the last row before with a load, or `reset` where that was a reset."""
    event = (load != 0) | (rst != 0)
    last = np.maximum.accumulate(np.where(event, np.arange(len(x)), -1))
    last = np.concatenate(([-1], last[:-1]))
    value = np.where(rst != 0, reset, x)
    return np.where(last < 0, reset, value[last])


def _odd(load, rst):
    """Column of a flag that changes at the end of each row with a load, and is 0 behind a reset."""
    count = np.cumsum((load != 0) & (rst == 0))
    since = np.maximum.accumulate(np.where(rst != 0, count, 0))
    return np.concatenate(([0], (count - since)[:-1])) & 1


class Rows:
    """Nodes of `net` on the rows of `leaves`: {("reg" or "in", name): int64 column}."""

    def __init__(self, net, leaves, count):
        self.net, self.leaves, self.count = net, leaves, count
        self.columns, self._ranges = {}, {}

    def observed_range(self, node):
        """(least, largest) value of a node."""
        if node.id not in self._ranges:
            column = self.node_column(node)
            self._ranges[node.id] = int(column.min()), int(column.max())
        return self._ranges[node.id]

    def node_column(self, node):
        """Column of a node over all rows."""
        column = self.columns.get(node.id)
        if column is None:
            column = self.columns[node.id] = self._compute_column(node)
        return column

    def _compute_column(self, node):
        if node.op in ("reg", "in"):
            return self.leaves[node.op, node.value]
        if node.op in ("const", "param"):
            return np.full(self.count, self._constant_value(node), np.int64)
        args = [self.node_column(a) for a in node.args]
        if node.op == "odd":
            return _odd(*args)
        if node.op == "ahead":
            return np.append(args[0][1:], args[0][-1:])
        return _enabled_register_column(*args, node.value) if node.op == "held" else apply_operation(node, args)

    @staticmethod
    def _constant_value(node):
        return node.value if node.op == "const" else node.value[1]

    def node_values(self, node, at):
        """Values of a node at some rows; the column of what is not of the model is not kept."""
        column = self.columns.get(node.id)
        if column is not None:
            return column[at]
        if node.op in ("const", "param"):
            return np.int64(self._constant_value(node))
        if node.id < self.net.model_size or node.op in TIMED or not node.args:
            return self.node_column(node)[at]
        return apply_operation(node, [self.node_values(a, at) for a in node.args])

    def values_with_faults(self, root, faults, at):
        """Values of `root` at the rows `at` with `by` in the place of `site` for each (site, by)."""
        cached_values = {}

        def value(node, live):
            for k in live:
                if faults[k][0] is node:
                    by = faults[k][1]
                    return by if isinstance(by, np.ndarray) else value(by, tuple(n for n in live if n != k))
            live = tuple(k for k in live if node.cone >> faults[k][0].id & 1)
            if not live or node.op in TIMED:
                return self.node_values(node, at)
            key = node.id, live
            if key not in cached_values:
                cached_values[key] = apply_operation(node, [value(a, live) for a in node.args])
            return cached_values[key]

        return value(root, tuple(range(len(faults)))) + np.zeros(
            self.count if isinstance(at, slice) else len(at), np.int64
        )
