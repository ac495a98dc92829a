"""State of a simulation in a file: numbers by name, bit for bit, with the layout that they belong to and a hash.

Source  docs/record.md
"""

import hashlib
import json

import h5py
import numpy as np

from testbench.errors import FileError
from testbench.interrupts import defer_interrupts
from testbench.storage.files import GuardedFile, replace_file, seal
from testbench.storage.hdf5_input import open_hdf5
from testbench.storage.inputs import parse_json
from testbench.storage.record import KINDS, RecordError, column_digest, plain_attribute, versions
from testbench.storage.record_read import DAMAGED, Value, text_attribute

STATE_SCHEMA = "gyrostate/1.0"


@defer_interrupts()
def save_state(path, values, source_format, meta=None):
    """Save a simulation's state, whole or not at all.

    values         name -> int, float or array of numbers; restored with the same type, bit for bit
    source_format  text that names the layout of `values`; loading with another one is refused
    meta           texts and numbers to keep along
    """
    arrays = {name: np.asarray(value) for name, value in values.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in KINDS or "/" in name:
            raise ValueError(f"state {name}: {array.dtype} is not a number type, or the name holds a slash")
    meta = {key: plain_attribute(value) for key, value in (meta or {}).items()}
    with replace_file(path) as part:
        guard = GuardedFile(part)
        with guard:
            with h5py.File(guard, "w") as file:
                file.attrs["schema"] = STATE_SCHEMA
                file.attrs["source_format"] = source_format
                file.attrs["meta"] = json.dumps(meta)
                file.attrs["versions"] = json.dumps(versions())
                file.attrs["content_sha256"] = _state_digest(arrays, source_format, meta)
                group = file.create_group("state")
                for name, array in arrays.items():
                    group.create_dataset(name, data=array.astype(array.dtype.newbyteorder("<")))
                    group[name].attrs["scalar"] = int(not isinstance(values[name], np.ndarray))
        if guard.problem is not None:
            raise guard.problem
        seal(part)


def load_state(path, *layouts):
    """(values, meta) of a state file; RecordError if it is damaged or of a layout that is not among those given."""
    with open_hdf5(path) as file:
        try:
            if file.attrs.get("schema") != STATE_SCHEMA:
                file_schema = file.attrs.get("schema", "nothing")
                raise RecordError(path, [f"R01 / expected schema {STATE_SCHEMA}, found {file_schema}"])
            saved = text_attribute(file.attrs["source_format"])
            if saved not in layouts:
                finding = f"R11 / expected state layout {layouts[0]}, found {saved}: saved by another version"
                raise RecordError(path, [finding])
            meta = parse_json(file.attrs["meta"], "meta", dict[str, Value])
            arrays = {name: dataset[()] for name, dataset in file["state"].items()}
            scalars = {name for name, dataset in file["state"].items() if dataset.attrs["scalar"]}
            digest = _state_digest({k: np.asarray(v) for k, v in arrays.items()}, saved, meta)
            if digest != text_attribute(file.attrs["content_sha256"]):
                raise RecordError(path, ["R15 /state expected another content_sha256: the file is damaged"])
            values = {name: array.item() if name in scalars else array for name, array in arrays.items()}
        except RecordError:
            raise
        except (FileError, *DAMAGED) as problem:
            text = " ".join(str(problem).split())
            raise RecordError(path, [f"R01 / expected a complete state, found damage: {text}"]) from None
    return values, meta


def check_shapes(path, values, template_values):
    """RecordError unless every value has the type and shape of its namesake."""
    if set(values) != set(template_values):
        strange = min(set(values) ^ set(template_values))
        raise RecordError(path, [f"R02 /state/{strange} expected the values of this layout, found more or fewer"])
    for name, template_value in template_values.items():
        have, want = np.asarray(values[name]), np.asarray(template_value)
        if (have.shape, have.dtype.kind) != (want.shape, want.dtype.kind):
            mismatch = f"expected {want.dtype} {want.shape}, found {have.dtype} {have.shape}"
            raise RecordError(path, [f"R04 /state/{name} {mismatch}"])


def _state_digest(arrays, source_format, meta):
    columns = {k: [a.dtype.kind, a.dtype.itemsize, list(a.shape), column_digest(a)] for k, a in arrays.items()}
    text = json.dumps([STATE_SCHEMA, source_format, meta, columns], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
