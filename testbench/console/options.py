"""Options that several commands share, and the configuration that they come to."""

import functools
import inspect
from pathlib import Path
from typing import Annotated

import typer

ConfigFile = Annotated[Path | None, typer.Option("--config", "-c", metavar="FILE", help="TOML configuration.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set one value, such as plant.fx_hz=11010; may be repeated."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
Temperature = Annotated[float | None, typer.Option("--temperature-degc", help="Constant temperature (degC).")]


def takes(kind):
    """A command whose options are the fields of the NamedTuple `kind`: it gets one record."""

    def decorate_command(command):
        @functools.wraps(command)
        def call_command(**given):
            return command(kind(**given))

        keyword = inspect.Parameter.KEYWORD_ONLY
        call_command.__annotations__ = dict(kind.__annotations__)
        call_command.__signature__ = inspect.Signature(
            inspect.Parameter(
                name, keyword, default=kind._field_defaults.get(name, inspect.Parameter.empty), annotation=hint
            )
            for name, hint in kind.__annotations__.items()
        )
        del call_command.__wrapped__  # its signature is another
        return call_command

    return decorate_command


def overrides(sets, *named):
    """Overrides of `--set` and of named options: (path, value, source), without those that were not given."""
    from testbench.config import Override, parse_set

    option_overrides = [Override(path, value, source) for path, value, source in named if value is not None]
    return [parse_set(text) for text in sets or ()] + option_overrides


def load(path, overrides):
    """`testbench.config.load`, imported when it is needed."""
    from testbench import config

    return config.load(path, overrides)
