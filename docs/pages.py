"""Generated parts of the pages: what the code knows is written by the code.

    docs/blocks/registers.md    the register map                   fpga_model.registers.table_markdown
    docs/configuration.md       keys, limits, faults               docs/config_page.py
    docs/design_of_loops.md     keys of a target                   docs/config_page.py
    docs/phases.md              phase budget of the defaults       testbench.run.budget, testbench.run.tables
    docs/paper.md               the paper's numbers, judged        testbench.judge, testbench.paper.closed_form
    docs/ranges.md              proven ranges                      docs/ranges_page.py
    docs/blocks/                ports of each block                docs/blocks_page.py
    docs/boards/paper.toml      the default board, sourced         docs/config_page.py
    docs/README.md              index of the pages                 their titles
    docs/parts/cv_noise.md, thermal.md, phases.md
                                what laws over temperature give    docs/laws_page.py
    docs/inference.md           what the inference found           docs/inference_page.py
    docs/effects/README.md      index of the effects               analog_frontend.effects.catalogue

    python docs/pages.py            write what is stale
    python docs/pages.py --check    name what is stale, exit code 1

A part stands between `<!-- NAME: written by ... -->` and `<!-- end -->`; the register map is known by its head.
Source  docs/README.md
"""

import ast
import json
import math
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import blocks_page  # noqa: E402
import config_page  # noqa: E402
import inference_page  # noqa: E402
import laws_page  # noqa: E402
import ranges_page  # noqa: E402

from analog_frontend.effects import catalogue  # noqa: E402
from fpga_model import registers  # noqa: E402
from testbench import config  # noqa: E402
from testbench.config import Config  # noqa: E402
from testbench.console.markdown import markdown, replace_part  # noqa: E402
from testbench.console.text_table import Table, to_decimals  # noqa: E402
from testbench.judge import judge, phases  # noqa: E402
from testbench.judge.number_verdict import NOT_COMPUTED  # noqa: E402
from testbench.paper import closed_form, judge_table, simulated  # noqa: E402
from testbench.run import budget, run_tables  # noqa: E402
from testbench.run.budget import NODES, PAPER_DEG  # noqa: E402
from testbench.storage.files import write_text  # noqa: E402

FOLDERS = (
    ("Firmware, a page per block", "blocks", "fpga_model"),
    ("Plant, a page per part", "parts", "analog_frontend"),
    ("Effects", "effects", "analog_frontend/effects"),
    ("Decisions", "decisions", ""),
)


def register_map(page):
    """docs/blocks/registers.md with its table renewed."""
    head = registers.table_markdown().split("\n", 1)[0]
    begin = page.index(head)
    return page[:begin] + registers.table_markdown() + page[page.index("\n\n", begin) :]


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
    heads = ("phase", "node deg", "ns", "loop deg", "without the assumptions deg", "paper deg", "node less paper",
             "verdict")  # fmt: skip
    return Table("", heads, rows, numeric=(1, 2, 3, 4, 5, 6))


def budget_part():
    """Summary and four tables of the default configuration."""
    planned, plain = budget.budgets(Config())
    parts = [
        f"At {planned.frequency_hz:.1f} Hz and 25 degC. {run_tables.FITTED}",
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
    heads = ("hardware", "xe1 deg", "less paper", "ye1 deg", "less paper")
    return f"{markdown(Table('', heads, rows, numeric=(1, 2, 3, 4)))}\n\n{run_tables.FITTED}"


# ---- the paper's numbers ---------------------------------------------------------------------------------------------


def without_simulation():
    """The `Model` of the default board, with changes of the linear loop to the third decimal.

    Linear algebra of another processor moves its bandwidth by 5e-6 Hz: more digits would be that machine's.
    """
    model = closed_form.default()
    return model._replace(loop_change={n: v._replace(value=round(v.value, 3)) for n, v in model.loop_change.items()})


def judged_part():
    """Every number of the paper, judged by what takes no simulation, and the fitted values behind it."""
    rows = judge.rows(without_simulation())
    table, keys = judge_table.document(rows)
    return "\n\n".join((judge_table.sentence(rows), markdown(table), markdown(keys)))


def simulated_part():
    """The numbers that take a simulation, judged by the values that a study has left in docs/paper_judged.json."""
    kept = simulated.from_json(json.loads((ROOT / "docs" / "paper_judged.json").read_text()), Config())
    found, plain = judge.rows(kept), judge.rows(without_simulation())
    only = [b for a, b in zip(plain, found) if NOT_COMPUTED in a.basis and NOT_COMPUTED not in b.basis]
    table, _ = judge_table.document(only)
    heads = [k for k, head in enumerate(table.heads) if head != "rests on"]
    rows = [tuple(row[k] for k in heads) for row in table.rows]
    return "\n\n".join(
        (judge_table.sentence(found), markdown(table._replace(heads=tuple(table.heads[k] for k in heads), rows=rows)))
    )


# ---- index -----------------------------------------------------------------------------------------------------------


def title(path, package):
    """(link text, what it is about) of a page: its heading, or the first line of the module with its name."""
    heading = path.read_text().split("\n", 1)[0].removeprefix("# ").strip()
    name, colon, about = heading.partition(": ")
    if colon:
        return name, about
    module = next((ROOT / package).rglob(f"{path.stem}.py"), None) if package else None
    if module:
        return path.stem, ast.get_docstring(ast.parse(module.read_text())).split("\n", 1)[0].rstrip(".")
    return heading, ""


def index_part():
    """Lists of the pages of each folder."""
    parts = []
    for text, folder, package in FOLDERS:
        lines = [f"### {text}", ""]
        for path in sorted((ROOT / "docs" / folder).glob("*.md")):
            name, about = title(path, package)
            lines.append(f"- [{name}]({folder}/{path.name})" + (f": {about}" if about else ""))
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def effects_part():
    """One row per effect of the catalogue, by its id."""
    rows = []
    for effect in sorted(catalogue.LAWS, key=lambda e: e.IDS):
        name = effect.INFO.name
        about = effect.DOC.replace("|", "\\|")
        rows.append((effect.IDS, about, f"`effects.{name}`", f"[{name}]({name}.md)"))
    return markdown(Table("", ("id", "what", "switched on by", "page"), rows, numeric=()))


# ---- pages -----------------------------------------------------------------------------------------------------------


def with_parts(**parts):
    """Function that renews the named parts of a page by what these functions return."""

    def renewed(page):
        for name, part in parts.items():
            page = replace_part(page, name, part())
        return page

    return renewed


def block_page(stem):
    """Function that renews the page of a block."""
    ports = with_parts(ports=lambda: blocks_page.ports_part(stem))
    return (lambda page: ports(register_map(page))) if stem == "registers" else ports


PAGES = {
    **{f"docs/blocks/{stem}.md": block_page(stem) for stem in blocks_page.stems()},
    "docs/configuration.md": with_parts(faults=config_page.faults_table, keys=config_page.markdown_table),
    "docs/boards/paper.toml": config_page.paper_board,
    "docs/design_of_loops.md": with_parts(target=config_page.target_table),
    "docs/paper.md": with_parts(judged=judged_part, simulated=simulated_part),
    "docs/inference.md": with_parts(**inference_page.PARTS),
    "docs/phases.md": with_parts(budget=budget_part, lock=lock_part, rivals=rivals_part, rise=laws_page.rise_part),
    "docs/parts/cv_noise.md": with_parts(shares=laws_page.shares_part, noise=laws_page.noise_part),
    "docs/parts/thermal.md": with_parts(scale=laws_page.scale_part, bias=laws_page.bias_part),
    "docs/ranges.md": with_parts(
        cases=ranges_page.summary_part, instances=ranges_page.wiring_part, registers=ranges_page.registers_part
    ),
    "docs/README.md": with_parts(index=index_part),
    "docs/effects/README.md": with_parts(effects=effects_part),
}
OF_EFFECTS = ("docs/configuration.md", "docs/README.md", "docs/effects/README.md")


def stale(names=None):
    """{path: renewed text} of those pages (None: all) whose generated parts are not what the code says."""
    now = {name: (ROOT / name).read_text() for name in names or PAGES}
    renewed = {name: PAGES[name](page) for name, page in now.items()}
    return {name: text for name, text in renewed.items() if text != now[name]}


def renew(names=None):
    """Write those of the pages that are stale; returns their paths."""
    changed = stale(names)
    for name, text in changed.items():
        write_text(ROOT / name, text)
    return list(changed)


def main(arguments=None):
    """Write stale pages, or with --check only name them; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments not in ([], ["--check"]):
        print("usage: python docs/pages.py [--check]", file=sys.stderr)
        return 2
    if arguments:
        changed = list(stale())
        for name in changed:
            print(f"{name} is stale; run: python docs/pages.py", file=sys.stderr)
        return 1 if changed else 0
    for name in renew():
        print(f"written: {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
