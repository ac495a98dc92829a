"""What is left above 1.5 floors is said: verdict of a report and of a set, page and JSON alike."""

from testbench.measured import sets_report
from testbench.measured.exam import part_page


def report(verdict, after, floor=1.0):
    heldout = {"a": {"unit": "V", "floor": floor, "before": 9.0, "after_one_law": 5.0, "after": after}}
    return {"verdict": verdict, "sentence": "1 law(s).", "effects": [{"law": verdict}], "heldout": heldout}


def test_named_with_a_rest_is_named_in_part_and_says_where():
    assert part_page.in_part(report("named", 1.4)) == report("named", 1.4)
    found = part_page.in_part(report("named", 1.6))
    assert found["verdict"] == "named in part"
    assert found["sentence"].endswith("Held-out errors that are not explained, in floors: a 1.6.")
    assert part_page.in_part(report("confounded", 9.0))["verdict"] == "confounded"
    assert part_page.in_part(report("named", 9.0, None))["verdict"] == "named"


def test_the_least_settled_job_speaks_for_a_set_and_all_effects_are_there():
    rows = [(v, report(v, 1.0), "") for v in ("none", "named in part", "named")]
    found = sets_report.join_reports(rows)
    assert found["verdict"] == "named in part"
    assert [(e["job"], e["law"]) for e in found["effects"]] == [(v, v) for v, _, _ in rows]
    assert list(found["heldout"]) == ["none: a", "named in part: a", "named: a"]
