"""Results of a plan, made from its finished points: one netCDF file over the axes, and one table with a row per point.

    results/NAME.nc    dimensions: the axes, then tau_s and time_N of a variable; nan or "" where a point is missing
                       coordinates: the lone number of an axis; else names of cases, or places counted from 0
    results/NAME.csv   number, address, finished or not, parameters, numbers

Both are functions of the plan and of which points are finished: no times, no versions, one order.
Source  docs/campaigns.md
"""

import contextlib
import csv
import io
import json
import math
from typing import NamedTuple

import h5py
import numpy as np

from testbench import config as configuration
from testbench.campaign import plan as plans
from testbench.campaign import shard
from testbench.campaign.measure import Variable
from testbench.errors import FileError
from testbench.files import GuardedFile, discard, explain, part_of, publish, write_text

SCHEMA = "gyrocampaign/1"


class Stored(NamedTuple):
    """A plan as the store keeps it."""

    plan: plans.Plan
    addresses: tuple


def plan_path(store, name):
    """Where the store keeps a plan."""
    return store.path / "plans" / f"{name}.json"


def plan_names(store):
    """Names of the plans that were run in a store."""
    return sorted(path.stem for path in (store.path / "plans").glob("*.json"))


def stored(store, name):
    """`Stored` plan of a name."""
    path = plan_path(store, name)
    try:
        data = json.loads(path.read_text())
    except OSError:
        known = ", ".join(plan_names(store)) or "none"
        raise FileError(f"{store.path}: has no plan {name!r}; known: {known}") from None
    except ValueError:
        raise FileError(f"{path}: is damaged; run the campaign again") from None
    addresses = data.pop("points")
    return Stored(plans.from_data(data, str(path)), tuple(addresses))


def results(store, name):
    """(netCDF, table): where the results of a plan are."""
    return store.path / "results" / f"{name}.nc", store.path / "results" / f"{name}.csv"


def read_point(store, address):
    """(identity, variables) of a finished point."""
    path = store.point(address)
    try:
        return shard.decode(path.read_bytes(), path)
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None


# ---- coordinates -----------------------------------------------------------------------------------------------------


def _unit(dotted):
    if dotted == plans.ENGINE:
        return ""
    section, key = dotted.split(".")
    info = configuration.sections()[section].model_fields[key]
    return (info.json_schema_extra or {}).get("unit", "")


def _values(items):
    """Values of a parameter as an array: numbers, or texts (JSON where they are lists)."""
    if all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items):
        array = np.array(items)
        return array if array.dtype.kind in "if" else array.astype(float)
    return np.array([item if isinstance(item, str) else json.dumps(item) for item in items], object)


def coordinates(plan):
    """({dimension: Variable}, {name: Variable}): coordinates of the axes, and their other parameters."""
    scales, other = {}, {}
    for axis in plan.axes:
        columns = {}
        for dotted in axis.values:
            values = _values([plans.value_at(plan, axis, dotted, k) for k in range(axis.length)])
            unit = _unit(dotted)
            attrs = {"parameter": dotted, **({"units": unit} if unit else {})}
            columns[dotted] = Variable((axis.name,), values, attrs)
        lone = next(iter(columns.values())) if len(columns) == 1 and not axis.cases else None
        distinct = lone is not None and lone.data.dtype.kind in "if" and len(set(lone.data.tolist())) == axis.length
        if distinct:
            scales[axis.name] = lone
            continue
        place = np.array(axis.cases, object) if axis.cases else np.arange(axis.length)
        scales[axis.name] = Variable((axis.name,), place, {})
        other |= columns
    return scales, other


# ---- netCDF ----------------------------------------------------------------------------------------------------------


class _Layout(NamedTuple):
    """A variable over all points: its own dimensions with their greatest lengths, its type, its attributes."""

    dims: tuple
    shape: tuple
    kind: str  # text, int or float
    dtype: np.dtype
    attrs: dict
    count: int


def _layouts(store, addresses):
    """{name: _Layout} over all finished points, in the order of their first appearance."""
    out = {}
    for address in addresses:
        _, variables = read_point(store, address)
        for name, (dims, data, attrs) in variables.items():
            array = np.asarray(data)
            kind = "text" if isinstance(data, str) else "int" if array.dtype.kind in "iu" else "float"
            was = out.get(name)
            if was is None:
                out[name] = _Layout(dims, array.shape, kind, array.dtype, attrs, 1)
                continue
            if was.dims != dims or ("text" in (was.kind, kind) and was.kind != kind):
                raise FileError(f"{name} differs in kind between points; give them plans of their own")
            shape = tuple(max(a, b) for a, b in zip(was.shape, array.shape))
            even = shape == was.shape == array.shape
            kind = kind if kind == was.kind and even else ("text" if kind == "text" else "float")
            out[name] = was._replace(shape=shape, kind=kind, count=was.count + 1)
    return out


def _write_netcdf(store, wanted, path):
    """Write results/NAME.nc; streams go through the memory one point at a time."""
    plan, addresses = wanted
    present = [store.has(address) for address in addresses]
    finished = list(dict.fromkeys(a for a, here in zip(addresses, present) if here))
    layouts = _layouts(store, finished)
    whole = all(present)
    scales, other = coordinates(plan)
    dims = tuple(axis.name for axis in plan.axes)
    needed = {name: Variable(layout.dims, np.broadcast_to(0, layout.shape), {}) for name, layout in layouts.items()}
    scales |= shard.scales_of(needed, plan.keep.tau_s)
    status = np.array([1 if here else 0 for here in present], np.int8).reshape(plan.shape)
    results = {}
    results["finished"] = Variable(dims, status, {"long_name": "1: the point is finished, 0: it is not"})
    results["point"] = Variable(dims, np.array(addresses, object).reshape(plan.shape), {"long_name": "address"})
    other_names = " ".join(other)
    with _hdf5(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["plan"] = plan.name
        shard.write_variables(file, other | results, scales)
        datasets = {name: _create(file, name, layout, dims, plan.shape, whole) for name, layout in layouts.items()}
        for name, layout in layouts.items():
            for key, value in layout.attrs.items():
                datasets[name].attrs[key] = value
            if other_names:  # a convention by which xarray knows parameters from results
                datasets[name].attrs["coordinates"] = other_names
            for k, dim in enumerate(dims + layout.dims):
                datasets[name].dims[k].attach_scale(file[dim])
        for place, address in zip(np.ndindex(*plan.shape), addresses):
            if not store.has(address):
                continue
            for name, variable in read_point(store, address)[1].items():
                size = np.shape(variable.data)
                datasets[name][place + tuple(slice(n) for n in size)] = variable.data


def _create(file, name, layout, dims, shape, whole):
    full = shape + layout.shape
    if layout.kind == "text":
        return file.create_dataset(name, data=np.full(full, "", object), dtype=shard.TEXT)
    # integers stay integers only where every place has one
    every = whole and layout.count and layout.kind == "int"
    dtype = layout.dtype if every else np.dtype("<f8")
    chunks = (1,) * len(shape) + layout.shape if layout.shape and all(layout.shape) else None
    return file.create_dataset(name, full, dtype, chunks=chunks, fillvalue=0 if every else math.nan)


@contextlib.contextmanager
def _hdf5(path):
    """HDF5 file that is whole or absent, also when the disk is full."""
    try:
        guard = GuardedFile(part_of(path))
    except OSError as problem:
        raise explain(path, problem) from None
    file = h5py.File(guard, "w")
    try:
        try:
            yield file
        finally:
            file.close()
            guard.close()
        if guard.problem is not None:
            raise guard.problem
        publish(path)
    except OSError as problem:
        raise explain(path, guard.problem or problem) from None
    finally:
        discard(path)


# ---- table -----------------------------------------------------------------------------------------------------------


def _cell(value):
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)


def rows(store, wanted):
    """(heads, rows) of the table: one row per point, scalars only, an adev per tau_s; None where there is nothing."""
    plan, addresses = wanted
    parameters = [(axis, dotted) for axis in plan.axes for dotted in axis.values]
    numbers, found = {}, []
    for address in addresses:
        one = {}
        if store.has(address):
            for name, (dims, data, _) in read_point(store, address)[1].items():
                if not dims:
                    one[name] = data if isinstance(data, str) else float(data)
                elif dims == ("tau_s",):
                    one |= {f"{name}[{tau:g} s]": float(v) for tau, v in zip(plan.keep.tau_s, data)}
        numbers |= dict.fromkeys(one)
        found.append(one)
    names = [axis.name for axis in plan.axes if axis.cases]
    heads = ["number", "point", "finished", *names, *(dotted for _, dotted in parameters), *numbers]
    table = []
    for k, (place, address, one) in enumerate(zip(np.ndindex(*plan.shape), addresses, found)):
        at = {axis.name: n for axis, n in zip(plan.axes, place)}
        cells = [k, address, int(bool(one))]
        cells += [axis.cases[at[axis.name]] for axis in plan.axes if axis.cases]
        cells += [_scalar(plans.value_at(plan, axis, dotted, at[axis.name])) for axis, dotted in parameters]
        table.append(cells + [one.get(name) for name in numbers])
    return heads, table


def _scalar(value):
    return value if isinstance(value, (int, float, str)) else json.dumps(value)


def _write_table(store, wanted, path):
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    heads, table = rows(store, wanted)
    writer.writerow(heads)
    writer.writerows([["" if cell is None else _cell(cell) for cell in row] for row in table])
    write_text(path, text.getvalue())


def write(store, name):
    """Make the results of a plan anew; returns the paths."""
    wanted = stored(store, name)
    netcdf, table = results(store, name)
    _write_netcdf(store, wanted, netcdf)
    _write_table(store, wanted, table)
    return [netcdf, table]


def write_parquet(store, name, path):
    """The table as Parquet; needs pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise FileError(f"{path}: pyarrow is not installed; pip install 'ftr-gyro[campaign]'") from None
    heads, table = rows(store, stored(store, name))
    columns = {head: [row[k] for row in table] for k, head in enumerate(heads)}
    sink = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), sink)
    from testbench.files import write_bytes

    write_bytes(path, sink.getvalue())
