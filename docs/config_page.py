"""The generated tables of docs/configuration.md: keys with their limits, and faults."""

from testbench.config import Nominal, Plant, scenario, sections
from testbench.config.config_errors import choices_of, limits_of, plain, unit_of
from testbench.config.toml_text import toml_value


def markdown_table():
    """The tables of keys for docs/configuration.md."""
    lines = []
    for section, model in sections().items():
        lines += [f"### [{section}]", "", " ".join(model.__doc__.split()), ""]
        described = any(info.description for info in model.model_fields.values())
        lines += [
            "| key | default | limits | unit |" + " meaning |" * described,
            "|---|---|---|---|" + "---|" * described,
        ]
        for key, info in model.model_fields.items():
            if model is Nominal and key in Plant.model_fields:
                continue
            lo, hi = limits_of(info)
            limits = f"{plain(lo)} .. {plain(hi)}" if hi is not None else ""
            limits = " or ".join(toml_value(choice) for choice in choices_of(info)) or limits
            row = f"| `{key}` | `{toml_value(info.default)}` | {limits} |{unit_of(info)} |"
            lines.append(row + f" {info.description} |" * described)
        lines.append("")
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
