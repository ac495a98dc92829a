"""Which code made a file that is continued: hash of the sources that a run reaches, and versions of what runs them.

    {"code": SHA-256, "ftr-gyro": ..., "python": ..., "numpy": ..., "numba": ..., "h5py": ...}

Bits of two versions may differ, and a run of both is a run of neither. So what another one saved is continued only
where `scenario.across_versions` says so, which the record keeps with its configuration, and with this identity.
Source  docs/record.md
"""

import functools

from testbench.errors import FileError
from testbench.storage.record import versions
from testbench.storage.sources import code_sha256

RUN = "testbench.run.simulate"
PLANT = ("plant", "plant_file")  # SHA-256 of a foreign plant and of what it was handed, where there is one
MESSAGE_HASH_DIGITS = 12  # hex digits of a hash in a message


@functools.cache
def identity():
    """This process's identity; the machine is none of it: all processors give the same bits."""
    software_versions = {key: version for key, version in versions().items() if key != "machine"}
    return {"code": code_sha256(RUN), **software_versions}


def check(path, saved, mine, allowed):
    """FileError that names both, if `saved` is not `mine` ({}: a version that kept none) and not `allowed`.

    Another plant is never allowed. Returns the identity that was saved if it is another, else None.
    """
    if saved == mine:
        return None
    for key in PLANT:
        if saved.get(key) != mine.get(key):
            was, now = (str(one.get(key, "none"))[:MESSAGE_HASH_DIGITS] for one in (saved, mine))
            raise FileError(
                f"{path}: was saved with {key} {was}, this is {key} {now}: another plant cannot continue it"
            )
    if not allowed:
        raise FileError(
            f"{path}: was saved by {_text(saved, mine)}, this is {_text(mine, saved)}; "
            "--across-versions continues despite the difference"
        )
    return saved


def _text(one, other):
    """What of an identity is not the other's."""
    if not one:
        return "a version without identity"
    return ", ".join(
        f"{key} {str(one.get(key))[:MESSAGE_HASH_DIGITS]}" for key in (one | other) if one.get(key) != other.get(key)
    )
