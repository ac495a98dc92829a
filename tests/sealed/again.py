"""Records of a published run made again, for a later version to trace: python -m tests.sealed.again RUN NUMBER [--wide]

    tests/sealed/published/RUN.json
        ledger          its line of the ledger
        configuration   of the board without deviations
        strata          tables of tests/sealed/strata.toml
        parameters      keys of `values`;   sheet_parameters  keys of `sheet`;   streams  what `streams_sha256` is over
        records         truth, its values (null: the default), middles of its data sheet (none: it has no such trace),
                        SHA-256 of its envelope and of its streams (null: unknown)
        sha256          of all of this

The file has each truth as it was drawn. So a record needs no bank and none of the sources that draw.
No number of the envelope is computed. Streams are whole numbers, so the hash is over all of their bits.
Source    docs/sealed.md
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

from testbench.config import Config, from_dict
from testbench.console.markdown import ROOT
from testbench.errors import ConfigError, FileError
from testbench.measured.record.schema import json_sha256
from testbench.storage.files import write_text
from testbench.storage.inputs import read_json
from testbench.storage.record import write_record
from tests.sealed import draw, strata
from tests.sealed.records import STREAMS, envelope_text, make_record, streams_sha256

FOLDER = Path(__file__).with_name("published")


def read_run(path):
    """Content of the file of a published run; FileError with one line if its hash is not that of its content."""
    run = read_json(path)
    if run.pop("sha256", None) != json_sha256(run):
        raise FileError(f"{path}: sha256 differs from that of the content; take the file from version control")
    return run


def read_truth(run, number):
    """Truth of a record of a published run, as its envelope has it."""
    row = run["records"][number]
    values = {key: value for key, value in zip(run["parameters"], row["values"]) if value is not None}
    return row["truth"] | {"values": values}


def make_again(run, number, folder, wide=False):
    """(text of the envelope, record) of a published run.

    wide  with the configuration of a data sheet and without priors
    ConfigError for a record that was not traced from a data sheet, or a board that does not lock.
    """
    sheet = run["records"][number]["sheet"]
    if wide and not sheet:
        raise ConfigError(f"{run['ledger']['run']}: record {number} was not traced from a data sheet; leave out --wide")
    tables = strata.Strata(**run["strata"], inside=(), outside=(), sha256=run["ledger"]["strata_sha256"])
    name, truth = f"{run['ledger']['run']}-{number:03d}", read_truth(run, number)
    values = dict(zip(run["sheet_parameters"], sheet)) if wide else None
    model = from_dict(run["configuration"], f"{run['ledger']['run']}: configuration")
    return envelope_text(truth), make_record(tables, name, truth, folder, values, model)


def compare_hashes(run, number, envelope, record):
    """{part: equal, differs, or unknown where the file has no hash} of the envelope and the streams of a record."""
    digests = {
        "envelope": hashlib.sha256(envelope.encode()).hexdigest(),
        "streams": streams_sha256(record, run["streams"]),
    }
    row = run["records"][number]
    return {
        part: {digest: "equal", None: "unknown"}.get(row[f"{part}_sha256"], "differs")
        for part, digest in digests.items()
    }


def write_run(run, path):
    """Write the file of a whole `records.Run` from its envelopes and results; FileError where one cannot be read."""
    numbers = range(len(run.kinds))
    truths, results = ([read_json(run.path(part, n)) for n in numbers] for part in ("envelopes", "results"))
    parameters = sorted({key for truth in truths for key in truth["values"]})
    sheets = [draw.sheet_values(run.strata, truth["seed"]) for truth in truths[: run.strata.wide["records"]]]
    rows = []
    for n, (truth, result) in enumerate(zip(truths, results)):
        rows.append(
            {
                "truth": {key: value for key, value in truth.items() if key != "values"},
                "values": [truth["values"].get(key) for key in parameters],
                "sheet": [*sheets[n].values()] if n < len(sheets) else [],
                "envelope_sha256": result["envelope_sha256"],
                "streams_sha256": result["streams_sha256"],
            }
        )
    data = {
        "ledger": run.own,
        "configuration": Config().model_dump(),
        "strata": {key: table for key, table in run.strata._asdict().items() if isinstance(table, dict)},
        "parameters": parameters,
        "sheet_parameters": [*sheets[0]],
        "streams": STREAMS,
        "records": rows,
    }
    text = json.dumps(data | {"sha256": json_sha256(data)}, separators=(",", ":"))
    write_text(path, text.replace('{"truth"', '\n{"truth"') + "\n")


def main(argv=None):
    """Exit code 0, or 1 where the record is not the published one."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("run", choices=sorted(path.stem for path in FOLDER.glob("*.json")))
    parser.add_argument("number", type=int)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "sealed" / "again")
    parser.add_argument("--wide", action="store_true", help="with the configuration of a data sheet and without priors")
    arguments = parser.parse_args(argv)
    try:
        run = read_run(FOLDER / f"{arguments.run}.json")
        if not 0 <= arguments.number < len(run["records"]):
            parser.error(f"number = {arguments.number} is outside 0 .. {len(run['records']) - 1}")
        arguments.out.mkdir(parents=True, exist_ok=True)
        envelope, record = make_again(run, arguments.number, arguments.out, arguments.wide)
        path = arguments.out / f"{arguments.run}-{arguments.number:03d}{'-wide' * arguments.wide}.h5"
        write_record(path, record)
        write_text(path.with_suffix(".json"), envelope)
    except (ConfigError, FileError) as problem:
        parser.exit(1, f"{problem}\n")
    parts = compare_hashes(run, arguments.number, envelope, record)
    print(f"{path}: beside the published record: " + ", ".join(f"{part} {result}" for part, result in parts.items()))
    return int("differs" in parts.values())


if __name__ == "__main__":
    sys.exit(main())
