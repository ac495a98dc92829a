"""A measurement record from a file, checked: all of it or nothing.

    read      HDF5 file -> testbench.storage.record.Record (its own refusals)
    check     every rule of `checks`, and R16: the firmware replayed on the recorded codes
    load      the record with what it cannot be used for; refusals raise

Source    docs/measured.md
"""

from dataclasses import dataclass, field
from pathlib import Path

from testbench.measured.record import checks, schema
from testbench.measured.record.schema import BLOCKED, REFUSED, WARNED, Finding
from testbench.storage import record_read
from testbench.storage.record import Record, RecordError

OVERRIDE = "r16_override"  # attribute: why physics may be traced although the firmware is not the model's


@dataclass
class Loaded:
    """A record that was not refused, and what is to be said about it."""

    path: Path
    record: Record
    findings: list = field(default_factory=list)
    residual: object = None  # firmware residual, where it was asked for

    @property
    def warnings(self):
        """What is implausible, one line each."""
        return tuple(str(f) for f in self.findings if f.level == WARNED)

    @property
    def is_blocked(self):
        """True while tracing of physics waits for an override."""
        return any(f.level == BLOCKED for f in self.findings)


def load(path, replay=True, progress=None):
    """`Loaded`; RecordError if any finding is a refusal."""
    record = record_read.read_record(path)
    findings = checks.check(record)
    refused = [str(f) for f in findings if f.level == REFUSED]
    if refused:
        raise RecordError(path, refused)
    loaded = Loaded(Path(path), record, findings)
    if replay:
        from testbench.measured.record import firmware_residual

        loaded.residual = firmware_residual.residual(record, progress=progress)
        first = loaded.residual.first
        if first is not None:
            override = record.attrs.get(OVERRIDE, "")
            mistake = firmware_residual.explanation(record, loaded.residual)
            text = f"expected 0 LSB, found {first}"
            text += f"; 0 LSB with {mistake}" if mistake else ""
            text += f"; overridden: {override}" if override else ""
            level = schema.DOWNGRADED if override else BLOCKED
            loaded.findings.append(Finding("R16", f"/streams/{first.stream}", text, level))
    return loaded
