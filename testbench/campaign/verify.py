"""Whether a point is what its address says. Asked when a campaign starts, and by all that reads finished points.

    seal      the file's own SHA-256 behind its end: damage
    journal   the SHA-256 that was declared before the file was written: edited and sealed again
    identity  its SHA-256 is the address: swapped with another point, or of other sources

A file as the journal declares it needs no further look: 25 us for each point. The others (of an earlier version, or
whose line in the journal is lost) are decoded, 3 ms each. What is wrong is moved to rejected/ by `run`, and run again.
Source  docs/campaigns.md
"""

import hashlib

from testbench.campaign import shard
from testbench.campaign.plan.plan_points import point_address
from testbench.errors import FileError
from testbench.storage import inputs

MOST_BYTES = 1 << 32  # of a point, which may hold streams of hours


def read_point(store, address, written=None):
    """(identity, variables) of a finished point; FileError if it is damaged or another one.

    written  `Store.journal_hashes`; None: the journal is not asked
    """
    path = store.point_path(address)
    data, _ = _read_point_file(path, (written or {}).get(address))
    identity, variables = shard.decode(data, path)
    if point_address(identity) != address:
        raise FileError(f"{path}: holds another point: {point_address(identity)[:12]}")
    return identity, variables


def _read_point_file(path, declared):
    """(bytes, True if the journal declares them)."""
    data = inputs.read_bytes(path, MOST_BYTES)
    if declared and hashlib.sha256(data).hexdigest() not in declared:
        raise FileError(f"{path}: was changed: its SHA-256 differs from that in the journal")
    return data, bool(declared)


def faults(store, addresses, written):
    """{address: what is wrong} of the finished points among these."""
    out = {}
    for address in dict.fromkeys(addresses):
        if not store.has(address):
            continue
        try:
            _, declared = _read_point_file(store.point_path(address), written.get(address))
            if not declared:
                read_point(store, address)
        except FileError as problem:
            out[address] = str(problem)
    return out


def reject(store, addresses, written):
    """Move those that are wrong to rejected/; {address: what is wrong}."""
    out = {}
    for address in faults(store, addresses, written):
        with store.claim(address):  # a worker of a campaign that was killed may be at it
            point_faults = faults(store, [address], written)
            if point_faults:
                store.reject(address)
                out |= point_faults
    return out
