"""Right and wrong measurement records from a few simulated ones; it knows nothing of the rules.

pool       records of several boards, simulated once
right      sessions of one of them in any order, with everything changed that a laboratory may have otherwise
wrong      a right one with one mistake of a class, of a random size: (record, table, row)
"""

import copy
import math

import numpy as np

from fpga_model.rates import FRAME_CYCLES, TICK_CYCLES
from testbench.measured.record import produce, recording_plan, schema
from testbench.storage.record import TableColumn

OPTIONAL = [name for name, s in schema.STREAMS.items() if not s.required]


PRIOR = [{"param": "plant.qx", "mean": 2e5, "sd": 2e3}]
QUIET = {f"noise.{name}": False for name in ("thermomechanical", "cv", "dac", "adc", "flicker", "jitter")}


def condition(rng, name, **more):
    """A condition of any rate, temperature, amplitude and detuning."""
    drawn = {
        "rate_dps": float(np.round(rng.uniform(8, 300) * rng.choice([-1, 1]), 1)),
        "temperature_degc": float(rng.integers(-40, 86)),
        "a_um": float(np.round(rng.uniform(3.5, 6.5), 2)),
        "detune_deg": float(rng.choice([0.0, np.round(rng.uniform(-30, 30), 1)])),
        "seconds": float(rng.choice([0.12, 0.16, 0.2])),
        "settle_s": float(rng.choice([0.03, 0.06])),
    }
    return {"id": name} | drawn | more


def boards(rng):
    """Plans of three boards: the model's, one of other parts that hides some of them, one without noise."""
    step = {"from_dps": float(np.round(rng.uniform(-200, 200))), "seconds": 0.24}
    return (
        {
            "set": {"plant.clock_ppm": float(np.round(rng.uniform(-60, 60), 1))},
            "condition": [
                condition(rng, "one", counter_s=0.04),
                condition(rng, "two", temperature_degc=-40.0, counter_s=0.03),
                condition(rng, "three", rate_dps=0.0, temperature_degc=85.0, role="validate"),
                condition(rng, "four", kind="rate_step", counter_s=0.05, **step),
            ],
        },
        {
            "set": {"plant.fx_hz": 10950.0, "plant.fy_hz": 10811.0, "firmware.ftr_crossover_hz": 25.0}
            | {"plant.adc_noise_drive_v": 3e-6, "plant.adc_vref_v": 2.4, "firmware.amplitude_um": 2.5},
            "truth": {"plant.k_vf_sense_n_per_v": 2.72e-7 * (1 + 0.1 * rng.uniform(-1, 1)), "plant.dxy_ratio": 0.05}
            | {"plant.qx": float(rng.uniform(1.8e5, 2.2e5))},
            "condition": [
                condition(rng, "one", a_um=2.0, **step),
                condition(rng, "two", a_um=2.51, counter_s=0.04),
                condition(rng, "three", a_um=3.0, role="validate"),
            ],
        },
        {
            "set": QUIET,
            "dac": "tick",
            "condition": [condition(rng, "one"), condition(rng, "two", rate_dps=0.0, role="validate")],
        },
    )


def pool(seed):
    """Simulated records of boards that a seed draws."""
    rng = np.random.default_rng([17, seed])
    made = []
    for k, board in enumerate(boards(rng)):
        tree = {"name": f"board {k}", "repeats": 2, "seed": 1000 * seed + k, "fx_scatter_hz": 1e-3, "prior": PRIOR}
        made.append(produce.record(recording_plan.from_dict(tree | board)))
    return made


# ---- editing ---------------------------------------------------------------------------------------------------------


def put(record, table, key, row, value):
    """A table with one value changed; row None: the whole column."""
    old = record.tables[table][key]
    data = old.data.astype(object) if old.data.dtype.kind == "U" else old.data.copy()
    data[slice(None) if row is None else row] = value
    record.tables[table][key] = TableColumn(data.astype(str) if old.data.dtype.kind == "U" else data, old.unit)


def rows_of(record, table, rows):
    """Keep, drop, repeat rows of a table."""
    for key, column in record.tables[table].items():
        record.tables[table][key] = TableColumn(column.data[rows], column.unit)


def codes(record, name, data):
    record.streams[name] = record.streams[name]._replace(data=data.astype(record.streams[name].data.dtype))


def attrs(record, name, **values):
    record.streams[name] = record.streams[name]._replace(attrs={**record.streams[name].attrs, **values})


def sealed(record):
    """The roles are hashed after every change, as a laboratory would."""
    record.attrs["roles_sha256"] = schema.roles_sha256(record.tables["segments"])
    return record


def column(record, table, key):
    return record.tables[table][key].data


def joined(record, picks):
    """Some of a record's power-ons, one behind the other."""
    starts = column(record, "power_on", "edge").tolist()
    ends = [*starts[1:], len(record.streams["nco_fword"].data) * FRAME_CYCLES]
    out = copy.deepcopy(record)
    pieces = {name: [] for name in record.streams}
    tables = {name: {key: [] for key in t} for name, t in record.tables.items() if name != "priors"}
    at = 0
    for k in picks:
        a, b = starts[k], ends[k]
        for name, c in record.streams.items():
            pieces[name].append(c.data[a // c.den : b // c.den])
        for name, table in tables.items():
            t = record.tables[name]
            edges = t["edge_a" if "edge_a" in t else "edge"].data
            keep = (edges >= a) & (edges < b)
            for key in table:
                shift = at - a if key.startswith("edge") else 0
                values = t[key].data[keep]
                table[key].append(values + shift if shift else values)
        at += b - a
    for name, parts in pieces.items():
        codes(out, name, np.concatenate(parts))
    for name, table in tables.items():
        out.tables[name] = {
            key: TableColumn(np.concatenate(v), record.tables[name][key].unit) for key, v in table.items()
        }
        if name.startswith("counter/") and not len(column(out, name, "edge")):
            del out.tables[name]
    return out


# ---- right -----------------------------------------------------------------------------------------------------------


def _chosen(rng, record):
    """Power-ons of a record: both repeats of a fitted condition, and others, in any order."""
    count = len(column(record, "power_on", "edge"))
    half = count // 2
    fitted = int(rng.choice([0, 1] if half > 2 else [0]))
    picks = {fitted, fitted + half, *rng.choice(count, rng.integers(0, count + 1), replace=False).tolist()}
    return rng.permutation(sorted(picks)).tolist()


def _relogged(rng, record, name, key, unc, sd):
    """A stimulus as a logger writes it: every row again some times, with the noise of its uncertainty."""
    table = record.tables[name]
    edges, values = table["edge"].data, table[key].data
    out = []
    starts = [*edges.tolist(), len(record.streams["nco_fword"].data) * FRAME_CYCLES]
    for a, b, value in zip(starts, starts[1:], values.tolist()):
        more = np.sort(rng.integers(a + FRAME_CYCLES, b, rng.integers(0, 4))) if b > a + 2 * FRAME_CYCLES else ()
        out += [(int(edge), value + sd(value) * rng.normal()) for edge in (a, *more)]
    where = {"where": TableColumn(np.full(len(out), "chamber"), "")} if "where" in table else {}
    record.tables[name] = {
        "edge": TableColumn(np.array([edge for edge, _ in out], np.int64), "edge"),
        key: TableColumn(np.array([value for _, value in out]), table[key].unit),
        **where,
        "unc": TableColumn(np.full(len(out), unc), table["unc"].unit),
    }


def _priors(rng, record, config):
    """Narrow and wide priors of any parameters."""
    from analog_frontend.parts import device

    known = [f for f in device.FIELDS if getattr(config, f.name) and isinstance(getattr(config, f.name), float)]
    known = [f for f in known if "power_on" not in f.name and f.name != "clock_ppm"]
    out = []
    for k in rng.choice(len(known), rng.integers(1, 6), replace=False):
        field, value = known[k], getattr(config, known[k].name)
        share = 10 ** rng.uniform(-5, -0.7)
        mean = value * (1 + share * np.clip(rng.normal(), -2, 2))
        lognormal = field.lo >= 0 and rng.random() < 0.2
        sd = share if lognormal else share * abs(mean)
        dist = "lognormal" if lognormal else str(rng.choice(["normal", "uniform"]))
        out.append(("plant." + field.name, dist, float(np.clip(mean, field.lo, field.hi)), sd, field.unit, "bench", ""))
    keys = schema.TABLES["priors"]
    record.tables["priors"] = {
        key: TableColumn(np.array(values, float if key in ("mean", "sd") else str), unit)
        for (key, unit), values in zip(keys.items(), zip(*out))
    }
    record.attrs["nuisances"] = ",".join(row[0] for row in out)


def _lost(rng, record):
    """Rows of a start-up that the recorder lost, and says so."""
    k = int(rng.choice(np.flatnonzero(column(record, "segments", "kind") == "startup")))
    first, last = (int(column(record, "segments", key)[k]) // FRAME_CYCLES for key in ("edge_a", "edge_b"))
    row = int(rng.integers(first + 300, last - 300))
    count = int(rng.integers(1, 200))
    streams = str(rng.choice(["adc", "all"]))
    for name, c in record.streams.items():
        if streams == "all" or name.startswith("adc_"):
            data, step = c.data.copy(), FRAME_CYCLES // c.den
            data[row * step : (row + count) * step] = 0
            codes(record, name, data)
    gaps = record.tables["gaps"]
    new = {
        "edge_a": row * FRAME_CYCLES,
        "edge_b": (row + count) * FRAME_CYCLES,
        "streams": streams,
        "reason": "overrun",
    }
    at = int(np.searchsorted(gaps["edge_a"].data, new["edge_a"]))
    for key, value in new.items():
        old = gaps[key].data.tolist()
        gaps[key] = TableColumn(np.array([*old[:at], value, *old[at:]]), gaps[key].unit)


def _scales(rng, record):
    """Volts per code as a laboratory measures them."""
    unc = 10 ** rng.uniform(-4.5, -2.3)
    for group in (
        ("adc_xI", "adc_xQ", "adc_yI", "adc_yQ", "adc_temperature"),
        ("dac_drv",),
        ("dac_ftr",),
        ("dac_qsc",),
    ):
        gain = 1 + np.clip(3e-3 * rng.normal(), -0.01, 0.01)
        for name in group:
            size = record.streams[name].attrs["lsb_V"] * gain * (1 + unc * rng.normal())
            attrs(record, name, lsb_V=float(size), lsb_V_unc=float(unc * size))


def right(rng, records):
    """A record that is right in everything that it says."""
    from testbench.measured.record import check_tables

    base = records[rng.integers(len(records))]
    record = joined(base, _chosen(rng, base))
    config = check_tables.stated_config(record).plant
    _scales(rng, record)
    _priors(rng, record, config)
    if rng.random() < 0.7:
        ppm = 10 ** rng.uniform(0.7, 2.7)
        _relogged(rng, record, "stimulus/rate", "rate", ppm, lambda value: 1e-6 * ppm * abs(value))
        kelvin = 10 ** rng.uniform(-1.5, -0.3)
        _relogged(rng, record, "stimulus/temperature", "temperature", kelvin, lambda value: kelvin)
    shift = int(rng.normal(0.0, 1.0) * 490e-6 / record.streams["adc_temperature"].attrs["lsb_V"])
    data = record.streams["adc_temperature"].data
    codes(record, "adc_temperature", np.where(data > 0, data + shift * (data > 1000), data))
    for key in ("a_set", "rate_set", "temp_set"):
        put(record, "segments", key, None, [float(f"{v:.3g}") for v in column(record, "segments", key)])
    if rng.random() < 0.3:
        keep = (column(record, "segments", "role") != "none") | (column(record, "segments", "kind") == "startup")
        rows_of(record, "segments", keep)
    if rng.random() < 0.4:
        _lost(rng, record)
    if rng.random() < 0.4:
        for name in rng.choice(OPTIONAL, rng.integers(1, len(OPTIONAL)), replace=False):
            record.streams.pop(str(name), None)
    if rng.random() < 0.3:
        for name in [name for name in record.tables if name.startswith("counter/")]:
            del record.tables[name]
        record.clock_ppm = float(rng.uniform(-60, 60))
    record.provenance = "measured" if rng.random() < 0.7 else record.provenance
    record.attrs["lab"] = f"lab {rng.integers(100)}"
    return sealed(record)


# ---- wrong -----------------------------------------------------------------------------------------------------------


class Unfit(Exception):
    """The record drawn has nothing in which this mistake could be made."""


def pick(rng, mask):
    """One of the rows of a mask."""
    rows = np.flatnonzero(mask)
    if not len(rows):
        raise Unfit
    return int(rng.choice(rows))


def between(rng, lo, hi, signed=True):
    """Log-uniform size, of either sign."""
    return float(np.exp(rng.uniform(math.log(lo), math.log(hi))) * (rng.choice([-1, 1]) if signed else 1))


def roled(record):
    return column(record, "segments", "role") != "none"


def moving(record):
    return roled(record) & (np.abs(column(record, "segments", "rate_set")) > 5)


def segment_rate_sign(rng, r):
    row = pick(rng, moving(r))
    put(r, "segments", "rate_set", row, -column(r, "segments", "rate_set")[row])
    return "segments", row


def segment_rate_size(rng, r):
    row = pick(rng, moving(r))
    put(r, "segments", "rate_set", row, column(r, "segments", "rate_set")[row] * (1 + between(rng, 0.03, 0.9)))
    return "segments", row


def segment_rate_radians(rng, r):
    pick(rng, moving(r))
    put(r, "segments", "rate_set", None, column(r, "segments", "rate_set") * math.pi / 180)
    return "segments", None


def held_rows(r, name, k):
    """Rows of a stimulus that are stated within a segment, or hold where it ends."""
    edges = column(r, name, "edge")
    a, b = (column(r, "segments", key)[k] for key in ("edge_a", "edge_b"))
    last = int(np.searchsorted(edges, b, side="left")) - 1
    return [row for row in range(len(edges)) if (a <= edges[row] < b) or row == last]


def stimulus_rate_sign(rng, r):
    k = pick(rng, moving(r))
    row = held_rows(r, "stimulus/rate", k)[-1]
    put(r, "stimulus/rate", "rate", row, -column(r, "stimulus/rate", "rate")[row])
    return "stimulus/rate", row


def both_rates(rng, r, change, least):
    """Every rate of the record, in both tables."""
    pick(rng, roled(r) & (np.abs(column(r, "segments", "rate_set")) > least))
    put(r, "segments", "rate_set", None, change(column(r, "segments", "rate_set")))
    put(r, "stimulus/rate", "rate", None, change(column(r, "stimulus/rate", "rate")))
    return "stimulus/rate", None


def both_rates_radians(rng, r):
    return both_rates(rng, r, lambda v: v * math.pi / 180, 20.0)


def both_rates_sign(rng, r):
    return both_rates(rng, r, lambda v: -v, 10.0)


def amplitude(rng, r):
    row = pick(rng, roled(r))
    factor = rng.choice([1e-6, 1e3, 1e-3, 0.5, 2.0, *(1 + between(rng, 0.03, 0.6) for _ in range(5))])
    put(r, "segments", "a_set", row, column(r, "segments", "a_set")[row] * factor)
    return "segments", row


def temperature_unit(rng, r):
    row = pick(rng, roled(r))
    value = column(r, "segments", "temp_set")[row]
    put(r, "segments", "temp_set", row, value + 273.15 if rng.random() < 0.5 else 32 + 1.8 * value)
    if abs(column(r, "segments", "temp_set")[row] - value) < 1:
        raise Unfit
    return "segments", row


def temperature_set(rng, r):
    row = pick(rng, roled(r))
    put(r, "segments", "temp_set", row, column(r, "segments", "temp_set")[row] + between(rng, 5, 60))
    return "segments", row


def both_temperatures(rng, r):
    """Kelvin, or another chamber's log."""
    if "adc_temperature" not in r.streams:
        raise Unfit
    change = 273.15 if rng.random() < 0.3 else between(rng, 15, 60)
    put(r, "segments", "temp_set", None, column(r, "segments", "temp_set") + change)
    put(r, "stimulus/temperature", "temperature", None, column(r, "stimulus/temperature", "temperature") + change)
    return "stimulus/temperature", None


def detune(rng, r):
    row = pick(rng, roled(r))
    value = column(r, "segments", "detune")[row]
    wrong = [value + between(rng, 0.3, 30)] + ([-value, value * math.pi / 180, value / 360] if value else [])
    put(r, "segments", "detune", row, float(rng.choice(wrong)))
    return "segments", row


def step_without(rng, r):
    row = pick(rng, roled(r) & (column(r, "segments", "kind") == "dwell"))
    rates = column(r, "stimulus/rate", "rate")[held_rows(r, "stimulus/rate", row)]
    if np.ptp(rates) > 1 or (held_before(r, row) is not None and abs(held_before(r, row) - rates[0]) > 1):
        raise Unfit
    put(r, "segments", "kind", row, "rate_step")
    return "segments", row


def held_before(r, k):
    edges = column(r, "stimulus/rate", "edge")
    row = int(np.searchsorted(edges, column(r, "segments", "edge_a")[k], side="left")) - 1
    return column(r, "stimulus/rate", "rate")[row] if row >= 0 else None


def dwell_during_step(rng, r):
    """A segment that begins before the step at its beginning; what stood there ends earlier."""
    kinds = column(r, "segments", "kind")
    steps = [k for k in np.flatnonzero(roled(r)) if held_before(r, k) is not None]
    rates = column(r, "segments", "rate_set")
    k = pick(rng, np.isin(np.arange(len(kinds)), [k for k in steps if abs(held_before(r, k) - rates[k]) > 5]))
    earlier = int(column(r, "segments", "edge_a")[k]) - int(rng.integers(10, 400)) * FRAME_CYCLES
    if k and column(r, "segments", "edge_b")[k - 1] > earlier:
        put(r, "segments", "edge_b", k - 1, earlier)
    put(r, "segments", "edge_a", k, earlier)
    put(r, "segments", "kind", k, "dwell")
    return "segments", k


def over_power_on(rng, r):
    """A segment that goes on into the next power-on; those that stood there are left out."""
    starts = column(r, "power_on", "edge")
    ends = column(r, "segments", "edge_b")
    k = pick(rng, roled(r) & (ends < starts[-1]))
    nxt = int(starts[starts >= ends[k]][0])
    over = nxt + int(rng.integers(50, 5000)) * FRAME_CYCLES
    begins = column(r, "segments", "edge_a")
    keep = (begins < nxt) | (begins >= over)
    put(r, "segments", "edge_b", k, over)
    rows_of(r, "segments", keep)
    return "segments", k


def lsb(rng, r):
    names = [n for n, c in r.streams.items() if "lsb_V" in c.attrs and n != "quadrature_code"]
    name = str(rng.choice(names))
    factor = rng.choice([2.0, 0.5, 12.0, 1 / 12, 1e3, 1e-3, 1e6, *(1 + between(rng, 0.05, 0.5) for _ in range(5))])
    old = r.streams[name].attrs
    attrs(r, name, lsb_V=float(old["lsb_V"] * factor), lsb_V_unc=float(old["lsb_V_unc"] * factor))
    return f"streams/{name}", None


def lsb_unc(rng, r):
    """In ppm, as a part, in percent."""
    names = [n for n, c in r.streams.items() if "lsb_V" in c.attrs]
    name = str(rng.choice(names))
    part = r.streams[name].attrs["lsb_V_unc"] / r.streams[name].attrs["lsb_V"]
    attrs(r, name, lsb_V_unc=float(part * rng.choice([1e6, 1.0, 100.0])))
    return f"streams/{name}", None


def clock(rng, r):
    """As ppb, in Hz of 26 MHz, or simply another."""
    if "counter/f_drive" not in r.tables:
        raise Unfit
    r.clock_ppm = float(rng.choice([1e3 * (r.clock_ppm or 12.0), r.clock_ppm + between(rng, 20, 900)]))
    return "clock", None


def rate_unc(rng, r):
    row = pick(rng, np.ones(len(column(r, "stimulus/rate", "edge")), bool))
    put(r, "stimulus/rate", "unc", row, column(r, "stimulus/rate", "unc")[row] * rng.choice([1e-6, 1e-4]))
    return "stimulus/rate", row


def counter(rng, r):
    names = [name for name in r.tables if name.startswith("counter/")]
    if not names:
        raise Unfit
    name = str(rng.choice(names))
    row = int(rng.integers(len(column(r, name, "edge"))))
    kind = rng.choice(["gate", "value"])
    if kind == "gate":
        factor = float(rng.choice([1e3, 1e6]))
    elif name == "counter/f_drive":
        factor = float(rng.choice([1e-3, 2 * math.pi, 1 + between(rng, 1e-4, 0.1)]))
    else:
        factor = math.pi / 180
        if abs(column(r, name, "value")[row]) < 10:
            raise Unfit
    put(r, name, kind, row, column(r, name, kind)[row] * factor)
    return name, row


def prior_mean(rng, r):
    row = pick(rng, column(r, "priors", "mean") != 0)
    factor = float(rng.choice([1e3, 1e-3, 1e6, 2 * math.pi, 1 / (2 * math.pi), 60.0, between(rng, 3.0, 1e3, False)]))
    put(r, "priors", "mean", row, column(r, "priors", "mean")[row] * factor)
    put(r, "priors", "sd", row, column(r, "priors", "sd")[row] * factor)
    return "priors", row


def prior_unit(rng, r):
    row = pick(rng, column(r, "priors", "mean") != 0)
    unit = column(r, "priors", "unit")[row]
    put(r, "priors", "unit", row, str(rng.choice([f"k{unit}", f"m{unit}", "percent", "rad/s"])))
    return "priors", row


def prior_name(rng, r):
    row = pick(rng, column(r, "priors", "mean") != 0)
    old = str(column(r, "priors", "param")[row])
    new = str(rng.choice([old.removeprefix("plant."), old + "_hz", old.upper(), old[:-1]]))
    put(r, "priors", "param", row, new)
    r.attrs["nuisances"] = ",".join(column(r, "priors", "param").tolist())
    return "priors", row


def prior_sd(rng, r):
    """In percent, of a quantity that cannot be negative."""
    positive = [
        k
        for k, (m, d) in enumerate(zip(column(r, "priors", "mean"), column(r, "priors", "dist")))
        if m > 0 and d != "lognormal"
    ]
    names = column(r, "priors", "param")
    row = pick(
        rng,
        [
            k in positive and any(w in names[k] for w in ("_hz", ".qx", ".qy", "mass", "pole", "cref"))
            for k in range(len(names))
        ],
    )
    put(r, "priors", "sd", row, column(r, "priors", "mean")[row] * between(rng, 1.5, 100, False))
    return "priors", row


def exchanged(rng, r):
    """Two channels of one converter; the firmware saw the right ones."""
    if "adc_ok" not in r.streams or (column(r, "gaps", "reason") == "overrun").any():
        raise Unfit
    a, b = rng.choice(list(schema.ADC), 2, replace=False)
    a, b = str(a), str(b)
    one, other = r.streams[a].data, r.streams[b].data
    codes(r, a, other)
    codes(r, b, one)
    return f"{a}|{b}", None


def copied(rng, r):
    """A channel that holds another one's codes, in part or all along."""
    names = [name for name in (*schema.ADC, "adc_temperature") if name in r.streams]
    a, b = (str(x) for x in rng.choice(names, 2, replace=False))
    total = len(r.streams[a].data)
    count = int(between(rng, 0.05, 1.0, False) * total)
    first = int(rng.integers(0, total - count + 1))
    data = r.streams[a].data.copy()
    data[first : first + count] = r.streams[b].data[first : first + count]
    codes(r, a, data)
    return f"{a}|{b}", None


def ok_inverted(rng, r):
    """0 for good."""
    if "adc_ok" not in r.streams:
        raise Unfit
    codes(r, "adc_ok", 1 - r.streams["adc_ok"].data)
    return "adc_ok", None


def negated(rng, r):
    """A channel with its inputs exchanged."""
    if "adc_ok" not in r.streams or (column(r, "gaps", "reason") == "overrun").any():
        raise Unfit
    name = str(rng.choice(list(schema.ADC)))
    codes(r, name, -r.streams[name].data)
    return name, None


def segments_in_ticks(rng, r):
    for key in ("edge_a", "edge_b"):
        put(r, "segments", key, None, column(r, "segments", key) // TICK_CYCLES)
    return "segments", None


def stuck_end(rng, r):
    """The recorder repeats its last row."""
    names = [name for name in (*schema.ADC, "adc_temperature") if name in r.streams]
    if "\nadc = false" in r.config_toml:  # without noise a converter may rest
        raise Unfit
    count = int(between(rng, 1, 60, False))
    for name in names:
        data = r.streams[name].data.copy()
        data[-count:] = data[-count - 1]
        codes(r, name, data)
    return "|".join(names), None


def shifted_sensor(rng, r):
    """A stream some rows off the others."""
    if "adc_temperature" not in r.streams:
        raise Unfit
    codes(r, "adc_temperature", np.roll(r.streams["adc_temperature"].data, int(between(rng, 1, 50))))
    return "streams/adc_temperature", None


def sensor_elsewhere(rng, r):
    """The sensor's codes of another power-on, or at another gain."""
    if "adc_temperature" not in r.streams:
        raise Unfit
    codes(r, "adc_temperature", r.streams["adc_temperature"].data * float(rng.choice([0.5, 2.0, 1 / 12, 12.0])))
    return "adc_temperature", None


def register_format(rng, r):
    row = pick(rng, np.ones(len(column(r, "registers", "edge")), bool))
    key = str(rng.choice(["width", "frac_bits", "signed"]))
    put(
        r,
        "registers",
        key,
        row,
        column(r, "registers", key)[row] ^ int(rng.choice([1, 8, 16] if key != "signed" else [1])),
    )
    return "registers", row


def register_unit(rng, r):
    """A frequency in Hz for a word, an amplitude in nm for one."""
    name = str(rng.choice(["frequency_fixed", "amplitude_setpoint"]))
    row = pick(rng, column(r, "registers", "name") == name)
    raw = column(r, "registers", "raw")[row]
    put(r, "registers", "raw", row, round(raw * 26e6 / 2**48) if name == "frequency_fixed" else round(raw / 1947.0))
    return "registers", row


def stimulus_ticks(rng, r):
    """Edges of a stimulus in ticks."""
    edges = column(r, "stimulus/rate", "edge")
    rates = column(r, "stimulus/rate", "rate")
    if np.ptp(rates) < 20:
        raise Unfit
    put(r, "stimulus/rate", "edge", None, edges // TICK_CYCLES)
    return "stimulus/rate", None


MISTAKES = (
    segment_rate_sign, segment_rate_size, segment_rate_radians, stimulus_rate_sign, both_rates_radians, both_rates_sign,
    amplitude, temperature_unit, temperature_set, both_temperatures, detune, step_without, dwell_during_step,
    over_power_on, lsb, lsb_unc, clock, rate_unc, counter, prior_mean, prior_unit, prior_name, prior_sd, exchanged,
    copied, ok_inverted, negated, segments_in_ticks, stuck_end, shifted_sensor, sensor_elsewhere, register_format,
    register_unit, stimulus_ticks,
)  # fmt: skip


def wrong(rng, records, mistake, tries=60):
    """(record, pattern of the table or stream, row or None) of a record with one mistake."""
    for _ in range(tries):
        record = right(rng, records)
        try:
            table, row = mistake(rng, record)
        except Unfit:
            continue
        return sealed(record), table, row
    raise RuntimeError(f"{mistake.__name__}: no record of the pool can have it")
