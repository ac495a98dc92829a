"""Numbers against their unit: volts per code, ppm, uncertainties, counters, priors, columns of the register log.

    R29  lsb_V, lsb_V_unc against the converter and its other channels      R30  values beyond what their unit can hold
    R31  counters against the words and the time line                       R32  priors against [plant]
    R33  columns of /registers against the map, frequencies in Hz for words

What the model cannot hold is refused. What a board could have, but none is known to have, is a warning.
Source    docs/measured.md
"""

import math

import numpy as np

from analog_frontend.parts import device
from fpga_model import registers
from fpga_model.rates import FRAME_CYCLES, MASTER_HZ
from testbench.config import changed
from testbench.measured.record import check_tables, schema
from testbench.measured.record.meaning_segments import COVERAGE_FACTOR, bank
from testbench.measured.record.recording_plan import LIMITS
from testbench.measured.record.schema import REFUSED, WARNED, Finding
from testbench.measured.record.sessions import sessions
from testbench.run.budget import budget

LSB_SHARE = 0.02  # gain error of a converter and of its reference
MATCH_SHARE = 0.005  # gain between channels of one converter, by its data sheet
LSB_UNC = (1e-8, 0.1)  # of lsb_V: no voltage is known better; beyond it a data sheet knows more
MOST_PPM, LIKELY_PPM = device.Device.__annotations__["clock_ppm"].hi, 200.0  # the model's limit; twice a crystal's
RATE_PPM = (0.1, 5e4)  # of a rate: beyond the best rate tables; 5 % is no measurement
TEMP_UNC_K = (1e-3, 10.0)  # beyond a standard thermometer; beyond any thermometer
PHASE_SHARE, PHASE_DEG = 0.5, 2.0  # of the budget: poles of a board, and what a counter's edges add
COUNT_SHARE = 1e-12  # of a frequency: no clock is known better
PRIOR_TIMES = 2.0  # of the configured value
PRIOR_SD = (1e-12, 3.0)  # parts of the value that doubles resolve; logarithms: a factor of 20
PLANT = {f"plant.{field.name}": field for field in device.FIELDS}
TURN = 1 << 48
FIRMWARE_HZ = (5e3, 2e4)


def lsb(record):
    """R29."""
    d, ratios = check_tables.stated_config(record).device(), {}
    adc = dict.fromkeys(("adc_xI", "adc_xQ", "adc_temperature"), d.adc_vref_v / d.adc_pga_drive / 2**23)
    adc |= dict.fromkeys(("adc_yI", "adc_yQ"), d.adc_vref_v / d.adc_pga_sense / 2**23)
    dac = {"dac_drv": d.drive_dac_span_v / 2**15, "dac_ftr": d.sense_dac_span_v / 2**19}
    nominal_lsb_v = adc | dac | {"dac_qsc": d.quad_dac_span_v / 2**16, "quadrature_code": d.quad_dac_span_v / 2**16}
    for name, column in record.streams.items():
        size, unc = column.attrs.get("lsb_V"), column.attrs.get("lsb_V_unc")
        if name not in nominal_lsb_v or size is None or unc is None:
            continue
        path, part = f"/streams/{name}", unc / size
        if part >= 1:
            yield Finding("R29", path, f"expected lsb_V_unc below lsb_V = {size:.4g} V, found {unc:.4g} V")
        elif not LSB_UNC[0] <= part <= LSB_UNC[1]:
            text = f"expected lsb_V_unc within {LSB_UNC[0]:g} .. {LSB_UNC[1]:g} of lsb_V, found {part:.3g} of it"
            yield Finding("R29", path, text, WARNED)
        limit = LSB_SHARE + COVERAGE_FACTOR * min(part, LSB_UNC[1])
        if abs(size / nominal_lsb_v[name] - 1) > limit:
            text = f"expected lsb_V = {nominal_lsb_v[name]:.6g} V of its converter within {100 * limit:.3g} %"
            yield Finding("R29", path, f"{text}, found {size:.6g} V", WARNED)
        elif name in adc:
            ratios[name] = (size / nominal_lsb_v[name], part)
    middle = float(np.median([ratio for ratio, _ in ratios.values()])) if ratios else 1.0
    for name, (ratio, part) in ratios.items():
        limit = MATCH_SHARE + COVERAGE_FACTOR * part
        if abs(ratio / middle - 1) > limit:
            text = (
                f"expected lsb_V of the other channels ({middle * nominal_lsb_v[name]:.6g} V) within "
                f"{100 * limit:.3g} %"
            )
            yield Finding("R29", f"/streams/{name}", f"{text}, found {ratio * nominal_lsb_v[name]:.6g} V", WARNED)


def _check_limits(record, name, column, limits, level=REFUSED):
    """Values of a column outside limits (low, high, unit)."""
    lo, hi, unit = limits
    for k, value in enumerate(record.tables[name][column].data.tolist()):
        if not lo <= value <= hi:
            text = f"expected {lo:g} .. {hi:g} {unit}, found {value:.6g} in row {k}"
            yield Finding("R30", f"/{name}/{column}", text, level)


def ranges(record):
    """R30."""
    ppm = record.clock_ppm
    if abs(ppm) > LIKELY_PPM:
        limit, how = (MOST_PPM, REFUSED) if abs(ppm) > MOST_PPM else (LIKELY_PPM, WARNED)
        yield Finding("R30", "/clock", f"expected a ppm within {-limit:g} .. {limit:g}, found {ppm:g}", how)
    keys = {"a_set": "a_um", "detune": "detune_deg", "temp_set": "temperature_degc", "rate_set": "rate_dps"}
    for column, key in keys.items():
        yield from _check_limits(record, "segments", column, LIMITS[key])
    yield from _check_limits(record, "stimulus/rate", "rate", LIMITS["rate_dps"])
    yield from _check_limits(record, "stimulus/temperature", "temperature", LIMITS["temperature_degc"])
    yield from _check_limits(record, "stimulus/rate", "unc", (*RATE_PPM, "ppm"), WARNED)
    yield from _check_limits(record, "stimulus/temperature", "unc", (*TEMP_UNC_K, "K"), WARNED)


def counters(record):
    """R31."""
    all_ = sessions(record)
    for name, table in record.tables.items():
        pair = name.partition("/")[2]
        if not name.startswith("counter/"):
            continue
        for k, (edge, value, gate, unc) in enumerate(schema.rows(table, "edge", "value", "gate", "unc")):
            end = edge + gate * MASTER_HZ
            session = [s for s in all_ if FRAME_CYCLES * s.first <= edge][-1]
            last = FRAME_CYCLES * (session.first + session.frames)
            if end > last + FRAME_CYCLES:
                text = f"expected a gate within {(last - edge) / MASTER_HZ:.6g} s, before the power-on ends"
                yield Finding("R31", f"/{name}/gate", f"{text}, found {gate:.6g} s in row {k}")
                continue
            rows = slice(edge // FRAME_CYCLES, max(edge // FRAME_CYCLES + 1, int(end) // FRAME_CYCLES))
            words = record.streams["nco_fword"].data if "nco_fword" in record.streams else ()
            word = words[rows].astype(float).mean() if edge < last and len(words) else 0.0
            hz = word * MASTER_HZ / 2**48
            if hz and gate * hz < 1:
                text = f"expected a gate of at least one period ({1 / hz:.3g} s), found {gate:.3g} s in row {k}"
                yield Finding("R31", f"/{name}/gate", text)
            elif pair == "f_drive":
                yield from _frequency(record, name, k, hz, (value, gate, unc))
            else:
                yield from _phase(record, name, k, edge, (value, unc))


def _frequency(record, name, k, hz, reading):
    """A reading of the drive's frequency against the frequency word."""
    value, gate, unc = reading
    lo, hi = COUNT_SHARE * hz, 2 / gate
    if hz and not lo <= unc <= hi:
        text = f"expected {lo:.2g} .. {hi:.3g} Hz (2 / gate), found {unc:.4g} in row {k}"
        yield Finding("R31", f"/{name}/unc", text, WARNED)
    true = hz * (1 + 1e-6 * record.clock_ppm)
    limit = COVERAGE_FACTOR * min(unc, hi) + hz * 1e-6
    if hz and abs(value - true) > limit:
        how = REFUSED if abs(value - true) > 1e-6 * MOST_PPM * hz + limit else WARNED
        text = f"expected {true:.9g} Hz from nco_fword and /clock within {limit:.2g} Hz, found {value:.9g} in row {k}"
        yield Finding("R31", f"/{name}/value", text, how)


def _phase(record, name, k, edge, reading):
    """A reading of a phase against the budget, where the pair is one of its nodes."""
    value, unc = reading
    if not abs(value) <= 360 or unc > 90:
        text = f"expected a phase within 360 deg, uncertainty below 90 deg, found {value:.4g} +- {unc:.3g} in row {k}"
        yield Finding("R31", f"/{name}/value", text)
        return
    node = {"counter/Vxm_vs_sgnsin": "xe1", "counter/Vym_vs_sgnsin": "ye1"}.get(name)
    register_values = bank(record, edge)
    if node is None or "phase_drive_sine" not in register_values:
        return
    axis = {"x": "drive", "y": "sense"}[node[0]]
    words = {f"phase_{axis}_{part}": register_values[f"phase_{axis}_{part}"][0] for part in ("sine", "ref")}
    angles = {f"firmware.{key}_deg": 360 * math.remainder(raw / TURN, 1.0) for key, raw in words.items()}
    config = changed(check_tables.stated_config(record), angles)
    budget_phase_deg = budget(config).node_deg()[node]
    plain = budget_phase_deg - angles[f"firmware.phase_{axis}_ref_deg"] + angles[f"firmware.phase_{axis}_sine_deg"]
    limit = PHASE_SHARE * abs(plain) + PHASE_DEG + COVERAGE_FACTOR * unc
    error = math.remainder(value - budget_phase_deg, 360)
    if abs(error) > limit:
        text = f"expected {budget_phase_deg:.4g} deg of the phase budget within {limit:.3g} deg"
        text += f", found {value:.4g} in row {k}"
        yield Finding("R31", f"/{name}/value", text, WARNED)


def priors(record):
    """R32."""
    config, row_by_name = check_tables.stated_config(record), {}
    columns = ("param", "dist", "mean", "sd", "unit")
    for k, (name, dist, mean, sd, unit) in enumerate(schema.rows(record.tables["priors"], *columns)):

        def odd(expected, observed_text, how=REFUSED, name=name, k=k):
            return Finding("R32", f"/priors/{name}", f"expected {expected}, found {observed_text} in row {k}", how)

        field = PLANT.get(name)
        if field is None:
            yield odd("a key of [plant]", name)
            continue
        if name in row_by_name:
            yield odd(f"one prior for each parameter, here that of row {row_by_name[name]}", "another one")
        row_by_name[name] = k
        if unit != field.unit:
            yield odd(f"unit {field.unit}", unit)
        if not field.lo <= mean <= field.hi:
            yield odd(f"a mean within {field.lo:g} .. {field.hi:g} {field.unit}", f"{mean:.6g}")
            continue
        configured_value = getattr(config.plant, field.name)
        if mean and configured_value and not 1 / PRIOR_TIMES <= mean / configured_value <= PRIOR_TIMES:
            text = f"a mean within a factor of {PRIOR_TIMES:g} of the configured {configured_value:.6g} {field.unit}"
            yield odd(text, f"{mean:.6g}", WARNED)
        logarithm = dist == "lognormal"
        if logarithm and not mean > 0:
            yield odd("a mean above 0 of a lognormal prior", f"{mean:.6g}")
        part = sd if logarithm or not mean else sd / abs(mean)
        if field.lo >= 0 and mean > 0 and not logarithm and part > 1:
            yield odd(f"an sd below the mean {mean:.6g}, because the parameter cannot be negative", f"{sd:.6g}", WARNED)
        elif (mean or logarithm) and part < PRIOR_SD[0]:
            yield odd(f"an sd above {PRIOR_SD[0]:g} of the mean", f"{part:.3g} of it", WARNED)
        elif logarithm and sd > PRIOR_SD[1]:
            yield odd(f"an sd of the logarithm below {PRIOR_SD[1]:g}", f"{sd:.6g}", WARNED)


def log(record):
    """R33."""
    if not schema.has_supported_map(record):
        return
    columns = ("name", "width", "frac_bits", "signed", "raw")
    for k, (name, *stated, raw) in enumerate(schema.rows(record.tables["registers"], *columns)):
        fmt = registers.BY_NAME[name].fmt
        format_fields = [fmt.width, fmt.f, int(fmt.s)]
        if stated != format_fields:
            text = f"expected width, frac_bits, signed = {format_fields}, found {stated} in row {k}"
            yield Finding("R33", f"/registers/{name}", text)
        hz = raw * MASTER_HZ / 2**48
        if name == "frequency_fixed" and not FIRMWARE_HZ[0] <= hz <= FIRMWARE_HZ[1]:
            text = f"expected {FIRMWARE_HZ[0]:g} .. {FIRMWARE_HZ[1]:g} Hz, found {hz:.6g} Hz (word {raw}) in row {k}"
            yield Finding("R33", f"/registers/{name}", text, WARNED)


RULES = (lsb, ranges, counters, priors, log)
