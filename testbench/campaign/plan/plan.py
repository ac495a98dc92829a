"""A plan: which configurations, which engine, what is kept. TOML in, checked points out, one line for what is wrong.

    name, engine, base      text, name of an engine (or an axis of them), TOML configuration to start from
    [set]                   values over the base, as --set
    [axes.NAME]             a dimension: parameters that move together; different axes are multiplied
    [keep]                  frames, tau_s;  [keep.streams] column = frames;  [keep.statistics] column = [names]

Every point is checked as a configuration before the first one runs.
Source  docs/campaigns.md
"""

import difflib
import hashlib
import itertools
import math
import re
from pathlib import Path
from typing import NamedTuple

from testbench import config as configuration
from testbench.campaign.plan import engines
from testbench.campaign.plan.draws import MOST_VALUES, Spec
from testbench.campaign.plan.measure import STATISTICS, Keep
from testbench.campaign.plan.plan_points import Point, point_address, point_identity
from testbench.config.toml_text import short_toml
from testbench.errors import ConfigError, FileError
from testbench.storage.inputs import open_input, read_toml
from testbench.storage.spool import FIELDS

MAX_POINTS = 100_000
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
KEYS = ("name", "engine", "base", "set", "axes", "keep")
AXIS_KEYS = ("count", "seed", "cases")
KEEP_KEYS = ("frames", "tau_s", "streams", "statistics")
MOST_FRAMES = 8000
SET = "[set]"
ENGINE = "engine"  # the one parameter that is no key of the configuration
RESERVED_AXIS_NAME = re.compile(r"tau_s|time_\d+|point|address|status|identity")


class Axis(NamedTuple):
    """A dimension: its name, its length, {parameter: values} (None where a case leaves it), names of cases."""

    name: str
    length: int
    values: dict
    cases: tuple = ()


class Plan(NamedTuple):
    """A plan, read and checked in itself; `points` checks each of its points."""

    name: str
    engine: str
    tree: dict  # nested configuration of base and [set]
    axes: tuple
    keep: Keep
    source: str
    folder: Path
    origin: dict  # {dotted path: where it was given}, for error lines
    engines: dict  # {name of an engine: what `engines.load` takes}

    @property
    def shape(self):
        return tuple(axis.length for axis in self.axes)


def _hint(name, allowed_names):
    close_matches = difflib.get_close_matches(str(name), allowed_names, n=1, cutoff=0.5)
    return f"did you mean {close_matches[0]}?" if close_matches else f"known: {', '.join(allowed_names)}"


def _flat(tree, where):
    """{section.key: value} of nested or quoted dotted keys, and `engine`."""
    out = {}
    for key, value in tree.items():
        if key == ENGINE:
            out[key] = value
        elif isinstance(value, dict) and "." not in key:
            out |= {f"{key}.{inner}": item for inner, item in value.items()}
        elif key.count(".") == 1:
            out[key] = value
        else:
            raise ConfigError(f"{where} {key} is not of the form section.key, such as plant.fx_hz")
    for path in out:
        if path.startswith("output."):
            raise ConfigError(f"{where} {path}: a campaign writes only its store; choose what it stores in [keep]")
        if path == "scenario.engine":
            raise ConfigError(
                f"{where} {path}: the engine of a campaign is the plan's key engine; write it above [set]"
            )
        if path.startswith("scenario.plant"):
            raise ConfigError(f"{where} {path}: a campaign runs the built-in plant only; remove this key")
    return out


def _table(value, where):
    if not isinstance(value, dict):
        raise ConfigError(
            f"{where} = {short_toml(value)} is not a table; write [{where.split(': ')[-1]}] and its keys below"
        )
    return value


def read(path, sets=(), engine_options=()):
    """`Plan` of a TOML file.

    sets            texts as of `--set`, which win over [set]
    engine_options  texts as of `--engine`
    """
    path, extra_locations = Path(path), engines.parse_options(engine_options)
    tree = read_toml(path)
    for key in tree:
        if key not in KEYS:
            hint = f"; write [set] {key}..." if key in configuration.sections() else f"; {_hint(key, KEYS)}"
            raise ConfigError(f"{path}: {key} is not a key of a plan{hint}")
    name = tree.get("name", path.stem)
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise ConfigError(f"{path}: name = {short_toml(name)} is not made of letters, digits, dot, dash and underscore")
    base, origin = {}, {}
    if "base" in tree:
        if not isinstance(tree["base"], str):
            raise ConfigError(f"{path}: base = {short_toml(tree['base'])} is not the name of a file")
        base_path = path.parent / tree["base"]
        base = read_toml(base_path)
        configuration.from_dict(base, str(base_path))
        base.pop("output", None)
        base.get("scenario", {}).pop("engine", None)
    engine = tree.get("engine", "frame")
    engine_location = engines.find(engine, extra_locations, f"{path}: engine")
    override_values = _flat(_table(tree.get("set", {}), f"{path}: set"), f"{path}: [set]")
    origin |= dict.fromkeys(override_values, f"{path}: [set]")
    for item in (configuration.parse_set(text) for text in sets):
        override_values |= _flat({item.path: item.value}, "--set:")
        origin[item.path] = "--set"
    if ENGINE in override_values:
        raise ConfigError(f"{path}: [set] engine: it is a key of the plan itself; write it above [set]")
    for dotted, value in override_values.items():
        _set_dotted_key(base, dotted, value, origin[dotted])
    owner = {dotted: "--set" if origin[dotted] == "--set" else SET for dotted in override_values}
    axes = _axes(_table(tree.get("axes", {}), f"{path}: axes"), path, owner)
    locations = {engine: engine_location}
    for axis in axes:
        origin |= dict.fromkeys(axis.values, f"{path}: [axes.{axis.name}]")
        names = [name for name in axis.values.get(ENGINE, ()) if name is not None]
        locations |= {name: engines.find(name, extra_locations, f"{path}: [axes.{axis.name}] engine") for name in names}
    keep = _parse_keep_table(_table(tree.get("keep", {}), f"{path}: keep"), path)
    return Plan(name, engine, base, axes, keep, str(path), path.parent, origin, locations)


def _set_dotted_key(tree, dotted, value, where):
    section, _, key = dotted.partition(".")
    if not section or not key or "." in key:
        raise ConfigError(f"{where} {dotted}: is not of the form section.key")
    node = tree.setdefault(section, {})
    if not isinstance(node, dict):
        raise ConfigError(f"{where} {dotted}: {section} is a value, not a section")
    node[key] = value


# ---- axes ------------------------------------------------------------------------------------------------------------


def _axes(tree, path, owner_by_key):
    axes, owner = [], dict(owner_by_key)
    for name, table in tree.items():
        where = f"{path}: [axes.{name}]"
        if not NAME.fullmatch(name) or RESERVED_AXIS_NAME.fullmatch(name) or name in FIELDS or "." in name:
            raise ConfigError(f"{where} is not a valid name of an axis; choose another one")
        axis = _axis(name, _table(table, f"{path}: axes.{name}"), where)
        for dotted in axis.values:
            # a case may depart from what [set] says; a list that hides it is a mistake
            if dotted in owner and not (axis.cases and owner[dotted] == SET):
                raise ConfigError(f"{where} {dotted} is already set in {owner[dotted]}")
            owner[dotted] = f"[axes.{name}]"
        axes.append(axis)
    total = math.prod(axis.length for axis in axes)
    if total > MAX_POINTS:
        sizes = " x ".join(f"{axis.name} {axis.length}" for axis in axes)
        raise ConfigError(f"{path}: axes: {sizes} = {total} points are above the limit {MAX_POINTS}")
    return tuple(axes)


def _integer(table, key, default, lo, where):
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < lo:
        raise ConfigError(f"{where} {key} = {short_toml(value)} is not an integer of at least {lo}")
    return value


def _axis(name, table, where):
    if "cases" in table:
        return _cases(name, table, where)
    specs = {
        dotted: Spec(dotted, value, f"{where} {dotted}")
        for dotted, value in _flat({k: v for k, v in table.items() if k not in AXIS_KEYS}, where).items()
    }
    if not specs:
        raise ConfigError(f"{where} has no parameters; write section.key = [values] below it")
    seed = _integer(table, "seed", 1, 0, where)
    lengths = {dotted: spec.length for dotted, spec in specs.items() if spec.length is not None}
    if "count" in table:
        length = _integer(table, "count", 1, 1, where)
        if length > MOST_VALUES:
            raise ConfigError(f"{where} count = {length} is above the limit {MOST_VALUES} values")
        lengths = {"count": length} | lengths
    elif not lengths:
        raise ConfigError(f"{where} draws its values without a count; write count = NUMBER")
    length = next(iter(lengths.values()))
    if len(set(lengths.values())) > 1:
        sizes = ", ".join(f"{dotted} {n}" for dotted, n in lengths.items())
        raise ConfigError(f"{where} has lists of different lengths, but needs equal ones: {sizes}")
    if length > MAX_POINTS:
        raise ConfigError(f"{where} has {length} values, above the limit {MAX_POINTS}")
    values = {dotted: spec.values(length, seed) for dotted, spec in specs.items()}
    return Axis(name, length, values)


def _cases(name, table, where):
    """[[axes.NAME.cases]]: each with a name and any parameters; what a case leaves out stays as the base has it."""
    cases = table["cases"]
    other = [key for key in table if key != "cases"]
    if other:
        raise ConfigError(f"{where} has both cases and {other[0]}; write the parameters into the cases")
    if not isinstance(cases, list) or not cases or not all(isinstance(case, dict) for case in cases):
        raise ConfigError(f"{where} cases = {short_toml(cases)} is not a list of at least one table")
    case_names, rows = [], []
    for k, case in enumerate(cases):
        title = case.get("name")
        if not isinstance(title, str) or not title or title in case_names:
            raise ConfigError(f"{where} cases[{k}].name = {short_toml(title)} is not a unique text")
        case_names.append(title)
        rows.append(_flat({key: v for key, v in case.items() if key != "name"}, f"{where} cases[{k}]"))
    paths = list(dict.fromkeys(dotted for row in rows for dotted in row))
    return Axis(name, len(cases), {dotted: [row.get(dotted) for row in rows] for dotted in paths}, tuple(case_names))


# ---- keep ------------------------------------------------------------------------------------------------------------


def _parse_keep_table(tree, path):
    where = f"{path}: [keep]"
    for key in tree:
        if key not in KEEP_KEYS:
            raise ConfigError(f"{where} {key} is not a key; {_hint(key, KEEP_KEYS)}")
    frames = _integer(tree, "frames", 1, 1, where)
    streams = _table(tree.get("streams", {}), f"{path}: keep.streams")
    statistics = _table(tree.get("statistics", {}), f"{path}: keep.statistics")
    for table, part in ((streams, "streams"), (statistics, "statistics")):
        for column in table:
            if column not in FIELDS:
                raise ConfigError(f"{path}: [keep.{part}] {column} is not a stream; {_hint(column, list(FIELDS))}")
    for column in streams:
        if _integer(streams, column, 1, 1, f"{path}: [keep.streams]") > MOST_FRAMES:
            raise ConfigError(f"{path}: [keep.streams] {column} is above the limit {MOST_FRAMES} frames")
    for column, kinds in statistics.items():
        if not isinstance(kinds, list) or not kinds:
            raise ConfigError(f"{path}: [keep.statistics] {column} = {short_toml(kinds)} is not a list of names")
        for kind in kinds:
            if kind not in STATISTICS:
                raise ConfigError(
                    f"{path}: [keep.statistics] {column}: {short_toml(kind)} is not a statistic; "
                    f"{_hint(kind, STATISTICS)}"
                )
    tau_s = _taus(tree.get("tau_s", []), where)
    if not tau_s and any("adev" in kinds for kinds in statistics.values()):
        raise ConfigError(f"{where} adev needs tau_s, a list of averaging times such as tau_s = [0.01, 0.1]")
    return Keep(dict(streams), {name: list(kinds) for name, kinds in statistics.items()}, frames, tau_s)


def _taus(values, where):
    if not isinstance(values, list):
        raise ConfigError(f"{where} tau_s = {short_toml(values)} is not a list of seconds")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
            raise ConfigError(f"{where} tau_s: {short_toml(value)} is not a number above 0 s")
    return [float(value) for value in values]


# ---- points ----------------------------------------------------------------------------------------------------------


def point_config_tree(plan, index):
    """(nested configuration, name of the engine) at a place on the axes."""
    tree = {section: dict(keys) if isinstance(keys, dict) else keys for section, keys in plan.tree.items()}
    engine = plan.engine
    for axis, k in zip(plan.axes, index):
        for dotted, values in axis.values.items():
            if values[k] is None:
                continue
            if dotted == ENGINE:
                engine = values[k]
            else:
                _set_dotted_key(tree, dotted, values[k], f"[axes.{axis.name}]")
    return tree, engine


def points(plan):
    """(points, {hash: path} of the state files they start from); ConfigError for the first that cannot be."""
    from testbench.run import design_check

    out, states, state_digests, rates = [], {}, {}, set()
    for number, index in enumerate(itertools.product(*(range(n) for n in plan.shape))):
        tree, name = point_config_tree(plan, index)
        engine = plan.engines[name]
        config = _build_point_config(plan, tree, number, design_check.check)
        rates.add(config.design_record().frame_hz)
        digest = ""
        if config.scenario.resume:
            digest = state_digests.get(config.scenario.resume) or _state(plan, config.scenario.resume)
            state_digests[config.scenario.resume] = digest
            states[digest] = plan.folder / config.scenario.resume
        identity = point_identity(config, engine, plan.keep, digest)
        out.append(Point(number, index, identity, point_address(identity), engine))
    if len(rates) > 1 and plan.keep.streams:
        text = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise ConfigError(f"{plan.source}: [keep.streams]: points with {text} frames a second have no common time axis")
    return out, states


def _build_point_config(plan, tree, number, check):
    try:
        config = configuration.from_dict(tree, plan.source, plan.origin)
        check(config)
        _check_taus(plan, config.design_record())
        return config
    except ConfigError as problem:
        text = str(problem)
    raise ConfigError(f"{text} (point {number})" if plan.axes else text)


def _check_taus(plan, design):
    """Averaging times are whole numbers of rows of each point's own frame rate."""
    frames = plan.keep.frames
    step_s = frames / design.frame_hz
    for value in plan.keep.tau_s:
        ratio = value / step_s
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
            raise ConfigError(
                f"{plan.source}: [keep] tau_s: {value:g} s is not a multiple of {frames} frames of "
                f"{1e6 / design.frame_hz:g} us ({step_s:g} s)"
            )


def _state(plan, name):
    path = plan.folder / name
    try:
        with open_input(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileError as problem:
        raise ConfigError(f"{plan.source}: scenario.resume: {problem}") from None


def value_at(plan, axis, dotted, k):
    """Value of an axis's parameter at its place k: what a case leaves out is as the base has it."""
    value = axis.values[dotted][k]
    if value is not None:
        return value
    if dotted == ENGINE:
        return plan.engine
    section, key = dotted.split(".")
    base_section = plan.tree.get(section, {})
    return base_section[key] if key in base_section else getattr(getattr(configuration.Config(), section), key)
