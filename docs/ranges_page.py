"""The generated tables of docs/ranges.md: all cases, the instances in control and top, registers of each block."""

import re

from testbench.golden.ranges import range_wiring, ranges
from testbench.golden.stimulus import blocks


def _bits(found):
    return str(found.widest.bits) if found.widest else "-"


def _markdown(heads, rows, numeric):
    lines = [f"| {' | '.join(heads)} |", f"|{'|'.join('---:' if k in numeric else '---' for k in range(len(heads)))}|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def summary_part():
    """Table of all cases for docs/ranges.md."""
    rows = []
    for block in blocks.BLOCKS.values():
        for case in block.cases:
            found = ranges.analyse_case(block.stem, case)
            spare = [one.headroom for one in found.registers if one.headroom is not None]
            expression = f"`{found.widest.text}` in {found.widest.function}" if found.widest else "-"
            rows.append(
                (block.stem, case, f"{len(spare)} of {len(found.registers)}", str(spare.count(0)), _bits(found),
                 expression.replace("|", "\\|"))
            )  # fmt: skip
    heads = ("block", "case", "registers proven", "without headroom", "widest bits", "widest result")
    return _markdown(heads, rows, (3, 4))


def registers_part():
    """Tables of the registers of each block's first case; a tuple of registers is one row."""
    parts = []
    for block in blocks.BLOCKS.values():
        case = next(iter(block.cases))
        rows = {}
        for one in ranges.analyse_case(block.stem, case).registers:
            key = (re.sub(r"_\d+$", "", one.name), one.fmt, one.proven)
            rows.setdefault(key, []).append(one)
        cells = []
        for (base, fmt, proven), found in rows.items():
            name = found[0].name if len(found) == 1 else f"{base}_*"
            lo, hi = proven or ("width only", "width only")
            cells.append((name, str(fmt), str(lo), str(hi), str(found[0].headroom)))
        heads = ("register", "format", "proven min", "proven max", "headroom bits")
        parts.append(f"### {block.stem}, case {case}\n\n{_markdown(heads, cells, (2, 3, 4))}")
        if ranges.relations_text(block):
            parts[-1] += f"\n\nRelations: {'; '.join(f'`{one}`' for one in ranges.relations_text(block))}."
    return "\n\n".join(parts)


def wiring_part():
    """Table of the instances in control and top for docs/ranges.md."""
    rows = []
    for name, one in range_wiring.instances().items():
        tight = min(one.links, key=lambda link: link.spare)
        ends = f"{tight.port} {tight.lo} .. {tight.hi} in {tight.fmt}"
        proven = sum(r.proven is not None for r in one.analysis.registers)
        fit = sum(link.fits_format for link in one.links)
        rows.append((name, one.stem, f"{proven} of {len(one.analysis.registers)}", f"{fit} of {len(one.links)}", ends,
                     _bits(one.analysis)))  # fmt: skip
    heads = ("instance", "block", "registers proven", "inputs inside", "tightest input", "widest bits")
    return _markdown(heads, rows, (5,))
