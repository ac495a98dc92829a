"""Rules about what surrounds the codes: register log, segments and roles, priors, counters, stated uncertainties.

Each yields `Finding`s of a record whose streams and tables are complete.
Source    docs/measured.md
"""

import tomllib

from fpga_model import registers
from fpga_model.rates import FRAME_CYCLES
from testbench.measured.record import schema
from testbench.measured.record.schema import DOWNGRADED, Finding

HEX = set("0123456789abcdef")
FOREIGN = "the firmware differs, so R0 and R2 are skipped"


def span_edges(record):
    """Edges from the record's first to behind its last."""
    return schema.frame_count(record) * FRAME_CYCLES


def check_identities(record):
    if not schema.has_supported_map(record):
        mismatch = f"expected regmap_sha256 {schema.regmap_sha256()}, found {record.attrs['regmap_sha256']}"
        yield Finding("R11", "/", f"{mismatch}: {FOREIGN}", DOWNGRADED)
    stated = record.attrs["bitstream_sha256"]
    if len(stated) != 64 or set(stated) - HEX:
        yield Finding("R11", "/", f"expected bitstream_sha256 of 64 hexadecimal digits, found {stated!r}")
    try:
        config = stated_config(record)
    except ValueError as problem:
        yield Finding("R11", "/", f"expected a configuration of this version, found an invalid one: {problem}")
        return
    if record.provenance != "measured":
        from testbench.run import build

        firmware = build.firmware(config)
        firmware_sha256 = schema.bitstream_sha256(firmware)
        if stated not in (firmware_sha256, schema.bitstream_sha256(firmware, schema.ADDED_PARAMETERS)):
            yield Finding("R11", "/", f"expected bitstream_sha256 {firmware_sha256} of its [firmware], found {stated}")


def stated_config(record):
    """`testbench.config.Config` of the model that the record names; ValueError with one line if it is none."""
    from testbench import config

    try:
        tree = tomllib.loads(record.config_toml)
    except tomllib.TOMLDecodeError as problem:
        raise ValueError(f"not TOML: {problem}") from None
    return config.from_dict(tree, "config_toml")


def log(record):
    table = record.tables["registers"]
    if not schema.has_supported_map(record):
        return
    for k, (name, addr, raw) in enumerate(schema.rows(table, "name", "addr", "raw")):
        register = registers.BY_NAME.get(name)
        if register is None or register.access == "ro" or register.address != addr:
            yield Finding("R11", "/registers", f"expected a writable register, found {name} at {addr} in row {k}")
        elif not register.fmt.holds(raw):
            text = f"expected {register.fmt.lo} .. {register.fmt.hi}, found {raw} in row {k}"
            yield Finding("R04", f"/registers/{name}", text)


def check_segments(record):
    table, span = record.tables["segments"], span_edges(record)
    last, ids = 0, set()
    for name, a, b, kind, role in schema.rows(table, "id", "edge_a", "edge_b", "kind", "role"):
        path = f"/segments/{name}"
        if not 0 <= a < b <= span:
            yield Finding("R12", path, f"expected edges within 0 .. {span}, found {a} .. {b}")
        elif a < last:
            yield Finding(
                "R12", path, f"expected a segment that begins at edge {last} or later, found {a}: segments overlap"
            )
        if name in ids:
            yield Finding("R12", path, "expected different names, found a duplicate")
        if kind not in schema.KINDS or role not in schema.ROLES:
            yield Finding("R12", path, f"expected a kind and a role of the schema, found {kind} and {role}")
        ids.add(name)
        last = max(last, b)
    if schema.roles_sha256(table) != record.attrs["roles_sha256"]:
        yield Finding("R15", "/segments", "expected the roles that were hashed before the analysis, found other roles")


def repeats(record):
    groups = {}
    for group, role in schema.rows(record.tables["segments"], "repeat_group", "role"):
        groups.setdefault(group, []).append(role)
    for group, roles in groups.items():
        if {"fit", "validate"} <= set(roles):
            yield Finding("R13", f"/segments/{group}", "expected one role for all repeats, found fit and validate")
    fitted = [roles for roles in groups.values() if "fit" in roles]
    if not any(roles.count("fit") >= 2 for roles in fitted):
        yield Finding("R14", "/segments", "expected repeats, found none: effects are ranked, not confirmed", DOWNGRADED)


def priors(record):
    table = record.tables["priors"]
    declared_nuisances = [name.strip() for name in record.attrs["nuisances"].split(",") if name.strip()]
    for name in declared_nuisances:
        if name not in table["param"].data.tolist():
            yield Finding("R17", f"/priors/{name}", "expected a prior for this declared nuisance, found none")
    for name, dist, sd in schema.rows(table, "param", "dist", "sd"):
        if dist not in schema.DISTRIBUTIONS:
            mismatch = f"expected {', '.join(schema.DISTRIBUTIONS)}, found {dist}"
            yield Finding("R17", f"/priors/{name}", mismatch)
        if not sd > 0:
            yield Finding("R19", f"/priors/{name}", f"expected sd above 0, found {sd:g}")


def counters(record):
    span = span_edges(record)
    for name, table in record.tables.items():
        if not name.startswith("counter/"):
            continue
        if name.partition("/")[2] not in schema.COUNTER_PAIRS:
            yield Finding("R02", f"/{name}", f"expected one of {', '.join(schema.COUNTER_PAIRS)}, found another pair")
            continue
        missing = [key for key in schema.column_units(name) if key not in table]
        for key in missing:
            rule = "R18" if key == "edge" else "R02"
            yield Finding(rule, f"/{name}/{key}", "expected a column, found nothing")
        if missing:
            continue
        edges = table["edge"].data
        if len(edges) and not (0 <= edges.min() and edges.max() <= span):
            text = f"expected edges within 0 .. {span}, found {edges.min()} .. {edges.max()}"
            yield Finding("R18", f"/{name}/edge", text)
        if not (table["unc"].data > 0).all():
            yield Finding("R19", f"/{name}/unc", "expected uncertainties above 0, found 0 or less")


def uncertain(record):
    for name, key in schema.UNCERTAIN.items():
        if not (record.tables[name][key].data > 0).all():
            yield Finding("R19", f"/{name}/{key}", "expected uncertainties above 0, found 0 or less")
