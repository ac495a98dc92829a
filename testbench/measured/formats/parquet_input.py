"""Parquet files of others: plain columns of numbers, their sizes known before anything is unpacked.

    read_parquet(data, source_name, selected_names)   {name: array} of the bytes of a file; None: all columns

Other columns (texts, lists, structures) are left alone.
Errors  FileError: damaged, larger unpacked than `inputs.expansion` allows, more rows than its head states, no pyarrow
Source  docs/inputs.md
"""

import io

import numpy as np

from testbench.errors import FileError
from testbench.storage import inputs

WIDTHS = {"BOOLEAN": 1, "INT32": 4, "INT64": 8, "FLOAT": 4, "DOUBLE": 8}  # bytes of Parquet's plain types
BATCH_ROWS = 1 << 16


def libraries():
    """(pyarrow, pyarrow.parquet); FileError where they are not installed."""
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise FileError("Parquet needs the package pyarrow: run pip install '.[campaign]' in the clone") from None
    return pyarrow, parquet


def read_parquet(data, source_name, selected_names=None):
    """{name: array} of a Parquet file's plain columns of numbers, read in pieces; nothing larger than is allowed."""
    _, parquet = libraries()
    with inputs.explain_damage(source_name, "Parquet file"), parquet.ParquetFile(io.BytesIO(data)) as file:
        rows, schema = file.metadata.num_rows, file.schema
        plain = {
            schema.column(k).path: WIDTHS[schema.column(k).physical_type]
            for k in range(len(schema))
            if schema.column(k).physical_type in WIDTHS and not schema.column(k).max_repetition_level
        }
        names = [name for name in (plain if selected_names is None else selected_names) if name in plain]
        inputs.expansion(source_name, rows * sum(plain[name] for name in names), len(data))
        column_pieces = {name: [] for name in names}
        remaining_rows = rows
        for batch in file.iter_batches(BATCH_ROWS, columns=names) if names else ():
            remaining_rows -= len(batch)
            if remaining_rows < 0:
                raise FileError(f"{source_name}: more rows than the {rows} that its header states")
            for name in names:
                column_pieces[name].append(batch.column(name).to_numpy(zero_copy_only=False))
        return {name: np.concatenate(parts) for name, parts in column_pieces.items() if parts}
