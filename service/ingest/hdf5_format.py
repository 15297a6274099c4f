"""HDF5: one group of equally long datasets, metadata as attributes of the group; needs the extra ``hdf5``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest.raw import RawRecord

CONTENT_TYPES = ("application/x-hdf5",)
_MAGIC = b"\x89HDF\r\n\x1a\n"


def recognises(content: bytes) -> bool:
    """Whether the bytes begin like an HDF5 file."""
    return content.startswith(_MAGIC)


def parsed(content: bytes, max_rows: int) -> RawRecord:
    """Read an HDF5 record from the root or from its only group; shapes are looked at before anything is read.

    Raises
    ------
    UnknownType
        when h5py is not installed.
    Undecodable, TooLarge
        when it is no HDF5 file, holds several groups, or has more than ``max_rows`` samples a channel.
    """
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading HDF5 needs the extra: pip install 'casedrain[hdf5]'") from None
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            return _read(file, h5py, max_rows)
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        raise Undecodable("the body is not a readable HDF5 file", [Fault("body", str(error)[:200])]) from None


def _read(file: Any, h5py: Any, max_rows: int) -> RawRecord:
    group, attributes = file, dict(file.attrs)
    groups = [item for item in file.values() if isinstance(item, h5py.Group)]
    if not any(isinstance(item, h5py.Dataset) for item in file.values()):
        if len(groups) != 1:
            fault = Fault("body", f"holds {len(groups)} groups and no channels at its root")
            raise Undecodable("an HDF5 record is one group of channels", [fault])
        group = groups[0]
        attributes |= dict(group.attrs)
    channels, faults = {}, []
    for name, item in group.items():
        if not isinstance(item, h5py.Dataset):
            continue
        if item.ndim != 1 or item.dtype.kind not in "fiu":
            faults.append(Fault(f"channels.{name}", f"has shape {item.shape} of {item.dtype}, not one row of numbers"))
        elif item.shape[0] > max_rows:
            raise TooLarge(f"channel {name} has more than {max_rows} samples")
        else:
            channels[name] = np.array(item[:], dtype=np.float64)
    metadata = {name: _plain(value) for name, value in attributes.items()}
    return RawRecord(metadata, channels, faults)


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return value.item() if isinstance(value, np.generic) else value
