"""The domain of the range proofs: integers as linear forms over atoms, each atom with an interval, and relations.

    value   an int, or Lin: floor((const + sum(coef * atom)) / 2**shift)
    Path    one way through the code: local names, interval of every atom, relations lo <= sum(coef * atom) <= hi

Forms keep what intervals alone lose: y + round(a*(x - y)) is a mean of x and y, and never leaves their hull. Whatever
is not linear (a product of two registers, a mask, a word of a table) becomes an atom of its own.
Source  Cousot, Cousot, POPL 1977 (intervals, widening); Mine, HOSC 2006 (relations); docs/ranges.md
"""

import numpy as np


class Lin:
    """floor((const + sum(coef * atom)) / 2**shift); immutable, at least one term."""

    __slots__ = ("const", "shift", "terms")

    def __init__(self, const, terms, shift=0):
        self.const, self.terms, self.shift = const, terms, shift

    def __eq__(self, other):
        return (
            isinstance(other, Lin)
            and self.terms == other.terms
            and self.const == other.const
            and self.shift == other.shift
        )

    def __hash__(self):
        return hash((self.const, self.terms, self.shift))


def _add_terms(a, b, k):
    """Terms of a + k*b."""
    coef_by_atom = dict(a)
    for atom, coef in b:
        coef_by_atom[atom] = coef_by_atom.get(atom, 0) + k * coef
    return tuple(sorted((atom, coef) for atom, coef in coef_by_atom.items() if coef))


def form(const, terms, shift=0):
    """A value in its simplest spelling."""
    if not terms:
        return const >> shift
    if shift and all(coef % (1 << shift) == 0 for _, coef in terms):
        return Lin(const >> shift, tuple((atom, coef >> shift) for atom, coef in terms))
    return Lin(const, terms, shift)


def _split_shift(x):
    """(whole part, shifted part) of a shifted sum: terms that the shift divides need not be under it."""
    unit = 1 << x.shift
    outer = tuple((atom, coef >> x.shift) for atom, coef in x.terms if coef % unit == 0)
    non_multiple_terms = tuple((atom, coef) for atom, coef in x.terms if coef % unit)
    return Lin(x.const >> x.shift, outer), Lin(x.const % unit, non_multiple_terms, x.shift)


class Run:
    """Atoms of one evaluation: the same operation on the same operands is the same atom."""

    def __init__(self):
        self.count = 0
        self.known = {}
        self.images = {}  # atom -> (root atom, what it is for each word of the root's table)
        self.choices = {}  # atom -> [(value, its interval)], where it is one of several values
        self.powers = {}  # atom -> (a, n), where it is a << n

    def fresh(self):
        self.count += 1
        return self.count

    def atom(self, key):
        if key not in self.known:
            self.known[key] = self.fresh()
        return self.known[key]


class Path:
    """Local names, intervals and relations on one way through the code."""

    __slots__ = ("bounds", "env", "relations", "run")

    def __init__(self, run, env=None, bounds=None, relations=()):
        self.run, self.relations = run, relations
        self.env = {} if env is None else env
        self.bounds = {} if bounds is None else bounds

    def copy(self, env=None):
        return Path(self.run, dict(self.env) if env is None else env, dict(self.bounds), self.relations)

    # ---- intervals ---------------------------------------------------------------------------------------------------

    def _atom_interval(self, const, terms):
        lo = hi = const
        bounds = self.bounds
        for atom, coef in terms:
            least, most = bounds[atom]
            if coef > 0:
                lo += coef * least
                hi += coef * most
            else:
                lo += coef * most
                hi += coef * least
        return lo, hi

    def _relation_interval(self, const, terms, depth):
        """Interval of a sum by itself, by the table behind it, and less a multiple of each relation."""
        lo, hi = self._atom_interval(const, terms)
        images = self.run.images
        if len(terms) > 1 and terms[0][0] in images:
            roots = {images[atom][0] if atom in images else None for atom, _ in terms}
            if len(roots) == 1 and None not in roots:
                words = const + sum(coef * images[atom][1] for atom, coef in terms)
                lo, hi = max(lo, int(words.min())), min(hi, int(words.max()))
        if not depth or lo == hi:
            return lo, hi
        for relation, least, most in self.relations:
            tried = set()
            relation_coefs = dict(relation)
            for atom, coef in terms:
                if atom not in relation_coefs:
                    continue
                k, odd = divmod(coef, relation_coefs[atom])
                if odd or k in tried:
                    continue
                tried.add(k)
                low, high = self._relation_interval(const, _add_terms(terms, relation, -k), depth - 1)
                low, high = (low + k * least, high + k * most) if k > 0 else (low + k * most, high + k * least)
                lo, hi = max(lo, low), min(hi, high)
        return lo, hi

    def value_interval(self, x):
        """(lowest, highest) of a value."""
        if not isinstance(x, Lin):
            return int(x), int(x)
        lo, hi = self._relation_interval(x.const, x.terms, 2)
        if not x.shift:
            return lo, hi
        lo, hi = lo >> x.shift, hi >> x.shift
        outer, shifted_part = _split_shift(x)
        atom = self.run.known.get((">>", shifted_part))
        if atom in self.bounds:
            # a condition may have narrowed the atom that the shifted part became
            least, most = self._relation_interval(outer.const, _add_terms(outer.terms, ((atom, 1),), 1), 2)
            lo, hi = max(lo, least), min(hi, most)
        return lo, hi

    def value(self, x):
        """The same value, as an int where only one is possible."""
        if isinstance(x, Lin):
            lo, hi = self.value_interval(x) if x.shift else self._atom_interval(x.const, x.terms)
            if lo == hi:
                return lo
        return x

    def new(self, lo, hi, key=None):
        """An atom within lo .. hi; an int if that leaves one."""
        atom = self.run.fresh() if key is None else self.run.atom(key)
        if atom in self.bounds:
            least, most = self.bounds[atom]
            lo, hi = max(lo, least), min(hi, most)
            hi = max(lo, hi)  # nothing left: no such execution, any value is right
        self.bounds[atom] = (lo, hi)
        return Lin(0, ((atom, 1),)) if lo != hi else lo

    # ---- arithmetic --------------------------------------------------------------------------------------------------

    def remove_shift(self, x):
        """The value without a shift: a shifted sum becomes an atom."""
        if not isinstance(x, Lin) or not x.shift:
            return x
        outer, shifted_part = _split_shift(x)
        atom_value = self.new(*self.value_interval(shifted_part), key=(">>", shifted_part))
        image = self._table_image(Lin(shifted_part.const, shifted_part.terms))
        if image is not None and isinstance(atom_value, Lin):
            self.run.images[atom_value.terms[0][0]] = (image[0], image[1] >> x.shift)
        return self.add(outer, atom_value) if outer.terms or outer.const else atom_value

    def _table_image(self, x):
        """(root, words) of a value that is made of one table alone, or None."""
        root_image = self.run.images.get(x.terms[0][0]) if isinstance(x, Lin) and len(x.terms) == 1 else None
        return None if root_image is None or x.shift else (root_image[0], x.const + x.terms[0][1] * root_image[1])

    def add(self, a, b, k=1):
        """a + k*b."""
        if not isinstance(a, Lin) and not isinstance(b, Lin):
            return a + k * b
        if k != 1 or (isinstance(a, Lin) and isinstance(b, Lin) and a.shift and b.shift):
            b = self.remove_shift(b)
            if not isinstance(a, Lin) and not isinstance(b, Lin):
                return a + k * b
        if isinstance(b, Lin) and b.shift:
            a, b = b, a
        if not isinstance(a, Lin):
            return form(a + k * b.const, tuple((atom, k * coef) for atom, coef in b.terms))
        if not isinstance(b, Lin):
            return form(a.const + (k * b << a.shift), a.terms, a.shift)
        up = k << a.shift
        return form(a.const + up * b.const, _add_terms(a.terms, b.terms, up), a.shift)

    def mul(self, a, b):
        a, b = self.value(a), self.value(b)
        if not isinstance(a, Lin) and not isinstance(b, Lin):
            return a * b
        if not isinstance(a, Lin):
            a, b = b, a
        if not isinstance(b, Lin):
            return self.add(0, a, b)
        a, b = self.remove_shift(a), self.remove_shift(b)
        (al, ah), (bl, bh) = self.value_interval(a), self.value_interval(b)
        corners = (al * bl, al * bh, ah * bl, ah * bh)
        if a == b:
            low = 0 if al <= 0 <= ah else min(al * al, ah * ah)
            return self.new(low, max(corners), key=("*", a, b))
        product = self.new(min(corners), max(corners), key=("*", a, b))
        if self.relations and isinstance(product, Lin):
            # (a - al)(bh - b) >= 0 and (a - al)(b - bl) >= 0, without their products
            self.assume(self.add(self.add(product, a, -bh), b, -al), hi=-al * bh)
            self.assume(self.add(self.add(product, a, -bl), b, -al), lo=-al * bl)
        return product

    def shl(self, a, n):
        return a << n if not isinstance(a, Lin) else self.add(0, self.remove_shift(a), 1 << n)

    def shr(self, a, n):
        return a >> n if not isinstance(a, Lin) else form(a.const, a.terms, a.shift + n)

    def bitwise(self, op, a, b):
        """a & b, a | b, a ^ b."""
        a, b = self.value(a), self.value(b)
        if not isinstance(a, Lin) and not isinstance(b, Lin):
            return {"&": a & b, "|": a | b, "^": a ^ b}[op]
        (al, ah), (bl, bh) = self.value_interval(a), self.value_interval(b)
        if al >= 0 and bl >= 0 and op == "&":
            for x, top, mask in ((a, ah, b), (b, bh, a)):
                if not isinstance(mask, Lin) and mask & (mask + 1) == 0 and top <= mask:
                    return x
            lo, hi = 0, min(ah, bh)
        elif op == "&" and (al >= 0 or bl >= 0):
            lo, hi = 0, ah if al >= 0 else bh
        elif al >= 0 and bl >= 0:
            lo, hi = (max(al, bl) if op == "|" else 0), (1 << max(ah.bit_length(), bh.bit_length())) - 1
        else:
            top = max((x if x >= 0 else -x - 1).bit_length() for x in (al, ah, bl, bh))
            lo, hi = -(1 << top), (1 << top) - 1
        a, b = self.remove_shift(a), self.remove_shift(b)
        image = None
        if op == "&" and not isinstance(b, Lin) and (image := self._table_image(a)) is not None:
            words = image[1] & b
            lo, hi = max(lo, int(words.min())), min(hi, int(words.max()))
        bitwise_value = self.new(lo, hi, key=(op, a, b))
        if image is not None and isinstance(bitwise_value, Lin):
            self.run.images[bitwise_value.terms[0][0]] = (image[0], words)
        return bitwise_value

    def magnitude(self, a):
        """abs(a)."""
        lo, hi = self.value_interval(a)
        if lo >= 0:
            return a
        if hi <= 0:
            return self.add(0, a, -1)
        return self.new(0, max(-lo, hi), key=("abs", self.remove_shift(a)))

    def word(self, table, index):
        """table[index]: the words that the index can reach."""
        lo, hi = self.value_interval(index)
        words = np.asarray(table[lo : hi + 1], np.int64)
        table_value = self.new(int(words.min()), int(words.max()))
        if isinstance(table_value, Lin):
            atom = table_value.terms[0][0]
            self.run.images[atom] = (atom, words)
        return table_value

    # ---- conditions --------------------------------------------------------------------------------------------------

    def _push(self, terms, lo, hi):
        """Narrow each atom of lo <= sum <= hi; False if nothing is left."""
        least, most = self._atom_interval(0, terms)
        for atom, coef in terms:
            low, high = self.bounds[atom]
            term_interval = (coef * low, coef * high) if coef > 0 else (coef * high, coef * low)
            term_lo, term_hi = lo - (most - term_interval[1]), hi - (least - term_interval[0])  # of coef * atom
            if coef > 0:
                new = (max(low, -(-term_lo // coef)), min(high, term_hi // coef))
            else:
                new = (max(low, -(-term_hi // coef)), min(high, term_lo // coef))
            if new[0] > new[1]:
                return False
            if new != (low, high):
                self.bounds[atom] = new
                if atom in self.run.powers and not self._narrow_shift(atom, *new):
                    return False
                least, most = self._atom_interval(0, terms)
        return True

    def _narrow_shift(self, atom, lo, hi):
        """Narrow n where atom = a << n lies in lo .. hi."""
        a, n = self.run.powers[atom]
        fit = [k for k in range(self.value_interval(n)[0], self.value_interval(n)[1] + 1) if lo <= a << k <= hi]
        return bool(fit) and self.assume(n, fit[0], fit[-1])

    def assume(self, x, lo=None, hi=None):
        """Keep only lo <= x <= hi; False if that is impossible."""
        x = self.remove_shift(x)
        least, most = self.value_interval(x)
        lo, hi = least if lo is None else max(lo, least), most if hi is None else min(hi, most)
        if lo > hi:
            return False
        if not isinstance(x, Lin) or (lo, hi) == (least, most):
            return True
        low, high = lo - x.const, hi - x.const
        if not self._push(x.terms, low, high):
            return False
        if len(x.terms) > 1:
            self.relations = (*self.relations, (x.terms, low, high))
        return all(self._push(*relation) for relation in self.relations)

    def compare(self, op, a, b):
        """Keep only `a op b`, op one of < <= > >= == !=; False if that is impossible."""
        less = self.add(self.remove_shift(a), self.remove_shift(b), -1)
        if op == "!=":
            lo, hi = self.value_interval(less)
            if lo == hi == 0:
                return False
            return self.assume(less, lo=1 if lo == 0 else None, hi=-1 if hi == 0 else None)
        ends = {"<": (None, -1), "<=": (None, 0), ">": (1, None), ">=": (0, None), "==": (0, 0)}[op]
        return self.assume(less, *ends)


# ---- joins -----------------------------------------------------------------------------------------------------------


def _join_values(path, path_value_pairs):
    """One value of several (path, value), valid in the joined `path`."""
    first = path_value_pairs[0][1]
    if all(value is first for _, value in path_value_pairs):
        return first
    if isinstance(first, tuple) and all(type(v) is type(first) and len(v) == len(first) for _, v in path_value_pairs):
        items = [_join_values(path, [(p, v[k]) for p, v in path_value_pairs]) for k in range(len(first))]
        return type(first)(*items) if hasattr(first, "_fields") else tuple(items)
    if not all(isinstance(value, (int, Lin)) for _, value in path_value_pairs):
        raise TypeError(f"no join of {first!r} and {path_value_pairs[-1][1]!r}")
    if all(value == first for _, value in path_value_pairs):
        return first
    spans = [p.value_interval(value) for p, value in path_value_pairs]
    joined = path.new(min(lo for lo, _ in spans), max(hi for _, hi in spans))
    if isinstance(joined, Lin):
        path.run.choices[joined.terms[0][0]] = [(value, span) for (_, value), span in zip(path_value_pairs, spans)]
    return joined


def join(path_value_pairs, env=None):
    """(path, value) that covers several; local names are joined unless `env` is given."""
    if len(path_value_pairs) == 1:
        path, value = path_value_pairs[0]
        return (path if env is None else path.copy(env)), value
    paths = [path for path, _ in path_value_pairs]
    bounds = {}
    other_bounds = [path.bounds for path in paths[1:]]
    for atom, ends in paths[0].bounds.items():
        for other in other_bounds:
            theirs = other.get(atom)
            if theirs is None:
                break
            if theirs is not ends:  # most atoms are the same tuple in all paths
                ends = (min(ends[0], theirs[0]), max(ends[1], theirs[1]))
        else:
            bounds[atom] = ends
    shared_relations = tuple(r for r in paths[0].relations if all(r in other.relations for other in paths[1:]))
    joined = Path(paths[0].run, {}, bounds, shared_relations)
    if env is None:
        shared = [name for name in paths[0].env if all(name in other.env for other in paths[1:])]
        env = {name: _join_values(joined, [(p, p.env[name]) for p in paths]) for name in shared}
    joined.env = env
    return joined, _join_values(joined, path_value_pairs)
