"""HDF5 files of others: nothing outside of the file, only what this project writes, and no more than fits.

    open_hdf5(path)         h5py.File whose links, datasets and attributes are checked
    open_bytes(data, path)  the same of the contents of a file

Refused are soft, external and circular links, external storage, virtual datasets, filters other than FILTERS, more
than MOST_OBJECTS objects or MOST_DEPTH levels, and contents larger than `inputs.expansion` allows. A file that was
damaged since it was sealed is refused unread. One without a seal is first read in its own process (`sandboxed_read`).
Source  docs/inputs.md
"""

import io
import math
from pathlib import Path

import h5py

from testbench.errors import FileError
from testbench.storage import inputs, sandboxed_read
from testbench.storage.files import seal_holds
from testbench.storage.record import RecordError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}  # by their numbers in the HDF5 library
LAYOUTS = (h5py.h5d.COMPACT, h5py.h5d.CONTIGUOUS, h5py.h5d.CHUNKED)
MOST_OBJECTS = 10_000  # groups, datasets and attributes
MOST_DEPTH = 16
BLOCK_BYTES = 1 << 24  # of a dataset that is read in pieces


def is_hdf5(path):
    """True if the file begins as HDF5 does."""
    return inputs.head(path, len(SIGNATURE)) == SIGNATURE


def open_hdf5(path):
    """Checked `h5py.File`, to be closed by the caller; RecordError (R01, R15) if it is not to be read."""
    path = Path(path)
    with inputs.open_input(path):
        sealed = seal_holds(path)
    if sealed is False:
        raise RecordError(path, ["R15 / expected the file that was written, found damage"])
    if sealed is None and is_hdf5(path):
        try:
            sandboxed_read.read_in_subprocess("testbench.storage.hdf5_input", path, "HDF5 file")
        except FileError as problem:
            raise RecordError(path, [str(problem).removeprefix(f"{path}: ")]) from None
    return _open_checked_file(path, path, path.stat().st_size)


def open_bytes(data, path):
    """As `open_hdf5` for the contents of a file, whose seal the caller has checked."""
    return _open_checked_file(io.BytesIO(data), path, len(data))


def _open_checked_file(source, path, packed):
    try:
        file = h5py.File(source, "r")
    except OSError:
        raise RecordError(path, ["R01 / expected an HDF5 file, found something else"]) from None
    try:
        with inputs.explain_damage(path, "HDF5 file"):
            size = 0
            for _, more in _sizes(path, file, packed):
                size += more
                if size > inputs.most_expansion(packed):
                    raise _hdf5_error(path, f"{size} bytes unpacked (GYRO_INPUT_MB)")
    except BaseException:
        file.close()
        raise
    return file


def _hdf5_error(path, content_text):
    return RecordError(path, [f"R01 / expected a plain HDF5 file, found {content_text}"])


def _sizes(path, file, packed):
    """Yield (object, bytes that it unpacks to) of everything in the file, each checked first."""
    object_count, waiting = 0, [("", file)]
    while waiting:
        item_path, item = waiting.pop()
        object_count += 1 + len(item.attrs)
        if object_count > MOST_OBJECTS:
            raise _hdf5_error(path, f"more than {MOST_OBJECTS} groups, datasets and attributes")
        yield item, sum(_attribute_bytes(item, name) for name in item.attrs)
        if isinstance(item, h5py.Dataset):
            yield item, _dataset_bytes(path, item_path, item, packed)
        elif isinstance(item, h5py.Group):
            if item_path.count("/") >= MOST_DEPTH:
                raise _hdf5_error(path, f"{item_path} deeper than {MOST_DEPTH} levels")
            for name in item:
                if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                    raise _hdf5_error(path, f"{item_path}/{name}, a soft or external link")
                waiting.append((f"{item_path}/{name}", item[name]))


def _unpacked_bytes(shape, dtype):
    return math.prod(shape or ()) * dtype.itemsize


def _attribute_bytes(item, name):
    attribute = h5py.h5a.open(item.id, name.encode())
    return _unpacked_bytes(attribute.shape, attribute.dtype)


def _dataset_bytes(path, dataset_path, dataset, packed):
    """Bytes of a dataset, or of one chunk where that is more; RecordError if it is not of the kinds that are read."""
    creation_properties = dataset.id.get_create_plist()
    if creation_properties.get_layout() not in LAYOUTS or creation_properties.get_external_count():
        raise _hdf5_error(path, f"{dataset_path} outside of the file: external storage or a virtual dataset")
    for k in range(creation_properties.get_nfilters()):
        code = creation_properties.get_filter(k)[0]
        if code not in FILTERS:
            raise _hdf5_error(
                path, f"filter {code} of {dataset_path}, which is not one of {', '.join(FILTERS.values())}"
            )
    size = max(_unpacked_bytes(dataset.shape, dataset.dtype), _unpacked_bytes(dataset.chunks or (0,), dataset.dtype))
    if size <= inputs.most_expansion(packed) and dataset.ndim == 1 and h5py.check_string_dtype(dataset.dtype):
        # many elements may share one long text; each may be as long as the file
        for block in _row_blocks(dataset, max(64, BLOCK_BYTES // packed)):
            size += sum(map(len, block.tolist()))
            if size > inputs.most_expansion(packed):
                break
    return size


def _row_blocks(dataset, rows):
    for first in range(0, len(dataset), rows):
        yield dataset[first : first + rows]


def _read_all(path):
    """Read everything once: every attribute, and every dataset in pieces."""
    with _open_checked_file(path, path, path.stat().st_size) as file, inputs.explain_damage(path, "HDF5 file"):
        for item, _ in _sizes(path, file, path.stat().st_size):
            list(item.attrs.values())
            if isinstance(item, h5py.Dataset) and item.shape:
                for _ in _row_blocks(item, max(1, BLOCK_BYTES // max(1, _unpacked_bytes(item.shape[1:], item.dtype)))):
                    pass


if __name__ == "__main__":
    sandboxed_read.main(_read_all)
