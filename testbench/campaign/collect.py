"""Results of a plan, made from its finished points: one netCDF file over the axes, and one table with a row per point.

    results/NAME.nc    dimensions: the axes, then tau_s and time_N of a variable; nan or "" where a point is missing
                       coordinates: the lone number of an axis; else names of cases, or places counted from 0
    results/NAME.csv   number, address, finished or not, parameters, numbers

Both are functions of the plan and of which points are finished: no times, no versions, one order. A point that is not
what its address says (`verify`) counts as missing.
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
from testbench.campaign import shard
from testbench.campaign.plan import plan as plans
from testbench.campaign.plan import stored
from testbench.campaign.plan.measure import Variable
from testbench.campaign.verify import read_point
from testbench.errors import FileError
from testbench.interrupts import defer_interrupts
from testbench.storage.files import GuardedFile, atomic_outputs, explain, replace_file, write_bytes, write_text

SCHEMA = "gyrocampaign/1"


class StoredPlan(NamedTuple):
    """A plan as the store keeps it."""

    plan: plans.Plan
    addresses: tuple


def plan_path(store, name):
    """Where the store keeps a plan."""
    return store.path / "plans" / f"{name}.json"


def plan_names(store):
    """Names of the plans that were run in a store."""
    return sorted(path.stem for path in (store.path / "plans").glob("*.json"))


def read_stored_plan(store, name):
    """`StoredPlan` of a name."""
    if name not in plan_names(store):
        plan_listing = ", ".join(plan_names(store)) or "none"
        raise FileError(f"{store.path}: has no plan {name!r}; known: {plan_listing}")
    return StoredPlan(*stored.read(plan_path(store, name)))


def result_paths(store, name):
    """(netCDF, table): where the results of a plan are."""
    return store.path / "results" / f"{name}.nc", store.path / "results" / f"{name}.csv"


# ---- coordinates -----------------------------------------------------------------------------------------------------


def _parameter_unit(dotted):
    if dotted == plans.ENGINE:
        return ""
    section, key = dotted.split(".")
    info = configuration.sections()[section].model_fields[key]
    return (info.json_schema_extra or {}).get("unit", "")


def _coordinate_array(items):
    """Values of a parameter as an array: numbers, or texts (JSON where they are lists)."""
    if all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items):
        numeric_array = np.array(items)
        return numeric_array if numeric_array.dtype.kind in "if" else numeric_array.astype(float)
    return np.array([item if isinstance(item, str) else json.dumps(item) for item in items], object)


def coordinates(plan):
    """({dimension: Variable}, {name: Variable}): coordinates of the axes, and their other parameters."""
    scales, other = {}, {}
    for axis in plan.axes:
        columns = {}
        for dotted in axis.values:
            values = _coordinate_array([plans.value_at(plan, axis, dotted, k) for k in range(axis.length)])
            unit = _parameter_unit(dotted)
            attrs = {"parameter": dotted, **({"units": unit} if unit else {})}
            columns[dotted] = Variable((axis.name,), values, attrs)
        lone = next(iter(columns.values())) if len(columns) == 1 and not axis.cases else None
        distinct = lone is not None and lone.data.dtype.kind in "if" and len(set(lone.data.tolist())) == axis.length
        if distinct:
            scales[axis.name] = lone
            continue
        axis_labels = np.array(axis.cases, object) if axis.cases else np.arange(axis.length)
        scales[axis.name] = Variable((axis.name,), axis_labels, {})
        other |= columns
    return scales, other


# ---- points ----------------------------------------------------------------------------------------------------------


class Stub(NamedTuple):
    """A stream that was left on the disk."""

    shape: tuple
    dtype: np.dtype


class Loaded(NamedTuple):
    """{address: {name: Variable}} of finished points, and {address: what is wrong} of those that cannot count."""

    point_data: dict
    faults: dict


def load(store, addresses):
    """`Loaded` finished points; streams are `Stub`s, so that an hour of each fits."""
    out, written = Loaded({}, {}), store.journal_hashes()
    for address in dict.fromkeys(addresses):
        if store.has(address):
            try:
                _, variables = read_point(store, address, written)
            except FileError as problem:
                out.faults[address] = str(problem)
                continue
            out.point_data[address] = {name: _light(variable) for name, variable in variables.items()}
    return out


def _light(variable):
    if not any(dim.startswith("time_") for dim in variable.dims):
        return variable
    return variable._replace(data=Stub(variable.data.shape, variable.data.dtype))


# ---- netCDF ----------------------------------------------------------------------------------------------------------


class _Layout(NamedTuple):
    """A variable over all points: its own dimensions with their greatest lengths, its type, its attributes."""

    dims: tuple
    shape: tuple
    dtype: np.dtype  # object for texts
    attrs: dict


def _layouts(plan, point_data):
    """{name: _Layout} over all finished points."""
    out, reserved_names = {}, {"finished", "point"} | {name for axis in plan.axes for name in (axis.name, *axis.values)}
    for address, variables in point_data.items():
        reserved_names |= {dim for variable in variables.values() for dim in variable.dims}
        for name, (dims, data, attrs) in variables.items():
            if name in reserved_names:
                raise FileError(
                    f"{store_name(address)}: the result {name} has the name of a dimension or of a parameter"
                )
            if dims == ("tau_s",) and np.shape(data) != (len(plan.keep.tau_s),):
                raise FileError(f"{store_name(address)}: {name} was computed for other tau_s than those of the plan")
            text = isinstance(data, str)
            value_array = data if isinstance(data, Stub) else np.asarray(data)
            shape, dtype = value_array.shape, np.dtype(object) if text else value_array.dtype
            was = out.setdefault(name, _Layout(dims, shape, dtype, attrs))
            if was.dims != dims or (was.dtype == object) != text:
                raise FileError(f"{store_name(address)}: {name} has another data type than in other points")
            longest = tuple(max(a, b) for a, b in zip(was.shape, shape))
            # integers stay integers only if every point has as many
            is_uniform = was.dtype == dtype and was.shape == shape
            out[name] = was._replace(shape=longest, dtype=was.dtype if is_uniform else np.dtype(float))
    return out


def store_name(address):
    """Address as in the file names of a store."""
    return f"{address[:2]}/{address[2:]}"


@defer_interrupts()  # the HDF5 library calls Python to write, and knows no exceptions
def _write_netcdf(store, stored_plan, point_data, path):
    """Write results/NAME.nc; streams go through the memory one point at a time."""
    plan, addresses = stored_plan
    dims = tuple(axis.name for axis in plan.axes)
    layouts = _layouts(plan, point_data)
    is_complete = all(address in point_data and layouts.keys() == point_data[address].keys() for address in addresses)
    scales, parameters = coordinates(plan)
    empty = {name: Variable(v.dims, np.broadcast_to(0, v.shape), v.attrs) for name, v in layouts.items()}
    scales |= shard.dimension_scales(empty, plan.keep.tau_s)
    # a convention by which xarray knows parameters from results
    coords = {"coordinates": " ".join(parameters)} if parameters else {}
    finished_flags = np.array([address in point_data for address in addresses], np.int8).reshape(plan.shape)
    address_array = np.array(addresses, object).reshape(plan.shape)
    results = {
        "finished": Variable(dims, finished_flags, {"long_name": "1: the point is finished, 0: it is not", **coords}),
        "point": Variable(dims, address_array, {"long_name": "address", **coords}),
    }
    streams = {}
    for name, layout in layouts.items():
        attrs = layout.attrs | coords
        if any(dim.startswith("time_") for dim in layout.dims):
            streams[name] = layout, attrs
        else:
            data = _stack_variable(name, layout, plan, [point_data.get(address, {}) for address in addresses])
            results[name] = Variable(dims + layout.dims, data, attrs)
    with _hdf5(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["plan"] = plan.name
        shard.write_variables(file, parameters | results, scales)
        if streams:
            _write_streams(file, store, stored_plan, point_data, streams, is_complete)


def _stack_variable(name, layout, plan, variables_by_point):
    """A variable of all points in memory."""
    text = layout.dtype == object
    data = np.full((len(variables_by_point), *layout.shape), "" if text else math.nan, object if text else float)
    for k, variables in enumerate(variables_by_point):
        if name in variables:
            data[k] = variables[name].data
    return data.reshape(plan.shape + layout.shape)


def _write_streams(file, store, stored_plan, point_data, streams, is_complete):
    plan, addresses = stored_plan
    dims = tuple(axis.name for axis in plan.axes)
    datasets = {}
    for name, (layout, attrs) in streams.items():
        dtype = layout.dtype if is_complete else np.dtype(float)
        chunks = (1,) * len(dims) + layout.shape if all(layout.shape) else None
        fill = math.nan if dtype.kind == "f" else 0
        datasets[name] = file.create_dataset(name, plan.shape + layout.shape, dtype, chunks=chunks, fillvalue=fill)
        datasets[name].attrs.update(attrs)
        for k, dim in enumerate(dims + layout.dims):
            datasets[name].dims[k].attach_scale(file[dim])
    for plan_index, address in zip(np.ndindex(*plan.shape), addresses):
        if address in point_data:
            variables = read_point(store, address)[1]
            for name in streams.keys() & variables.keys():
                data = variables[name].data
                datasets[name][plan_index + tuple(slice(n) for n in data.shape)] = data


@contextlib.contextmanager
def _hdf5(path):
    """HDF5 file that is whole or absent, also when the disk is full."""
    with replace_file(path) as part:
        guard = GuardedFile(part)
        file = h5py.File(guard, "w")
        try:
            yield file
        except OSError as problem:
            raise explain(path, guard.problem or problem) from None
        finally:
            file.close()
            guard.close()
        if guard.problem is not None:
            raise guard.problem


# ---- table -----------------------------------------------------------------------------------------------------------


def _cell(value):
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)


def rows(stored_plan, point_data):
    """(heads, rows) of the table: one row per point, scalars only, an adev per tau_s; None where there is nothing."""
    plan, addresses = stored_plan
    parameters = [(axis, dotted) for axis in plan.axes for dotted in axis.values]
    numbers, cells_of = {}, {}
    for address, variables in point_data.items():
        one = cells_of[address] = {}
        for name, (dims, data, _) in variables.items():
            if not dims:
                one[name] = data if isinstance(data, str) else float(data)
            elif dims == ("tau_s",):
                one |= {f"{name}[{tau:g} s]": float(v) for tau, v in zip(plan.keep.tau_s, data)}
        numbers |= dict.fromkeys(one)
    case_axis_names = [axis.name for axis in plan.axes if axis.cases]
    heads = ["number", "point", "finished", *case_axis_names, *(dotted for _, dotted in parameters), *numbers]
    table = []
    for k, (plan_index, address) in enumerate(zip(np.ndindex(*plan.shape), addresses)):
        one = cells_of.get(address, {})
        at = {axis.name: n for axis, n in zip(plan.axes, plan_index)}
        cells = [k, address, int(address in point_data)]
        cells += [axis.cases[at[axis.name]] for axis in plan.axes if axis.cases]
        cells += [_scalar(plans.value_at(plan, axis, dotted, at[axis.name])) for axis, dotted in parameters]
        table.append(cells + [one.get(name) for name in numbers])
    return heads, table


def _scalar(value):
    return value if isinstance(value, (int, float, str)) else json.dumps(value)


def _write_table(stored_plan, point_data, path):
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    heads, table = rows(stored_plan, point_data)
    writer.writerow(heads)
    writer.writerows([["" if cell is None else _cell(cell) for cell in row] for row in table])
    write_text(path, text.getvalue())


def write(store, name):
    """Make the results of a plan anew; returns ([path, ...], {address: what is wrong} of points that do not count)."""
    stored_plan = read_stored_plan(store, name)
    netcdf, table = result_paths(store, name)
    point_data, faults = load(store, stored_plan.addresses)
    with atomic_outputs():
        _write_netcdf(store, stored_plan, point_data, netcdf)
        _write_table(stored_plan, point_data, table)
    return [netcdf, table], faults


def write_parquet(store, name, path):
    """The table as Parquet, for which pyarrow is needed; returns {address: what is wrong} as `write`."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise FileError(f"{path}: pyarrow is not installed; run pip install '.[campaign]' in the clone") from None
    stored_plan = read_stored_plan(store, name)
    point_data, faults = load(store, stored_plan.addresses)
    heads, table = rows(stored_plan, point_data)
    columns = {head: [row[k] for row in table] for k, head in enumerate(heads)}
    sink = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), sink)
    write_bytes(path, sink.getvalue())
    return faults
