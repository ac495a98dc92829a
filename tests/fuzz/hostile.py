"""Hostile values, and changes of bytes, texts and trees: what damaged or malicious files hold."""

import copy
import json

MODULE, LIBRARY, PLANT = "tests.fuzz.evil", "evil.so", "evil_plant.py"  # `watch` finds whoever runs them
NUMBERS = (
    0, -1, 1, 2, 255, -(1 << 31), 1 << 31, (1 << 53) + 1, -(1 << 63), (1 << 63) - 1, 1 << 63, 1 << 64, 10**30, 0.5,
    -0.0, 1e-320, 1e300, -1e300, float("nan"), float("inf"), float("-inf"), True, False,
)  # fmt: skip
TEXTS = (
    "", " ", "x", "\0", "a\nb", "nan", "inf", "1e400", "-1", "9" * 5000, "x" * 100_000, "../../etc/passwd",
    "/dev/zero", "°ü漢", "\ud800".encode("utf-8", "surrogatepass").decode("latin-1"), "{}", "[]", f"{MODULE}:OBJECT",
    LIBRARY, "[1:0]", "tb.clk", "rate_word",
)  # fmt: skip
# Words that stand for a number in a text: some are no JSON, TOML or float
WORDS = (
    "1e400", "-1e400", "nan", "inf", "-inf", "9" * 5000, "0x1", "1_0", "--1", "", "1e-400", "\u0661", "1,5", "0" * 200,
    "NaN", "1.7976931348623157e308", "-0", "1e999999999", "[", "]", "{", '"', "#", "%", "$end", "\t", ";", "\0",
)  # fmt: skip


def deep(depth=2000):
    """A list in a list in a list."""
    out = []
    for _ in range(depth):
        out = [out]
    return out


def value(rng):
    """Any hostile value that JSON can hold."""
    kind = rng.randrange(8)
    if kind < 3:
        return rng.choice(NUMBERS)
    if kind < 5:
        return rng.choice(TEXTS)
    return rng.choice([None, [], {}, [[]], {"": None}, [None] * 3, {"x": {"x": 1}}, [0] * 1000, deep(50)])


def damaged(rng, data):
    """Bytes with a few of them changed, cut off, doubled or put elsewhere."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        at, how = rng.randrange(len(out) + 1), rng.randrange(7)
        size = min(rng.choice((1, 2, 4, 8, 64, 1000)), len(out) - at)
        if how == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            out[at : at + size] = bytes(rng.randrange(256) for _ in range(size))
        elif how == 2:
            out[at : at + size] = rng.choice((b"\0", b"\xff", b"\x7f", b"\x80")) * size
        elif how == 3:
            del out[at : at + size]
        elif how == 4:
            out[at:at] = out[at : at + size]
        elif how == 5:
            del out[rng.randrange(len(out) + 1) :]
        else:
            other = rng.randrange(len(out) + 1)
            out[at : at + size] = out[other : other + size]
    return bytes(out)


def retyped(rng, text, separators=" ,;\t"):
    """Text with a few of its words or lines replaced, dropped, doubled or swapped."""
    lines = text.split("\n")
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, how = rng.randrange(len(lines)), rng.randrange(6)
        if how < 3:
            separator = next((s for s in separators if s in lines[at]), " ")
            words = lines[at].split(separator)
            words[rng.randrange(len(words))] = rng.choice(WORDS)
            lines[at] = separator.join(words)
        elif how == 3:
            lines[at:at] = lines[at : at + 1] * rng.choice((1, 2, 100))
        elif how == 4 and len(lines) > 1:
            del lines[at]
        else:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines)


def places(tree, place=()):
    """Places of everything in a tree of dictionaries and lists."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, item in items:
        yield (*place, key)
        yield from places(item, (*place, key))


def regrown(rng, tree):
    """A copy of a tree with one to three of its places changed, dropped, doubled or renamed."""
    out = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        known = list(places(out))
        if not known:
            return out
        *path, key = rng.choice(known)
        node = out
        for step in path:
            node = node[step]
        how = rng.randrange(8)
        if how < 5:
            node[key] = value(rng)
        elif how == 5:
            del node[key]
        elif how == 6 and isinstance(node, dict):
            node[rng.choice(TEXTS)] = node[key]
        elif isinstance(node, list):
            node += node[: rng.choice((1, 100))]
        else:
            node[key] = copy.deepcopy(out)
    return out


def toml(tree):
    """TOML of a tree: what JSON and TOML share, inline below the first two levels. None has no TOML: an empty list."""
    lines = [f"{json.dumps(str(key))} = {_inline(item)}" for key, item in tree.items() if not isinstance(item, dict)]
    for key, item in tree.items():
        if isinstance(item, dict):
            lines += [f"[{json.dumps(str(key))}]", *(f"{json.dumps(str(k))} = {_inline(v)}" for k, v in item.items())]
    return "\n".join(lines) + "\n"


def _inline(item):
    if isinstance(item, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_inline(v)}" for key, v in item.items()) + "}"
    if isinstance(item, list):
        return "[" + ", ".join(_inline(v) for v in item) + "]"
    if item is None:
        return "[]"
    return json.dumps(item).replace("NaN", "nan").replace("Infinity", "inf")
