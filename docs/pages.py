"""Generated parts of the pages: a line `<!-- generated: NAME -->` of a page becomes a table on the site.

    part(name)         Markdown of PARTS[name], or of the measured tables in a file NAME.json of docs/results
    with_parts(text)   a page with all its parts

    python docs/pages.py            write the one generated file of the repository, docs/boards/paper.toml
    python docs/pages.py --check    exit code 1 if it is stale
Source  docs/architecture.md
"""

import json
import math
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import inference_page  # noqa: E402
import laws_page  # noqa: E402
import measured_pages  # noqa: E402
import ranges_page  # noqa: E402
import rtl_page  # noqa: E402

from analog_frontend.parts.provenance import ASSUMED, PLANT  # noqa: E402
from testbench import config  # noqa: E402
from testbench.commands import reference_tables  # noqa: E402
from testbench.config import Config, Nominal  # noqa: E402
from testbench.config.toml_text import toml_value  # noqa: E402
from testbench.console.markdown import markdown  # noqa: E402
from testbench.console.results import FOLDER, results_markdown  # noqa: E402
from testbench.console.text_table import Table, to_decimals  # noqa: E402
from testbench.judge import judge, phases  # noqa: E402
from testbench.judge.number_verdict import NOT_COMPUTED  # noqa: E402
from testbench.paper import closed_form, judge_table, simulated  # noqa: E402
from testbench.run import budget, run_tables  # noqa: E402
from testbench.run.budget import NODES, PAPER_DEG  # noqa: E402
from testbench.storage.files import write_text  # noqa: E402

MARKER = re.compile(r"^<!-- generated: (\w+) -->$", re.M)
PAPER_JUDGED = FOLDER / "paper_judged.json"


# ---- phase budget ----------------------------------------------------------------------------------------------------


def budget_summary(planned, plain):
    """One row per phase: node phase, loop phase, without the assumptions, and the paper."""
    node, loop, without = planned.node_deg(), planned.loop_deg(), plain.node_deg()
    beside, rows = phases.verdicts(node), []
    for name in NODES:
        ns = sum(row.ns for row in planned.rows[name])
        gap_deg = node[name] - PAPER_DEG[name]
        gap_ns = gap_deg / 360 / planned.frequency_hz * 1e9
        values = (node[name], ns, loop.get(name), without[name], PAPER_DEG[name])
        cells = (to_decimals(value, digits) for value, digits in zip(values, (4, 1, 4, 4, 4)))
        rows.append((name, *cells, f"{gap_deg:+.4f} ({gap_ns:+.0f} ns)", beside[name]["verdict"]))
    heads = ("phase", "node deg", "ns", "loop deg", "without the assumptions deg", "paper deg", "node minus paper",
             "verdict")  # fmt: skip
    return Table("", heads, rows, numeric=(1, 2, 3, 4, 5, 6))


def budget_part():
    """Summary and four tables of the default configuration."""
    planned, plain = budget.budgets(Config())
    parts = [
        f"At {planned.frequency_hz:.1f} Hz and 25 degC.",
        markdown(budget_summary(planned, plain)),
    ]
    for table in run_tables.budget_tables(planned, plain):
        parts += [f"### {table.title.split(', at ')[0].replace('  ', ': ', 1)}", markdown(table)]
    return "\n\n".join(parts)


def lock_part():
    """Where the default loop settles, and what the phases do to the scale factor."""
    device, planned = Config().device(), budget.budget(Config())
    node, loop = planned.node_deg(), planned.loop_deg()
    args = node["xe1"], loop["xe2"]
    offset_mhz = (budget.lock_frequency_hz(device.fx_hz, device.qx, *args) - device.fx_hz) * 1e3
    turned_deg = node["ye1"] + loop["xe2"]
    gain_percent = (1 / math.cos(math.radians(turned_deg)) - 1) * 100
    return (
        f"Default: xe1 + xe2' = {sum(args):.4f} deg, Q = {device.qx:g}: the drive settles {offset_mhz:.3f} mHz "
        "from f_x. "
        f"ye1 + xe2' = {turned_deg:.4f} deg: the scale factor is {gain_percent:+.3f} % of what it would be without."
    )


# What else could make the paper's xe1 and ye1
RIVALS = (
    ("default: re-timed references, one extra frame in the sense path", {}),
    ("the same, with the response of the sense DAC inside its output pole", {"plant.sense_dac_delay_s": 0.0}),
    (
        "no extra frame; first sense pole 980 ns (162 kHz)",
        {"firmware.frame_latency_sense": 0, "plant.sense_pole_1_s": 9.8e-7},
    ),
    ("no extra frame", {"firmware.frame_latency_sense": 0}),
    ("references at 26 MHz, one extra frame", {"firmware.reference_retimed": False}),
    ("references at 26 MHz, no extra frame", {"firmware.reference_retimed": False, "firmware.frame_latency_sense": 0}),
)


def rivals_part():
    """xe1 and ye1 of other hardware beside the paper's."""
    rows = []
    for text, values in RIVALS:
        planned = budget.budget(config.changed(Config(), values))
        deg = planned.node_deg()
        gaps_ns = [(deg[n] - PAPER_DEG[n]) / 360 / planned.frequency_hz * 1e9 for n in ("xe1", "ye1")]
        xe1, ye1 = to_decimals(deg["xe1"], 4), to_decimals(deg["ye1"], 4)
        rows.append((text, xe1, f"{gaps_ns[0]:+.0f} ns", ye1, f"{gaps_ns[1]:+.0f} ns"))
    rows.append(("the paper", to_decimals(PAPER_DEG["xe1"], 4), "", to_decimals(PAPER_DEG["ye1"], 4), ""))
    heads = ("hardware", "xe1 deg", "minus paper", "ye1 deg", "minus paper")
    return markdown(Table("", heads, rows, numeric=(1, 2, 3, 4)))


# ---- the paper's numbers ---------------------------------------------------------------------------------------------


def judged_part():
    """Every number of the paper, judged by what takes no simulation, and the fitted values behind it."""
    rows = judge.rows(closed_form.rounded_default())
    table, keys = judge_table.document(rows)
    return "\n\n".join((judge_table.sentence(rows), markdown(table), markdown(keys)))


def simulated_part():
    """The numbers that take a simulation, judged by the values that a study has left in PAPER_JUDGED."""
    kept = simulated.from_json(json.loads(PAPER_JUDGED.read_text()), Config())
    found, plain = judge.rows(kept), judge.rows(closed_form.rounded_default())
    only = [b for a, b in zip(plain, found) if NOT_COMPUTED in a.basis and NOT_COMPUTED not in b.basis]
    table, _ = judge_table.document(only)
    heads = [k for k, head in enumerate(table.heads) if head != "depends on"]
    rows = [tuple(row[k] for k in heads) for row in table.rows]
    return "\n\n".join(
        (judge_table.sentence(found), markdown(table._replace(heads=tuple(table.heads[k] for k in heads), rows=rows)))
    )


# ---- keys, effects, registers ----------------------------------------------------------------------------------------


def code_cells(table, *columns):
    """The table with these columns as code, without its title: the page has a heading."""
    escaped = [tuple(cell.replace("|", "\\|") for cell in row) for row in table.rows]
    rows = [tuple(f"`{c}`" if k in columns and c else c for k, c in enumerate(row)) for row in escaped]
    return table._replace(title="", rows=rows)


def keys_part():
    """A table of keys for each section."""
    parts = []
    for section in config.sections():
        table = reference_tables.section_table(section)
        parts += [f"### [{section}]", table.title.partition(": ")[2], markdown(code_cells(table, 0, 1, 2))]
    return "\n\n".join(parts)


def effects_part():
    """A row for each effect of the catalogue, with a link to its page."""
    table = reference_tables.effect_table()
    rows = [(i, f"[{key}](../analog_frontend/effects/{key}.py)", *rest) for i, key, *rest in code_cells(table).rows]
    return markdown(table._replace(title="", rows=rows))


def sealed_part():
    """Rates of the published run on sealed records."""
    from tests.sealed import score, strata
    from tests.sealed.__main__ import SCORED

    tables = strata.read()
    _, rows, wide = score.read(SCORED.read_text())
    return score.table(rows, wide, tables.wide["disguises"], tables.effect["d"][0])


# ---- all parts -------------------------------------------------------------------------------------------------------


PARTS = {
    "keys": keys_part,
    "faults": lambda: markdown(code_cells(reference_tables.fault_table(), 0)),
    "target": lambda: markdown(code_cells(reference_tables.target_table(), 0, 1, 2)),
    "effects": effects_part,
    "columns": lambda: markdown(code_cells(reference_tables.column_table(), 0)),
    "register_map": lambda: markdown(code_cells(reference_tables.register_table())),
    "judged": judged_part,
    "simulated": simulated_part,
    "budget": budget_part,
    "lock": lock_part,
    "rivals": rivals_part,
    "rise": laws_page.rise_part,
    "cv_noise_shares": laws_page.shares_part,
    "cv_noise": laws_page.noise_part,
    "thermal_scale": laws_page.scale_part,
    "thermal_bias": laws_page.bias_part,
    "ranges_cases": ranges_page.summary_part,
    "ranges_instances": ranges_page.wiring_part,
    "ranges_registers": ranges_page.registers_part,
    "rtl_mutation": rtl_page.mutation_part,
    "rtl_times": rtl_page.times_part,
    "sealed": sealed_part,
    **{f"inference_{name}": part for name, part in inference_page.PARTS.items()},
    **measured_pages.PARTS,
}


def part(name):
    """Markdown of a part; KeyError for a name that neither PARTS nor docs/results knows."""
    if name in PARTS:
        return PARTS[name]()
    if not (FOLDER / f"{name}.json").is_file():
        raise KeyError(f"no generated part {name!r}: neither in docs/pages.py nor in docs/results")
    return results_markdown(name)


def with_parts(text):
    """A page with its generated parts."""
    return MARKER.sub(lambda found: part(found[1]), text)


# ---- the paper's board -----------------------------------------------------------------------------------------------

PAPER_HEAD = """\
# The paper's board: the defaults of [nominal], written by docs/pages.py from analog_frontend/parts/provenance.py.
# fact: read in a source   derived: from others   fitted: to a number of the paper   assumed: none of these

[nominal]
"""


def paper_board():
    """docs/boards/paper.toml: every default of the nominal board with its source."""
    lines = []
    for key, info in Nominal.model_fields.items():
        kind = PLANT[key].kind if key in PLANT else ASSUMED
        lines.append(f"{key} = {toml_value(info.default)}  # {kind}: {info.description}")
    return PAPER_HEAD + "\n".join(lines) + "\n"


def main(arguments=None):
    """Write docs/boards/paper.toml, or with --check say whether it is stale; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments not in ([], ["--check"]):
        print("usage: python docs/pages.py [--check]", file=sys.stderr)
        return 2
    path = ROOT / "docs" / "boards" / "paper.toml"
    if path.read_text() == paper_board():
        return 0
    if arguments:
        print(f"{path.relative_to(ROOT)} is stale; run: python docs/pages.py", file=sys.stderr)
        return 1
    write_text(path, paper_board())
    print(f"written: {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
