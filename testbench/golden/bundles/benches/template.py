"""Texts of a bundle as files in their own language; what differs from bundle to bundle stands as <<name>>."""

import re
from pathlib import Path

FOLDER = Path(__file__).with_name("templates")


def fill_template(name, /, **values):
    """Text of the template `name` with each <<key>> as its value; raises KeyError for a key without a value."""
    text = (FOLDER / name).read_text()
    return re.sub(r"<<(\w+)>>", lambda found: str(values[found[1]]), text)
