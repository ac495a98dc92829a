"""What a section of the configuration is made of: a strict table, and keys with unit, limits and a sentence.

Source  docs/configuration.md
"""

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Section(BaseModel):
    """A TOML table: unknown keys are errors, nothing is converted silently, values cannot be changed afterwards."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, validate_default=True)


def number(default, unit, lo, hi, doc):
    """A key that holds a number of `unit` within lo..hi."""
    return Field(default, ge=lo, le=hi, description=doc, json_schema_extra={"unit": unit})


def other(default, doc, unit=""):
    """A key that holds a switch, a choice, a text or a profile."""
    return Field(default, description=doc, json_schema_extra={"unit": unit})


def as_validator(function):
    """A validator that keeps the value if `function` does not raise."""

    def check(value):
        function(value)
        return value

    return AfterValidator(check)
