"""Hypotheses on conditions, read off the rows: another bit of the block in the place of a condition, or beside it.

    what a register is with a condition that is 0 and 1  -->  the rows in which the condition must be 0, and 1
    each bit of each word of the block, and what the condition is with it, against these rows

Other bits are in more ways possible than all other mistakes: they make a name uncertain, they are none by themselves.
A bit of a word that the condition reads may be named. Where a condition chooses between constants alone, a design may
have an expression there: then another bit is `operand` as well as `condition`.
Source  docs/diagnosis.md
"""

import functools

import numpy as np

from testbench.golden.diagnosis.elaborate import static
from testbench.golden.diagnosis.net import ROOTS
from testbench.golden.diagnosis.perturb import FAR, Hypothesis, with_argument
from testbench.golden.diagnosis.perturb_arithmetic import is_flag
from testbench.golden.diagnosis.perturb_control import branches, decides

READ_BIT_COST, EXTRA_BIT_COST = 4, FAR + 4  # costs: a bit of a word that is read, one more
FREE_FLAG_COST = FAR - 1
MOST_BITS = 12000
MOST_BIT_MATCHES = 12  # of each form
FEW = 16  # bytes that are compared first
SOME = 40  # rows that are tried first


class Bits:
    """Every bit of every word of a block on rows, eight rows to a byte."""

    def __init__(self, net, rows):
        words = [n for n in net.nodes[: net.model_size] if n.op not in ("const", "param", *ROOTS) and n.value != "rst"]
        words.sort(key=lambda n: (bool(n.args), not is_flag(n)))
        self.node_bits, columns = [], []
        for node in words:
            column, width = rows.node_column(node), 1 if is_flag(node) else min(net.node_width(node), 62)
            for bit in range(width) if len(columns) < MOST_BITS else ():
                self.node_bits.append((node, bit))
                columns.append(np.packbits((column >> bit) & 1 != 0))
        self.packed = np.stack(columns)

    def equal(self, need, counts):
        """([numbers of the bits that are `need` in all rows that count], [of those that are its opposite])."""
        want, mask = np.packbits(need), np.packbits(counts)
        at = np.flatnonzero(mask)
        matching_bits = []
        for value in (want, ~want):
            remaining = np.arange(len(self.packed))
            for part in (at[:: max(len(at) // FEW, 1)], at):
                remaining = remaining[~((self.packed[np.ix_(remaining, part)] ^ value[part]) & mask[part]).any(axis=1)]
            matching_bits.append(remaining)
        return matching_bits


def bit_node(net, node, bit):
    """Node of one bit of a node."""
    if is_flag(node):
        return node
    return net.node("and", (net.node("shr", (node, net.const(bit))), net.const(1)))


def is_value(net, uses):
    """Whether a condition with these uses, [(node, argument)], only chooses between constants, or is a flag itself."""
    return bool(uses) and all(
        user.op in ROOTS
        or (user.op in ("land", "lor", "not") and is_value(net, net.users.get(user.id, ())))
        or (user.op == "mux" and k == 0 and all(leaf.op == "const" for leaf in branches(user)))
        for user, k in uses
    )


def condition_bit_hypotheses(net, node):
    """Hypotheses without rows: another bit of a register or input that a condition reads.

    The node is the condition, in all of its uses, or what uses one of several uses.
    """
    if all(decides(*use) for use in net.users.get(node.id, ((node, 1),))):
        yield from _word_bit_hypotheses(net, node, node, lambda flag: flag)
    for k, child in enumerate(node.args):
        if decides(node, k) and len(net.users[child.id]) > 1:
            yield from _word_bit_hypotheses(net, child, node, functools.partial(with_argument, net, node, k))


def _word_bit_hypotheses(net, child, site, build):
    if child.value == "rst" or static(child) is not None:
        return
    for word in net.cone_nodes(child):
        if word.op in ("reg", "in") and not is_flag(word) and net.node_width(word) <= 62:
            for bit in range(net.node_width(word)):
                flag = bit_node(net, word, bit)
                for text, by in ((f"{word!r}[{bit}]", flag), (f"not {word!r}[{bit}]", net.node("not", (flag,)))):
                    if by is not child:
                        yield Hypothesis("condition", f"{text} instead of {child!r}", site, build(by), READ_BIT_COST)


def hypotheses(search, target, inside, picked, wrong):
    """Those on the conditions inside of a target that explain all of its wrong rows; `picked` are some of them."""
    net = search.net
    for child in inside:
        uses = [use for use in net.users.get(child.id, ()) if decides(*use)]
        if child.op in ROOTS or child.value == "rst" or static(child) is not None:
            continue
        if uses and len(uses) == len(net.users[child.id]):
            site_condition_uses = child, child, uses
            yield from _condition_hypotheses(search, target, site_condition_uses, lambda flag: flag, picked, wrong)
        for node, k in uses if len(uses) > 1 or len(net.users[child.id]) > 1 else ():
            if target.root.cone >> node.id & 1:
                build = functools.partial(with_argument, net, node, k)
                yield from _condition_hypotheses(search, target, (node, child, [(node, k)]), build, picked, wrong)


def decisions(search, target, inside, wrong, enough):
    """For each condition inside of a target, (wrong rows that it gives, whether it then is both 0 and 1).

    It is free in each row. Of those alone whose other wrong rows are `enough`.
    """
    net = search.net
    for child in inside:
        uses = [use for use in net.users.get(child.id, ()) if decides(*use)]
        if child.op in ROOTS or child.value == "rst" or not uses:
            continue
        ways = [(child, lambda flag: flag)] if len(uses) == len(net.users[child.id]) else []
        if len(net.users[child.id]) > 1:
            ways += [(node, functools.partial(with_argument, net, node, k)) for node, k in uses]
        for site, build in ways:
            if target.root.cone >> site.id & 1:
                some = wrong[:: max(len(wrong) // SOME, 1)]
                if enough(some[~_condition_explains(search, target, site, build, some)]):
                    explained_rows = _condition_explains(search, target, site, build, wrong)
                    if explained_rows.any() and enough(wrong[~explained_rows]):
                        off, on = _values_by_condition(search, target, site, build, slice(None))
                        need = (target.got == on)[target.compared_mask & (off != on)]
                        yield explained_rows, bool(need.any() and not need.all())


def free_condition_hypotheses(search, target, inside, wrong):
    """Another condition that has, in each row, the value that the design shows: it explains all wrong rows."""
    net = search.net
    for child in inside:
        uses = [use for use in net.users.get(child.id, ()) if decides(*use)]
        if child.op in ROOTS or child.value == "rst" or not uses or static(child) is not None:
            continue
        ways = [(child, lambda flag: flag)] if len(uses) == len(net.users[child.id]) else []
        if len(net.users[child.id]) > 1:
            ways += [(node, functools.partial(with_argument, net, node, k)) for node, k in uses]
        for site, build in ways:
            if not target.root.cone >> site.id & 1 or not _condition_explains(search, target, site, build, wrong).all():
                continue
            off, on = _values_by_condition(search, target, site, build, slice(None))
            decided = target.compared_mask & (off != on)
            if np.any(decided & (off != target.got) & (on != target.got)):
                continue
            flag = search.free(target, child, np.where(decided, on == target.got, search.rows.node_column(child) != 0))
            yield Hypothesis("condition", f"another condition for {child!r}", site, build(flag), FREE_FLAG_COST, True)


def _condition_explains(search, target, site, build, at):
    """Which of some rows the design has with the condition that is 0 or 1 there."""
    off, on = _values_by_condition(search, target, site, build, at)
    return (off != on) & ((off == target.got[at]) | (on == target.got[at]))


def _values_by_condition(search, target, site, build, at):
    """Values of a target at rows with a condition that is 0, and 1."""
    ways = [search.rows.node_values(build(search.net.const(flag)), at) for flag in (0, 1)]
    size = search.count if isinstance(at, slice) else len(at)
    return search.values_with_faults(target, ((site, np.stack([way + np.zeros(size, np.int64) for way in ways])),), at)


def _condition_hypotheses(search, target, site_condition_uses, build, picked, wrong):
    """Hypotheses on one condition: `build` gives what stands for the site with another flag as the condition.

    site_condition_uses  (site, condition, its uses that are varied)
    """
    net, (site, child, uses) = search.net, site_condition_uses
    off, on = _values_by_condition(search, target, site, build, picked)
    if not np.all((off != on) & ((off == target.got[picked]) | (on == target.got[picked]))):
        return
    off, on = _values_by_condition(search, target, site, build, slice(None))
    decided = target.compared_mask & (off != on)
    need = decided & (on == target.got)
    if not decided[wrong].all() or np.any(decided & ~need & (off != target.got)):
        return
    now, read = search.rows.node_column(child) != 0, set(net.cone_nodes(child))

    def fault(what, flag, cost, cause="condition", fitted=True):
        return Hypothesis(cause, what, site, build(flag), cost, fitted)

    for value in (0, 1):
        if not np.any(decided & (need != bool(value))):
            yield fault(f"{'always' if value else 'never'} {child!r}", net.const(value), READ_BIT_COST)
    forms = [(decided, "instead of", lambda flag: flag)]
    if not np.any(need & ~now):
        forms.append((decided & now, "and", lambda flag: net.node("land", (child, flag))))
    if not np.any(decided & ~need & now):
        forms.append((decided & ~now, "or", lambda flag: net.node("lor", (child, flag))))
    for counts, relation, formed in forms:
        for way, numbers in zip(("", "not "), search.bits.equal(need, counts)):
            read_word_bits = [number for number in numbers if search.bits.node_bits[number][0] in read]
            unread_word_bits = [number for number in numbers if search.bits.node_bits[number][0] not in read]
            for number in (*read_word_bits[:MOST_BIT_MATCHES], *unread_word_bits[:MOST_BIT_MATCHES]):
                word, bit = search.bits.node_bits[number]
                flag = bit_node(net, word, bit)
                if flag is not child:
                    cost = EXTRA_BIT_COST if relation != "instead of" else READ_BIT_COST if word in read else FAR
                    what = f"{way}{word!r}[{bit}] {relation} {child!r}"
                    by = formed(net.node("not", (flag,)) if way else flag)
                    yield fault(what, by, cost, fitted=bool(word.args) or not is_flag(word))
                    if relation == "instead of" and is_value(net, uses):
                        yield fault(what, by, cost + 1, "operand")
