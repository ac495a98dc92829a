"""A measurement record as another program would write it: h5py, SHA-256 and docs/record.md, nothing of this project.

write(path, head, config_toml, streams, tables)    streams {name: (unit, edge0, attributes, integers)}
                                                   tables {table: {column: (unit, values)}}
"""

import hashlib
import struct

import h5py
import numpy as np

FRAME = 3250


def json_text(value):
    """The page's JSON: sorted keys, ", " and ": ", ASCII, shortest doubles."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json_text(k)}: {json_text(value[k])}" for k in sorted(value)) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(json_text(item) for item in value) + "]"
    if isinstance(value, str):
        return '"' + "".join(_character(c) for c in value) + '"'
    return _double(float(value)) if isinstance(value, (float, np.floating)) else str(int(value))


def _character(c):
    named = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t", "\b": "\\b", "\f": "\\f"}
    if c in named:
        return named[c]
    if 32 <= ord(c) < 127:
        return c
    units = struct.unpack(f">{len(c.encode('utf-16-be')) // 2}H", c.encode("utf-16-be"))
    return "".join(f"\\u{unit:04x}" for unit in units)


def _double(x):
    """Shortest decimal that reads back the same."""
    for digits in range(1, 18):
        text = f"{x:.{digits - 1}e}"
        if float(text) == x:
            break
    mantissa, exponent = text.split("e")
    power = int(exponent)
    sign, whole = ("-", mantissa[1:]) if mantissa.startswith("-") else ("", mantissa)
    digits = whole.replace(".", "").rstrip("0") or "0"
    if x != 0 and not -4 <= power < 16:
        shown = digits[0] + ("." + digits[1:] if len(digits) > 1 else "")
        return f"{sign}{shown}e{'-' if power < 0 else '+'}{abs(power):02d}"
    if power < 0:
        return f"{sign}0.{'0' * (-power - 1)}{digits}"
    digits = digits.ljust(power + 1, "0")
    return f"{sign}{digits[: power + 1]}.{digits[power + 1 :] or '0'}"


def sha256(data):
    return hashlib.sha256(data).hexdigest()


def column_hash(values):
    if len(values) and isinstance(values[0], str):
        texts = [text.encode() for text in values]
        return sha256(b"".join(struct.pack("<Q", len(text)) + text for text in texts))
    array = np.asarray(values)
    return sha256(array.astype(array.dtype.newbyteorder("<")).tobytes())


def content_hash(streams, tables, config_toml, provenance, ppm, head):
    return sha256(json_text(["gyrorec/1.0", streams, tables, config_toml, provenance, ppm, head]).encode())


def roles_hash(rows):
    return sha256(json_text([list(row) for row in rows]).encode())


def write(path, head, config_toml, streams, tables):
    """One HDF5 file, without a seal."""
    s = {key: tables["segments"][key][1] for key in ("id", "edge_a", "edge_b", "repeat_group", "role")}
    head = head | {"roles_sha256": roles_hash(zip(*s.values()))}
    listed, told, columns = {}, {}, {}
    with h5py.File(path, "w") as file:
        clock = file.create_group("clock")
        clock.attrs["f_xtal_nominal_Hz"], clock.attrs["ppm"] = 26e6, 0.0
        for name, (unit, edge0, attributes, values) in streams.items():
            dataset = file.create_dataset(f"streams/{name}", data=values.astype("<i4"))
            stated = attributes | {"unit": unit, "fs_num": 1, "fs_den": FRAME, "edge0": edge0}
            dataset.attrs.update(stated)
            listed[f"/streams/{name}"] = column_hash(values.astype("<i4"))
            told[name] = stated | {"rows": len(values), "dtype": "i4", "sha256": listed[f"/streams/{name}"]}
            scale = "streams/time_8k" + (f"_from_{edge0}" if edge0 else "")
            if scale not in file:
                edges = edge0 + FRAME * np.arange(len(values), dtype="<i8")
                file.create_dataset(scale, data=edges).make_scale("time")
                file[scale].attrs["unit"] = "edge"
                listed[f"/{scale}"] = column_hash(edges)
        for table, given in tables.items():
            for name, (unit, values) in given.items():
                text = unit == ""
                data = np.array(values, object if text else None)
                kind = h5py.string_dtype() if text else None
                dataset = file.create_dataset(f"{table}/{name}", data=data, dtype=kind)
                dataset.attrs["unit"] = unit
                listed[f"/{table}/{name}"] = column_hash(values if text else data)
                columns[f"{table}/{name}"] = {"unit": unit, "rows": len(values), "sha256": listed[f"/{table}/{name}"]}
        for key, values in (("path", list(listed)), ("sha256", list(listed.values()))):
            file.create_dataset(f"integrity/{key}", data=np.array(values, object), dtype=h5py.string_dtype())
        file.attrs["schema"], file.attrs["provenance"] = "gyrorec/1.0", "measured"
        file.attrs["config_toml"], file.attrs["versions"] = config_toml, "{}"
        file.attrs["attributes"] = json_text(head)
        file.attrs["content_sha256"] = content_hash(told, columns, config_toml, "measured", 0.0, head)
