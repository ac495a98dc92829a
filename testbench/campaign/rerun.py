"""One point of a store, run again alone and compared byte for byte.

Source  docs/campaigns.md
"""

import hashlib
from typing import NamedTuple

from testbench.campaign import collect, shard, work
from testbench.campaign.plan import engines
from testbench.campaign.plan.plan_points import parse_identity, state_path
from testbench.campaign.store import Store
from testbench.errors import ConfigError, FileError
from testbench.storage import inputs
from testbench.storage.files import write_bytes


class Rerun(NamedTuple):
    """Whether the bytes are the same, and which variables are not."""

    address: str
    identical: bool
    bytes: int
    differ: list


def find(store, prefix):
    """The one finished point whose address begins so."""
    matching_addresses = [address for address in store.addresses() if address.startswith(prefix.lower())]
    if len(matching_addresses) != 1:
        what = f"{len(matching_addresses)} points begin" if matching_addresses else "no finished point begins"
        raise ConfigError(f"{store.path}: {what} with {prefix!r}; results/*.csv list the addresses")
    return matching_addresses[0]


def rerun(path, prefix, out=None, engine_options=()):
    """`Rerun` of a point; FileError if the sources are others than those it was made by.

    out             takes the new file
    engine_options  texts as of `--engine`
    """
    extra_locations = engines.parse_options(engine_options)
    store = Store.open_folder(path)
    address = find(store, prefix)
    identity, before = collect.read_point(store, address)
    data = parse_identity(identity)
    engines.permit(data.engine, extra_locations, store.point_path(address))
    engine = engines.load(data.engine)
    code = engines.source_hash(engine)
    if code != data.code:
        raise FileError(
            f"{store.point_path(address)}: was computed by sources {data.code[:12]}, these are {code[:12]}; "
            "only the same sources give the same bytes"
        )
    state = state_path(data, store.path / "states")
    if state is not None and hashlib.sha256(inputs.read_bytes(state)).hexdigest() != state.stem:
        raise FileError(f"{state}: is damaged: its SHA-256 differs from its name; run the campaign again")
    rerun_bytes, _ = work.compute(identity, store.path / "states", engine)
    if out is not None:
        write_bytes(out, rerun_bytes)
    stored_bytes = store.point_path(address).read_bytes()
    _, after = shard.decode(rerun_bytes, "rerun")
    names = dict.fromkeys([*before, *after])
    differ = [name for name in names if not _is_identical_variable(before.get(name), after.get(name))]
    return Rerun(address, rerun_bytes == stored_bytes, len(rerun_bytes), differ)


def _is_identical_variable(a, b):
    if a is None or b is None or a.dims != b.dims or a.attrs.keys() != b.attrs.keys():
        return False
    if isinstance(a.data, str) or isinstance(b.data, str):
        return a.data == b.data
    return a.data.dtype == b.data.dtype and a.data.tobytes() == b.data.tobytes()
