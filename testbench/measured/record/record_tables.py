"""A measurement record as tables for other programs: one Parquet file per rate, one CSV file per slow log.

    streams_NUM_DEN.parquet   columns of one rate, NUM / DEN edges from row to row
    TABLE.csv                 slow logs; the slash of stimulus/rate is a dot in the file's name

Nothing reads them back: the record is the HDF5 file.
Source    docs/measured.md
"""

import csv
import io

import numpy as np

from testbench.measured.formats.parquet_input import libraries
from testbench.storage.files import replace_folder


def write(path, record):
    """Write the tables of a `Record` into a folder, whole or not at all; an empty or missing one."""
    arrow, parquet = libraries()
    rates = {}
    for name, column in record.streams.items():
        data = np.ascontiguousarray(column.data, column.data.dtype.newbyteorder("="))  # Arrow takes no other
        rates.setdefault((column.num, column.den, len(data)), {})[name] = data
    files = {}
    for (num, den, rows), columns in rates.items():
        sink = io.BytesIO()
        parquet.write_table(arrow.table(columns), sink, compression="zstd")
        file = f"streams_{num}_{den}.parquet"
        files[file if file not in files else f"streams_{num}_{den}_{rows}.parquet"] = sink.getvalue()
    for name, table in record.tables.items():
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(table)
        # repr of a double gives the same double back
        lines.writerows(
            zip(*([repr(v) if isinstance(v, float) else v for v in c.data.tolist()] for c in table.values()))
        )
        files[f"{name.replace('/', '.')}.csv"] = text.getvalue().encode()
    with replace_folder(path) as new:
        for file, data in files.items():
            (new / file).write_bytes(data)
