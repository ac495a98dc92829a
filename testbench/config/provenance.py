"""Where each default of [plant] and [firmware] comes from: fact, derived, fitted or assumed, with its reason.

    origin(section, key)    `Origin` of a default
    fitted_defaults()       keys that were chosen or kept because they bring a number of the paper nearer

Source    analog_frontend/parts/provenance.py ([plant]), docs/phases.md
"""

from analog_frontend.parts.provenance import ASSUMED, DERIVED, FACT, FITTED, PLANT, Origin

SEARCH = "of the possible values, those that bring xe1 and ye1 nearest to the paper"
DESIGN_CHOICE = "this project's design"
FIRMWARE = {
    "board": Origin(FACT, "the paper demodulates by analog switches"),
    "pipeline_registers": Origin(FITTED, SEARCH),
    "drive_sine_registers": Origin(ASSUMED, "no such registers"),
    "sense_sine_registers": Origin(ASSUMED, "no such registers"),
    "drive_code_registers": Origin(ASSUMED, "no such registers"),
    "sense_code_registers": Origin(ASSUMED, "no such registers"),
    "reference_registers": Origin(FITTED, SEARCH),
    "reference_retimed": Origin(FITTED, SEARCH),
    "frame_latency_drive": Origin(FITTED, SEARCH),
    "frame_latency_sense": Origin(FITTED, SEARCH),
    "quadrature_update_khz": Origin(DERIVED, "SYNC high time of the DAC82002 at 26 MHz"),
    "agc_crossover_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "agc_zero_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "pll_crossover_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "pll_zero_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "ftr_crossover_hz": Origin(FITTED, "the paper's bandwidth"),
    "ftr_zero_hz": Origin(FITTED, "the paper's bandwidth"),
    "notch_hz": Origin(ASSUMED, "off"),
    "notch_width_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "qsc_crossover_hz": Origin(ASSUMED, f"{DESIGN_CHOICE}: well below the rate loop"),
    "amplitude_um": Origin(ASSUMED, "typical of such gyroscopes, 2 to 10 um"),
    "nominal_frequency_hz": Origin(DERIVED, "value of the nominal board"),
    "kick_v": Origin(DERIVED, "value of the nominal board"),
    "kick_s": Origin(ASSUMED, DESIGN_CHOICE),
    "decay_s": Origin(ASSUMED, DESIGN_CHOICE),
    "search_s": Origin(ASSUMED, DESIGN_CHOICE),
    "search_limit_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "search_min_v": Origin(ASSUMED, DESIGN_CHOICE),
    "retune_s": Origin(ASSUMED, DESIGN_CHOICE),
    "acquire_share": Origin(ASSUMED, DESIGN_CHOICE),
    "acquire_timeout_s": Origin(ASSUMED, DESIGN_CHOICE),
    "drive_ceiling_v": Origin(DERIVED, "value of the nominal board"),
    "pll_limit_hz": Origin(ASSUMED, DESIGN_CHOICE),
    "quadrature_ceiling_v": Origin(DERIVED, "value of the nominal board"),
    "sense_lock_dps": Origin(ASSUMED, DESIGN_CHOICE),
    "sense_lost_dps": Origin(ASSUMED, DESIGN_CHOICE),
    "phase_drive_sine_deg": Origin(ASSUMED, "reset value, before a calibration"),
    "phase_sense_sine_deg": Origin(ASSUMED, "reset value, before a calibration"),
    "phase_drive_ref_deg": Origin(ASSUMED, "reset value, before a calibration"),
    "phase_sense_ref_deg": Origin(ASSUMED, "reset value, before a calibration"),
    "adc_clock": Origin(ASSUMED, "one oscillator clocks FPGA and ADC"),
}
SECTIONS = {"plant": PLANT, "firmware": FIRMWARE}


def origin(section, key):
    """`Origin` of a default of [plant] or [firmware]; KeyError for another key."""
    return SECTIONS[section][key]


def fitted_defaults():
    """("plant.cref_drive_f", ...): all fitted defaults."""
    return tuple(f"{section}.{key}" for section, table in SECTIONS.items()
                 for key, o in table.items() if o.kind == FITTED)  # fmt: skip


def counts(section):
    """{kind: number of defaults} of a section."""
    kinds = [o.kind for o in SECTIONS[section].values()]
    return {kind: kinds.count(kind) for kind in (FACT, DERIVED, FITTED, ASSUMED)}
