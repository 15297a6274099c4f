"""HDF5: one group of equally long datasets, metadata as attributes of the group; needs the extra ``hdf5``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.raw import Limits, RawFile, Table, check_size, plain


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read an HDF5 record from the root or from its only group; shapes are looked at before anything is read.

    Raises
    ------
    UnknownType
        when h5py is not installed.
    Undecodable, TooLarge
        when it is no HDF5 file, holds several groups, or is larger than the limits.
    """
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading HDF5 needs the extra: pip install 'casedrain[hdf5]'") from None
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            return _read(file, h5py, limits)
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        raise Undecodable("the body is not a readable HDF5 file", [Fault("body", str(error)[:200])]) from None


def _read(file: Any, h5py: Any, limits: Limits) -> RawFile:
    _check_links(file, h5py)
    group, attributes = file, dict(file.attrs)
    groups = [item for item in file.values() if isinstance(item, h5py.Group)]
    if not any(isinstance(item, h5py.Dataset) for item in file.values()):
        if len(groups) != 1:
            fault = Fault("body", f"holds {len(groups)} groups and no channels at its root")
            raise Undecodable("an HDF5 record is one group of channels", [fault])
        group = groups[0]
        _check_links(group, h5py)
        attributes |= dict(group.attrs)
    n_channels = sum(isinstance(item, h5py.Dataset) for item in group.values())
    channels, faults = {}, []
    for name, item in group.items():
        if not isinstance(item, h5py.Dataset):
            continue
        if item.is_virtual or item.external:
            faults.append(Fault(f"channels.{name}", "keeps its samples outside the file"))
        elif item.ndim != 1 or item.dtype.kind not in "fiu":
            faults.append(Fault(f"channels.{name}", f"has shape {item.shape} of {item.dtype}, not one row of numbers"))
        else:
            check_size(item.shape[0], n_channels, limits)
            channels[name] = np.array(item[:], dtype=np.float64)
    metadata = {name: plain(value) for name, value in attributes.items()}
    return RawFile(metadata, (Table(channels),), faults)


def _check_links(group: Any, h5py: Any) -> None:
    # following a link would read whatever file of this machine the sender names
    outside = [name for name in group if isinstance(group.get(name, getlink=True), h5py.ExternalLink)]
    if outside:
        faults = [Fault(f"channels.{name}", "is a link to another file") for name in outside]
        raise Undecodable("an HDF5 record holds all of its data itself", faults)
