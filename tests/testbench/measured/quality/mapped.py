"""Siblings as tables of anybody, in other units, with the column map that says what they are."""

import numpy as np
import pyarrow
import pyarrow.parquet
from scipy.io import savemat

COLUMNS = {
    "ringdown": ("ring-down", {"time": ("time", "ms", 1e3), "power": ("power", "mW", None)}),
    "spectrum": ("spectrum", {"frequency": ("frequency", "kHz", 1e-3), "power": ("power", "dBW", None)}),
    "sweep": (
        "sweep",
        {"frequency": ("frequency", "MHz", 1e-6)}
        | {f"{s}_{p}": (f"{s} {c}", u, f) for s in ("s11", "s21") for p, c, u, f in
           (("db", "dB", "dB", 1.0), ("deg", "deg", "rad", np.pi / 180))},
    ),
    "meters": ("meters", {"time": ("time", "min", 1 / 60), "source": ("source", "mV", 1e3)}),
    "levels": ("levels", {"code": ("code", "1", 1.0)}),
    "driven": ("driven", {"input": ("input", "mV", 1e3), "output": ("output", "uV", 1e6)}),
    "rest": ("rest", {}),
}  # fmt: skip
SEVERAL = {"meters": ("readings", "mV", 1e3), "levels": ("levels", "kV", 1e-3), "rest": ("axes", "rad/s", np.pi / 180)}


def table(path, form, columns):
    """Write columns in one of the four forms."""
    if form == "csv":
        rows = zip(*(v.tolist() for v in columns.values()))
        path.write_text("\n".join([";".join(columns), *(";".join(map(repr, row)) for row in rows)]) + "\n")
    elif form == "parquet":
        pyarrow.parquet.write_table(pyarrow.table(columns), path)
    elif form == "npz":
        with open(path, "wb") as file:
            np.savez(file, **columns)
    else:
        savemat(path, columns)


def mapped(whole, form, folder):
    """Map and table of a sibling in other units."""
    kind, roles = COLUMNS[whole.kind]
    lines, columns = [f'kind = "{kind}"', 'file = "data"', "[columns]"], {}

    def converted(name, factor, unit):
        v = whole.columns[name]
        if factor is None:
            return 10 ** (v / 10) if unit == "mW" else v - 30.0
        return v * factor

    for k, (role, (name, unit, factor)) in enumerate(roles.items()):
        columns[f"c{k}"] = converted(name, factor, unit)
        lines.append(f'{role} = {{column = "c{k}", unit = "{unit}"}}')
    role, unit, factor = SEVERAL.get(whole.kind, ("", "", 1.0))
    scale = whole.head.get("lsb_deg_s", 1.0)
    for k, name in enumerate(whole.signals if role else ()):
        columns[f"d{k}"] = whole.columns[name] * scale * factor
        lines += [f"[[{role}]]", f'column = "d{k}"', f'unit = "{unit}"', f'name = "{name}"']
    if whole.kind == "meters":
        columns["room"] = whole.columns["temp"]
        lines += ["[[environment]]", 'column = "room"', 'name = "temp"']
    lines.append("[head]")
    lines += [f"rate_hz = {1e7 / 2**14!r}"] if whole.kind == "driven" else []
    lines += ["rate_hz = 100.0"] if whole.kind == "rest" else []
    if "Frequency [Hz]" in whole.head:
        lines.append(f"frequency_hz = {whole.head['Frequency [Hz]']}")
    table(folder / "data", form, columns)
    (folder / "map.toml").write_text("\n".join(lines) + "\n")
    return folder / "map.toml"
