"""The generated tables of docs/configuration.md and docs/design_of_loops.md, keys with their limits and faults, and
docs/boards/paper.toml.
"""

from testbench.config import Nominal, Plant, provenance, scenario, sections
from testbench.config.config_errors import literal_choices, number_limits, number_text, spaced_unit
from testbench.config.toml_text import toml_value
from testbench.design.target import Target


def markdown_table():
    """The tables of keys for docs/configuration.md."""
    lines = []
    for section, model in sections().items():
        lines += [f"### [{section}]", "", " ".join(model.__doc__.split()), ""]
        described = any(info.description for info in model.model_fields.values())
        known = provenance.SECTIONS.get(section, {})
        lines += [
            "| key | default | limits | unit |" + " kind |" * bool(known) + " meaning |" * described,
            "|---|---|---|---|" + "---|" * bool(known) + "---|" * described,
        ]
        for key, info in model.model_fields.items():
            if model is Nominal and key in Plant.model_fields:
                continue
            lo, hi = number_limits(info)
            limits = f"{number_text(lo)} .. {number_text(hi)}" if hi is not None else ""
            limits = " or ".join(toml_value(choice) for choice in literal_choices(info)) or limits
            row = f"| `{key}` | `{toml_value(info.default)}` | {limits} |{spaced_unit(info)} |"
            row += f" {known[key].kind} |" if known else ""
            why = f"; {known[key].text}" if section == "firmware" else ""
            lines.append(row + f" {info.description}{why} |" * described)
        lines.append("")
    return "\n".join(lines)


def target_table():
    """The table of keys of a target for docs/design_of_loops.md."""
    lines = ["| key | default | limits | unit | meaning |", "|---|---|---|---|---|"]
    for key, info in Target.model_fields.items():
        lo, hi = number_limits(info)
        limits = f"{number_text(lo)} .. {number_text(hi)}" if hi is not None else ""
        default = "" if info.default is None else f"`{toml_value(info.default)}`"
        lines.append(f"| `{key}` | {default} | {limits} |{spaced_unit(info)} | {info.description} |")
    return "\n".join(lines)


def faults_table():
    """The table of faults for docs/configuration.md."""
    lines = ["| kind | channels | value | effect |", "|---|---|---|---|"]
    for kind, fault in scenario.FAULTS.items():
        if kind == "dac_stuck":
            value = ", ".join(f"{name} {lo} .. {hi}" for name, (lo, hi) in scenario.DAC_CODES.items())
        else:
            value = f"{fault.lo} .. {fault.hi} {fault.unit}" if fault.hi else "0"
        lines.append(f"| `{kind}` | {', '.join(fault.channels)} | {value} | {fault.doc} |")
    return "\n".join(lines)


PAPER_HEAD = """\
# The paper's board: the defaults of [nominal], written by docs/pages.py from analog_frontend/parts/provenance.py.
# fact: read in a source   derived: from others   fitted: to a number of the paper   assumed: none of these

[nominal]
"""


def paper_board(_):
    """docs/boards/paper.toml: every default of the nominal board with its source."""
    lines = []
    for key, info in Nominal.model_fields.items():
        kind = provenance.PLANT[key].kind if key in provenance.PLANT else provenance.ASSUMED
        lines.append(f"{key} = {toml_value(info.default)}  # {kind}: {info.description}")
    return PAPER_HEAD + "\n".join(lines) + "\n"
