"""One point of a store, run again alone and compared byte for byte.

Source  docs/campaigns.md
"""

import hashlib
from typing import NamedTuple

from testbench.campaign import collect, shard, work
from testbench.campaign.plan import engines
from testbench.campaign.plan.points import parsed, state_of
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
    found = [address for address in store.addresses() if address.startswith(prefix.lower())]
    if len(found) != 1:
        what = f"{len(found)} points begin" if found else "no finished point begins"
        raise ConfigError(f"{store.path}: {what} with {prefix!r}; addresses stand in results/*.csv")
    return found[0]


def rerun(path, prefix, out=None, own_engines=()):
    """`Rerun` of a point; FileError if the sources are others than those it was made by.

    out          takes the new file
    own_engines  texts as of `--engine`
    """
    own = engines.parse_options(own_engines)
    store = Store.at(path)
    address = find(store, prefix)
    identity, before = collect.read_point(store, address)
    data = parsed(identity)
    engines.permit(data.engine, own, store.point(address))
    engine = engines.load(data.engine)
    code = engines.code_of(engine)
    if code != data.code:
        raise FileError(
            f"{store.point(address)}: was made by sources {data.code[:12]}, these are {code[:12]}: "
            "only the same sources give the same bytes"
        )
    state = state_of(data, store.path / "states")
    if state is not None and hashlib.sha256(inputs.read_bytes(state)).hexdigest() != state.stem:
        raise FileError(f"{state}: is damaged: its SHA-256 is not its name; run the campaign again")
    made, _ = work.compute(identity, store.path / "states", engine)
    if out is not None:
        write_bytes(out, made)
    kept = store.point(address).read_bytes()
    _, after = shard.decode(made, "rerun")
    names = dict.fromkeys([*before, *after])
    differ = [name for name in names if not _same(before.get(name), after.get(name))]
    return Rerun(address, made == kept, len(made), differ)


def _same(a, b):
    if a is None or b is None or a.dims != b.dims or a.attrs.keys() != b.attrs.keys():
        return False
    if isinstance(a.data, str) or isinstance(b.data, str):
        return a.data == b.data
    return a.data.dtype == b.data.dtype and a.data.tobytes() == b.data.tobytes()
