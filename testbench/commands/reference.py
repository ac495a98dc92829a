"""`gyro config`: what may stand in a file; no computing.

Source  docs/configuration.md
"""

from typing import Annotated

import typer

from testbench.console.options import Json
from testbench.console.show import print_reference


def config(
    keys: Annotated[bool, typer.Option("--keys", help="Keys of a configuration, section by section.")] = False,
    section: Annotated[
        str | None, typer.Option("--section", metavar="NAME", help="Keys of one section, such as plant.")
    ] = None,
    faults: Annotated[bool, typer.Option("--faults", help="Kinds of faults of a scenario.")] = False,
    targets: Annotated[bool, typer.Option("--targets", help="Keys of a target for gyro design.")] = False,
    effects: Annotated[bool, typer.Option("--effects", help="Effects: keys of the section effects.")] = False,
    columns: Annotated[bool, typer.Option("--columns", help="Columns of a run with their LSB.")] = False,
    as_json: Json = False,
):
    """List what a file may contain: keys with default, limits, unit and meaning; without options all keys."""
    from testbench.commands import reference_tables as tables
    from testbench.config import sections
    from testbench.errors import ConfigError

    if section is not None and section not in sections():
        raise ConfigError(f"--section: {section!r} is not a section; known: {', '.join(sections())}")
    names = (section,) if section else sections() if keys or not (faults or targets or effects or columns) else ()
    chosen = [tables.section_table(name) for name in names]
    for is_requested, table in (
        (faults, tables.fault_table),
        (targets, tables.target_table),
        (effects, tables.effect_table),
        (columns, tables.column_table),
    ):
        chosen += [table()] if is_requested else []
    print_reference(chosen, as_json)
