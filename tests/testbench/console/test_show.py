"""What machines read: JSON has no infinity and no NaN."""

import json
import math

from testbench.console import show


def test_numbers_that_json_cannot_hold_are_null(capsys):
    show.print_json({"far": [math.inf, -math.inf], "none": (math.nan, 1.5), "text": "inf"})
    assert json.loads(capsys.readouterr().out) == {"far": [None, None], "none": [None, 1.5], "text": "inf"}
