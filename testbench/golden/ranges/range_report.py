"""Range report of a case: proven beside seen, headroom, and the 63-bit proof, as data and as text.

    gyro golden ranges BLOCK|all [--json]      every bundle holds the same as RANGES.md and as `ranges` in its manifest

Source  docs/ranges.md
"""

import numpy as np

from fpga_model.fixed import MAX_WIDTH
from testbench.golden.ranges import ranges
from testbench.golden.stimulus import blocks, stimulus


def _ends(pair):
    return None if pair is None else list(pair)


def column_min_max(rows):
    """[lowest, highest] of each column; None without rows."""
    if not len(rows):
        return [None] * rows.shape[1]
    return [list(pair) for pair in zip(rows.min(axis=0).tolist(), rows.max(axis=0).tolist())]


def range_entry(block, case, regs, pins):
    """The `ranges` of a manifest.

    regs, pins  what the case's vectors made of them, a column each
    """
    range_analysis = ranges.analyse_cached(block.stem, block.cases[case], block.design)
    port_entries = []
    for one, span in zip(
        (*range_analysis.registers, *range_analysis.pins), column_min_max(np.column_stack([regs, pins])), strict=True
    ):
        port_entries.append(
            {
                "name": one.name,
                "fmt": list(one.fmt),
                "proven": _ends(one.proven),
                "seen": span,
                "headroom_bits": one.headroom,
                "proof": "width only" if one.proven is None else "induction",
            }
        )
    widest = range_analysis.widest
    return {
        "ports": port_entries,
        "relations": ranges.relations_text(block),
        "widest": widest and {"bits": widest.bits, "lo": widest.lo, "hi": widest.hi, "in": widest.function,
                              "expression": widest.text},
        "limit_bits": MAX_WIDTH,
        "results": len(range_analysis.results),
        "proven": range_analysis.sound,
    }  # fmt: skip


def case_range_entry(block, case):
    """`entry` with the vectors that `export` would write."""
    stim, _ = stimulus.make(block, case)
    return range_entry(block, case, *blocks.run(block, case, stim))


def _aligned_table_lines(rows):
    """Text columns: the first to the left, the others to the right."""
    sizes = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.ljust(size) if k < 2 else cell.rjust(size) for k, (cell, size) in enumerate(zip(row, sizes))]
        lines.append("  ".join(cells).rstrip())
    return lines


def verdict(data):
    """One line: what is proven, and the widest result."""
    open_ports = [one["name"] for one in data["ports"] if one["proven"] is None]
    proof_text = f"not proven: {', '.join(open_ports)}" if open_ports else f"all {len(data['ports'])} ports proven"
    widest = data["widest"]
    if widest is None:
        return f"{proof_text}; no arithmetic"
    fits = "within" if widest["bits"] <= data["limit_bits"] else "ABOVE"
    return (
        f"{proof_text}; {data['results']} arithmetic results {fits} {data['limit_bits']} bits, "
        f"the widest {widest['bits']}: {widest['expression']} in {widest['in']}"
    )


def text(title, data):
    """The report of a case; also RANGES.md of its bundle."""
    rows = [("register", "format", "proven min", "proven max", "seen min", "seen max", "headroom bits")]
    for one in data["ports"]:
        ends = [str(x) for x in one["proven"] or ("-", "-")] + [str(x) for x in one["seen"] or ("-", "-")]
        spare = "width only" if one["proven"] is None else str(one["headroom_bits"])
        s, i, f = one["fmt"]
        rows.append((one["name"], f"[{s},{i},{f}]", *ends, spare))
    lines = [f"# Ranges of {title}", "", verdict(data) + "."]
    if data["relations"]:
        lines.append("Relations proven with them: " + ";  ".join(data["relations"]) + ".")
    lines += ["", *(f"    {line}" for line in _aligned_table_lines(rows)), ""]
    lines.append("Proven: for every input in its format and a reset at any edge. Seen: in the vectors of this bundle.")
    return "\n".join(lines) + "\n"
