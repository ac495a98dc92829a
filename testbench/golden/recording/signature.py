"""Signature of many rows in 64 bits: the remainder of all their bits, as a polynomial over GF(2).

    row        its ports side by side as in exp.hex, the first in the most significant bits; zeros in front of it make
               its length a multiple of 64
    signature  = rows one after the other, read as a polynomial, modulo P = x^64 + x^4 + x^3 + x + 1

P is primitive, so x has order 2^64 - 1: one or two wrong bits, wherever they are in a frame, and any wrong bits within
64 of one another always show; anything else is missed once in 2^64. A plain MISR, which adds all rows at the same
places and shifts by one, would miss a bit that is followed by its neighbour one clock later.

However it is computed, the remainder is the same. By chunks of m <= 60 bits, one after the other:

    h = sig >> (64 - m),  g = h ^ h << 1,  sig' = (sig << m) ^ chunk ^ g ^ g << 3     (P - x^64 = (x + 1)(x^3 + 1))

Or by whole rows, modulo P^128 = x^8192 + x^512 + x^384 + x^128 + 1, in which P divides: with a row of w words the old
remainder S moves w words up, and what leaves it, t, comes back 0, 2, 6 and 8 words from the right.
Source  docs/golden.md (signatures)
"""

import functools

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from fpga_model.jit import DISABLED, hot
from testbench.flatten import leaves

DEGREE = 64
TAPS = (4, 3, 1, 0)
POLYNOMIAL = 1 << DEGREE | sum(1 << k for k in TAPS)
CHUNK = DEGREE - max(TAPS)  # bits that one fold can take
POWER = 128
WORDS = POWER  # of the remainder modulo P^128
BACK = tuple(POWER * k // DEGREE for k in TAPS)  # words from the right at which what leaves comes back
MASK = (1 << DEGREE) - 1


def padded_width(width):
    """Bits that a row of `width` bits takes in the stream."""
    return -(-width // DEGREE) * DEGREE


def fold_word(word, width, sig=0):
    """Signature after `word`, a Python integer of `width` bits, has been appended to what gave `sig`."""
    for low in range((width - 1) // CHUNK * CHUNK, -1, -CHUNK):
        chunk_bits = min(CHUNK, width - low)
        high = sig >> (DEGREE - chunk_bits)
        high ^= high << 1
        sig = (sig << chunk_bits & MASK) ^ (word >> low & ((1 << chunk_bits) - 1)) ^ high ^ high << 3
    return sig


def signature(words, width):
    """Signature of packed rows of `width` bits: the plain definition, slow."""
    sig = 0
    for word in words:
        sig = fold_word(word, padded_width(width), sig)
    return sig


def remainder_signature(words):
    """Signature from the remainder modulo P^128, int64 words with the least significant first."""
    word = 0
    for k, value in enumerate(words.tolist()):
        word |= (value & MASK) << (DEGREE * k)
    return fold_word(word, DEGREE * len(words))


# ---- any layout of rows, in NumPy ------------------------------------------------------------------------------------


def _times(a, b):
    """Product of two signatures, as polynomials modulo P."""
    word = 0
    for k in range(DEGREE):
        word ^= (a << k) * (b >> k & 1)
    return fold_word(word, 2 * DEGREE)


def _monomial_remainder(k):
    """x^k modulo P."""
    product, square = 1, 2
    while k:
        product = _times(product, square) if k & 1 else product
        square, k = _times(square, square), k >> 1
    return product


@functools.cache
def _products(step):
    """x^(step + k) modulo P, for each bit k of a signature that moves up by `step` bits."""
    return [np.uint64(_monomial_remainder(step + k)) for k in range(DEGREE)]


def rows_signature(rows, widths):
    """Signature of int64 rows with columns of these widths: every row alone, then rows in pairs, pairs of pairs."""
    words = [np.zeros(len(rows), np.uint64) for _ in _plan(widths)]
    for word, parts in zip(words, _plan(widths), strict=True):
        for leaf, right, part_bits, word_bit in parts:
            word |= ((rows[:, leaf].astype(np.uint64) >> right) & ((1 << part_bits) - 1)) << word_bit
    sig, half = np.zeros(len(rows), np.uint64), DEGREE // 2
    for chunk in (part for word in words[::-1] for part in (word >> half, word & ((1 << half) - 1))):
        high = sig >> half
        high ^= high << 1
        sig = (sig << half) ^ chunk ^ high ^ (high << 3)
    step = DEGREE * len(words)
    while len(sig) > 1:
        sig = np.concatenate([np.zeros(len(sig) % 2, np.uint64), sig])
        shifted_signatures = np.zeros(len(sig) // 2, np.uint64)
        for k, product in enumerate(_products(step)):
            shifted_signatures ^= ((sig[::2] >> k) & 1) * product
        sig, step = shifted_signatures ^ sig[1::2], 2 * step
    return int(sig[0])


def frame_signatures(words, clocks):
    """Signatures, uint64, of every `clocks` rows of one word each, of at most CHUNK bits."""
    signatures = np.zeros(len(words) // clocks, np.uint64)
    with np.errstate(over="ignore"):
        _fold(words.astype(np.uint64), clocks, signatures)
    return signatures


@hot
def _fold(words, clocks, signatures):
    for frame in range(signatures.shape[0]):
        sig = np.uint64(0)
        for n in range(frame * clocks, (frame + 1) * clocks):
            # a word has DEGREE bits: the zeros in front, and a chunk
            for chunk_bits, chunk in ((DEGREE - CHUNK, np.uint64(0)), (CHUNK, words[n])):
                high = sig >> np.uint64(DEGREE - chunk_bits)
                high ^= high << np.uint64(1)
                sig = (sig << np.uint64(chunk_bits)) ^ chunk ^ high ^ (high << np.uint64(3))
        signatures[frame] = sig


# ---- compiled for one layout -----------------------------------------------------------------------------------------


def _plan(widths):
    """For each word of a row, from the right, the parts (leaf, right shift, length, left shift) that fill it."""
    plan = [[] for _ in range(-(-sum(widths) // DEGREE))]
    row_bit = 0
    for leaf in range(len(widths) - 1, -1, -1):
        leaf_bit = 0
        while leaf_bit < widths[leaf]:
            word, bit = divmod(row_bit, DEGREE)
            part_bits = min(widths[leaf] - leaf_bit, DEGREE - bit)
            plan[word].append((leaf, leaf_bit, part_bits, bit))
            leaf_bit += part_bits
            row_bit += part_bits
    return tuple(tuple(parts) for parts in plan)


def appender(widths):
    """Function (buffer, at, record) for compiled code: a row is appended to the remainder in an int64 array.

    widths  of the leaves of `record`, in row order

    The remainder occupies buffer[at : at + WORDS], least significant word first; afterwards it begins one row lower,
    at `at` minus the row's words. All shifts are constants in the code: loops over two hundred registers would cost
    ten times what the edge does that made them.
    """
    plan = _plan(widths)
    count = len(plan)
    if count + max(BACK) > WORDS:
        raise ValueError(f"signature: rows of {count} words, at most {WORDS - max(BACK)} can be appended at once")

    def python(buffer, at, record):
        word = 0
        for width, (_, value) in zip(widths, leaves(record), strict=True):
            word = word << width | (int(value) & ((1 << width) - 1))
        first = at - count
        for k in range(count):
            value = word >> (DEGREE * k) & MASK
            buffer[first + k] = value - (1 << DEGREE) if value >> (DEGREE - 1) else value
        leaving = buffer[first + WORDS : first + WORDS + count].copy()
        for back in BACK:
            buffer[first + back : first + back + count] ^= leaving

    if DISABLED:
        return python

    @intrinsic
    def native(typingctx, buffer, at, record):
        def codegen(context, builder, signature, args):
            i64 = ir.IntType(64)
            array = context.make_array(signature.args[0])(context, builder, args[0])
            first = builder.sub(args[1], ir.Constant(i64, count))
            values = []

            def append_leaf_values(kind, value):
                if isinstance(kind, types.NoneType):
                    return
                if isinstance(kind, types.BaseTuple):
                    for k, item in enumerate(kind.types):
                        append_leaf_values(item, builder.extract_value(value, k))
                    return
                values.append(context.cast(builder, value, kind, types.int64))

            def word_pointer(offset):
                return builder.gep(array.data, [builder.add(first, ir.Constant(i64, offset))])

            append_leaf_values(signature.args[2], args[2])
            if len(values) != len(widths):
                raise ValueError(f"signature: {len(values)} registers, {len(widths)} widths")
            for k, parts in enumerate(plan):
                word = ir.Constant(i64, 0)
                for leaf, right, part_bits, word_bit in parts:
                    part = builder.lshr(values[leaf], ir.Constant(i64, right))
                    part = builder.and_(part, ir.Constant(i64, (1 << part_bits) - 1))
                    word = builder.or_(word, builder.shl(part, ir.Constant(i64, word_bit)))
                builder.store(word, word_pointer(k))
            row = ir.VectorType(i64, count).as_pointer()
            leaving = builder.load(builder.bitcast(word_pointer(WORDS), row), align=8)
            for back in BACK:
                pointer = builder.bitcast(word_pointer(back), row)
                builder.store(builder.xor(builder.load(pointer, align=8), leaving), pointer, align=8)
            return context.get_dummy_value()

        return types.void(buffer, at, record), codegen

    return native
