"""Every default of [plant] and [firmware] is fact, derived, fitted or assumed, and says why."""

import re

import pytest

from analog_frontend.parts import device
from analog_frontend.parts.provenance import ASSUMED, FITTED, KINDS
from testbench.config import Firmware, Plant, provenance
from testbench.judge import numbers, roles

ALL = [(section, key, o) for section, table in provenance.SECTIONS.items() for key, o in table.items()]
# "At least" these, by the names of their keys
KNOWN_FITTED = """
    firmware.pipeline_registers firmware.reference_registers firmware.reference_retimed firmware.frame_latency_sense
    plant.drive_pole_1_s plant.drive_pole_2_s plant.drive_pole_3_s plant.sense_pole_1_s plant.sense_pole_2_s
    plant.sense_pole_3_s plant.cref_drive_f plant.cref_sense_f plant.sid_switch_s plant.k_vf_drive_n_per_v
    plant.k_vf_sense_n_per_v plant.sense_dac_span_v plant.cv_noise_v_per_rthz plant.sid_flicker_v_per_rthz
    plant.kxy_n_per_m plant.kxy_tc_below_per_k plant.kxy_tc_above_per_k plant.kq_n_per_m_per_v2 plant.dcdx_f_per_m
    plant.dcdy_f_per_m
""".split()


def test_every_default_has_an_origin():
    assert list(provenance.PLANT) == list(device.Device._fields)
    assert set(provenance.FIRMWARE) == set(Firmware.model_fields)
    assert set(Plant.model_fields) == set(provenance.PLANT)
    assert all(o.kind in KINDS and o.text for _, _, o in ALL)


def test_what_was_chosen_for_the_paper_is_called_fitted():
    assert set(KNOWN_FITTED) <= set(provenance.fitted_defaults())


def printed():
    """Results that the paper prints, of two digits or more: measured, derived from that, or simulated."""
    kinds = ("measured mean", "measured bound", "measured, derived", "simulation result")
    found = {v for n in numbers.numbers() if n.kind.startswith(kinds) for v in n.values}
    return {v for v in found if len(f"{v:g}".strip("-0.").replace(".", "")) > 1 or v >= 10}


def mentions(text):
    """Numbers and names of the paper in a text."""
    words = set(re.findall(r"paper|[xy]e[12]\b|ARW|bias instability|bandwidth|scale factor|V_q at", text))
    found = {float(v) for v in re.findall(r"[-+]?\d*\.?\d+(?:e[-+]?\d+)?", text)}
    return words | {v for v in found if v in printed() or -v in printed()}


@pytest.mark.parametrize(("section", "key", "o"), ALL, ids=[f"{s}.{k}" for s, k, _ in ALL])
def test_an_assumption_mentions_no_number_of_the_paper(section, key, o):
    if o.kind == ASSUMED:
        assert not mentions(o.text), key


def test_a_mention_would_be_seen():
    assert mentions("gives 8651 LSB") == {8651.0}
    assert mentions("for xe1") == {"xe1"}
    assert mentions("2.88 V of 4 V") == set()


def test_what_the_judge_says_a_number_rests_on_are_the_fitted_defaults():
    """Each fitted default stands behind a number, and nothing else is called so."""
    behind = {key for rule in roles.RULES if rule.role in ("fitted", "free") for key in rule.rests_on}
    assert behind == set(provenance.fitted_defaults())
    for rule in roles.RULES:
        for key in rule.rests_on:
            section, name = key.split(".")
            assert section == "design" or name in provenance.SECTIONS[section], key


def test_counts():
    count = provenance.counts("plant")
    assert list(count) == list(KINDS)
    assert sum(count.values()) == len(device.FIELDS)
    assert count[FITTED] == sum(key.startswith("plant.") for key in provenance.fitted_defaults())
