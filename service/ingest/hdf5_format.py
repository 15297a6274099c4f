"""HDF5: groups of datasets at any depth, metadata as attributes or single values; needs the extra ``hdf5``.

A MATLAB 7.3 file is HDF5 behind a block of its own: texts are rows of uint16, structs are groups, cells references.
"""

import io
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest.hdf5_heaps import check_heaps, longest_text
from service.ingest.nested import MOST_TEXTS, NAMES_OF_ENTRIES, Leaf, Tree, by_name, leaf_of, matrix, tables_of
from service.ingest.raw import Limits, RawFile, check_size, plain
from service.ingest.time_words import is_time_name
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS

_DEEPEST = 20
_MOST_OBJECTS = 20_000
_BYTES = 8
_OF_LIBRARIES = (
    "MATLAB_",
    "H5PATH",
    "_Netcdf4",
    "_NC",
    "DIMENSION_LIST",
    "REFERENCE_LIST",
    "PYTABLES",
    "CLASS",
    "VERSION",
)
_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT", "unit_string")
_PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset")
_SAY_SOMETHING = frozenset((*_UNITS, *_PACKED, "MATLAB_class", "MATLAB_object_decode", "MATLAB_empty", "NAME"))
_OURS = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
_TABLES_OF_MATLAB = ("timetable", "table", "timeseries", "datetime", "duration", "categorical", "string")


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read an HDF5 record; shapes are looked at before anything is read.

    Raises
    ------
    UnknownType
        when h5py is not installed.
    Undecodable, TooLarge
        when it is no HDF5 file, points outside of itself, or is larger than the limits.
    """
    try:
        import h5py  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading HDF5 needs the extra: pip install 'casedrain[hdf5]'") from None
    check_heaps(content)
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            reader = _Reader(file, h5py, content, limits)
            tree = reader.group(file, "", 0)
            found = tables_of(tree, RawFile({}, (), reader.faults, reader.not_kept))
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        raise Undecodable("the body is not a readable HDF5 file", [Fault("body", str(error)[:200])]) from None
    return found


class _Reader:
    """Walks one file over its hard links, each object once, and adds up what it reads."""

    def __init__(self, file: Any, h5py: Any, content: bytes, limits: Limits) -> None:
        self._file, self._h5py, self._content, self._limits = file, h5py, content, limits
        self._visited: set[int] = set()
        self._objects = 0
        self._samples = 0
        self.faults: list[Fault] = []
        self.not_kept: dict[str, str] = {}

    def group(self, group: Any, path: str, depth: int) -> Tree:
        """A group with all that it holds."""
        tree: Tree = {}
        if not self._is_new(group, path, depth):
            return tree
        entries = self._array_of_structs(group, path, depth)
        if entries:
            return by_name(path.rpartition("/")[2], entries)
        for name in group:
            item = self._member(group, name)
            if item is None:
                self._left_out(name, "a link that leads outside the file or nowhere")
            elif not name.startswith("#"):
                held = self._item(item, name, f"{path}/{name}", depth)
                if held is not None:
                    tree[name] = held
        for name, value in self._attributes(group).items():
            tree.setdefault(name, Leaf(value))
        return tree

    def _array_of_structs(self, group: Any, path: str, depth: int) -> list[Tree]:
        """Entries of MATLAB's array of structs, whose fields are references each; empty for any other group."""
        if depth > _DEEPEST or not any(name in group for name in NAMES_OF_ENTRIES):
            return []
        fields = {name: self._member(group, name) for name in group}
        held = [f for f in fields.values() if isinstance(f, self._h5py.Dataset) and not (f.is_virtual or f.external)]
        sizes = {f.size for f in held if self._h5py.check_ref_dtype(f.dtype) is self._h5py.Reference}
        are_references = all(self._h5py.check_ref_dtype(f.dtype) is self._h5py.Reference for f in held)
        if len(held) != len(fields) or not are_references or len(sizes) != 1 or max(sizes) > _MOST_OBJECTS:
            return []
        entries: list[Tree] = [{} for _ in range(max(sizes))]
        for name, field in fields.items():
            for i, reference in enumerate(np.asarray(field[()]).reshape(-1)):
                item = (
                    self._item(self._file[reference], name, f"{path}({i + 1})/{name}", depth + 1) if reference else None
                )
                if item is not None:
                    entries[i][name] = item
        return entries

    def _item(self, item: Any, name: str, path: str, depth: int) -> "Leaf | Tree | None":
        if isinstance(item, self._h5py.Group):
            return self.group(item, path, depth + 1)
        if not isinstance(item, self._h5py.Dataset):
            return None
        self._count(path)
        if item.is_virtual or item.external:
            self._left_out(name, "kept outside the file")
            return None
        return self._dataset(item, path, depth)

    def _dataset(self, item: Any, path: str, depth: int) -> "Leaf | Tree":
        said = self._said(item)
        matlab = _word(said.get("MATLAB_class", b""))
        if matlab in _TABLES_OF_MATLAB or "MATLAB_object_decode" in said:
            return Leaf(None, what=opaque(matlab))
        if "MATLAB_empty" in said or item.shape is None:
            return Leaf(None, what="empty")
        if matlab == "char":
            return self._characters(item)
        if self._h5py.check_ref_dtype(item.dtype) is not None:
            return self._cells(item, path, depth)
        if item.dtype.names:
            return self._compound(item)
        if item.size > 1 and max(item.shape) != item.size:
            return Leaf(None, what=matrix(item.shape))
        names = self._h5py.check_enum_dtype(item.dtype)
        if names and item.dtype.kind != "b":
            return self._enumeration(item, names)
        if item.dtype.kind in "fiub":
            self._add(item.size)
            axis = self._axis(item) if self._has_scales(item) else None
            return leaf_of(_unpacked(np.asarray(item[()]), said), _unit(said), axis)
        if self._h5py.check_string_dtype(item.dtype) is not None:
            return leaf_of(item[()]) if self._is_short(item) else Leaf(None, what="text")
        return Leaf(None, what=f"of the type {item.dtype}"[:100])

    def _is_short(self, item: Any) -> bool:
        """Whether a dataset of texts is worth reading, and no entry says that it is longer than the file."""
        if item.size > MOST_TEXTS:
            return False
        offset = item.id.get_offset()
        if offset is None or self._h5py.check_string_dtype(item.dtype).length is not None:
            return True
        fits = offset + item.id.get_storage_size() <= len(self._content)
        return fits and longest_text(self._content, offset, item.size) <= len(self._content)

    def _characters(self, item: Any) -> Leaf:
        """MATLAB keeps a text as a column of its characters."""
        if item.size > MOST_TEXTS or max(item.shape, default=1) != item.size:
            return Leaf(None, what="text")
        return Leaf("".join(map(chr, np.asarray(item[()]).reshape(-1).astype(np.uint32))).strip())

    def _cells(self, item: Any, path: str, depth: int) -> "Leaf | Tree":
        """Entries of a cell or of a struct's field in an array of structs, by their place."""
        if item.size > _MOST_OBJECTS or depth > _DEEPEST:
            return Leaf(None, what="a cell array")
        tree: Tree = {}
        for i, reference in enumerate(np.asarray(item[()]).reshape(-1)):
            if not isinstance(reference, self._h5py.Reference) or not reference:
                continue
            name = f"{path.rpartition('/')[2]}({i + 1})"
            held = self._item(self._file[reference], name, f"{path}({i + 1})", depth + 1)
            if held is not None:
                tree[name] = held
        words = [leaf.value for leaf in tree.values() if isinstance(leaf, Leaf) and isinstance(leaf.value, str)]
        return Leaf(words) if words and len(words) == len(tree) else tree

    def _compound(self, item: Any) -> "Leaf | Tree":
        """A table of named columns (PyTables, pandas)."""
        if len(item.shape) != 1:
            return Leaf(None, what=matrix(item.shape))
        if not self._is_sound(item.id.get_type()):
            return Leaf(None, what="a table of a damaged type")
        readable = [name for name in item.dtype.names if not self._has_rows(item.dtype[name])]
        self._add(item.size * len(readable))
        rows = np.asarray(item.fields(readable)[()]) if readable else np.empty(0)
        tree: Tree = {name: Leaf(None, what="rows of any length") for name in item.dtype.names}
        for name in readable:
            tree[name] = leaf_of(rows[name]) if item.size > 1 else Leaf(None, what="a single row")
        for name, value in self._attributes(item).items():
            tree.setdefault(name, Leaf(value))
        return tree

    def _is_sound(self, kind: Any) -> bool:
        """Whether rows of any length within a type are of a kind that the library knows: it writes anywhere otherwise."""
        h5t = self._h5py.h5t
        if isinstance(kind, h5t.TypeCompoundID):
            return all(self._is_sound(kind.get_member_type(i)) for i in range(kind.get_nmembers()))
        if isinstance(kind, h5t.TypeArrayID):
            return self._is_sound(kind.get_super())
        if isinstance(kind, h5t.TypeVlenID):
            made = h5t.vlen_create(kind.get_super())
            return kind.encode() == made.encode() and self._is_sound(kind.get_super())
        return True

    def _has_rows(self, dtype: Any) -> bool:
        """Whether entries of a type are rows of a length of their own each, which are no samples; texts are none."""
        if dtype.subdtype is not None:
            return self._has_rows(dtype.subdtype[0])
        if dtype.names:
            return any(self._has_rows(dtype[name]) for name in dtype.names)
        return dtype.kind == "O" and self._h5py.check_string_dtype(dtype) is None

    def _enumeration(self, item: Any, names: dict[str, int]) -> Leaf:
        if item.size > MOST_TEXTS:
            return Leaf(None, what="an enumeration")
        words = {number: name for name, number in names.items()}
        return Leaf([words.get(int(number)) for number in np.asarray(item[()]).reshape(-1)])

    def _axis(self, item: Any) -> Leaf | None:
        """The dimension scale along the samples."""
        along = int(np.argmax(item.shape)) if item.shape else 0
        scales = item.dims[along].values() if along < len(item.dims) else []
        scale = next(iter(scales), None)
        if scale is None or scale == item or scale.is_virtual or scale.external or scale.size != item.size:
            return None
        if scale.dtype.kind not in "fiu":
            return None
        self._add(scale.size)
        said = self._said(scale)
        called = (_word(said.get("NAME", b"")), scale.name.rpartition("/")[2])
        unit = _unit(said) or ("s" if any(map(is_time_name, called)) else "")
        return leaf_of(_unpacked(np.asarray(scale[()]), said), unit)

    def _member(self, group: Any, name: str) -> Any:
        """What a name leads to inside the file; following other links would read whatever the sender names here."""
        link = group.get(name, getlink=True)
        if isinstance(link, self._h5py.HardLink):
            return group[name]
        if not isinstance(link, self._h5py.SoftLink):
            return None
        place = self._file if link.path.startswith("/") else group
        for part in link.path.strip("/").split("/"):
            inside = isinstance(place, self._h5py.Group) and part in place
            if not inside or not isinstance(place.get(part, getlink=True), self._h5py.HardLink):
                return None
            place = place[part]
        return place

    def _left_out(self, name: str, what: str) -> None:
        if name in _OURS:
            self.faults.append(Fault(f"channels.{name}", f"is {what}"))
        else:
            self.not_kept[name] = what

    def _attributes(self, item: Any) -> dict[str, Any]:
        found = {}
        for name in item.attrs:
            self._count(name)
            if not name.startswith(_OF_LIBRARIES):
                value = plain(self._attribute(item, name))
                if isinstance(value, (str, int, float)):
                    found[name] = value
        return found

    def _attribute(self, item: Any, name: str) -> Any:
        """Numbers and texts of an attribute, None for what is neither.

        Rows of any length are not asked for: where their type is damaged, the library writes over memory that is not its own.
        """
        h5t = self._h5py.h5t
        simple = (h5t.TypeIntegerID, h5t.TypeFloatID, h5t.TypeStringID, h5t.TypeEnumID)
        return item.attrs[name] if isinstance(item.attrs.get_id(name).get_type(), simple) else None

    def _said(self, item: Any) -> dict[str, Any]:
        """Attributes that say how a dataset is to be read."""
        found = ((name, self._attribute(item, name)) for name in item.attrs if name in _SAY_SOMETHING)
        return {name: value for name, value in found if value is not None}

    def _has_scales(self, item: Any) -> bool:
        """Whether a dataset says along which scales it lies, in the one type that says so."""
        h5t = self._h5py.h5t
        return "DIMENSION_LIST" in item.attrs and bool(
            item.attrs.get_id("DIMENSION_LIST").get_type().encode() == h5t.vlen_create(h5t.STD_REF_OBJ).encode()
        )

    def _is_new(self, group: Any, path: str, depth: int) -> bool:
        """Whether this group has not been seen under another name, which a circle of links would repeat for ever."""
        self._count(path)
        if depth > _DEEPEST:
            self.not_kept[path] = f"a group more than {_DEEPEST} deep"
            return False
        address = self._h5py.h5o.get_info(group.id).addr
        known = address in self._visited
        self._visited.add(address)
        return not known

    def _count(self, path: str) -> None:
        self._objects += 1
        if self._objects > _MOST_OBJECTS:
            fault = Fault(f"group {path.rpartition('/')[0] or '/'}", "is where the reader stopped")
            raise TooLarge(f"the file holds more than {_MOST_OBJECTS} objects: leave out what is not needed", [fault])

    def _add(self, samples: int) -> None:
        check_size(samples, 1, self._limits)
        self._samples += samples
        if self._samples * _BYTES > self._limits.inflated_bytes:
            check_size(1, self._samples, self._limits)


def opaque(matlab_class: str) -> str:
    """What an object of MATLAB's is that only MATLAB can read, and what to do about it."""
    name = matlab_class or "object"
    advice = {
        "timetable": "timetable2table and table2struct(…, 'ToScalar', true)",
        "table": "table2struct(…, 'ToScalar', true)",
    }
    return f"a MATLAB {name}, which only MATLAB can read: save it with {advice.get(name, 'struct(…)')}"


def _word(value: Any) -> str:
    return str(plain(value))


def _unit(attributes: Any) -> str:
    found = next((attributes[name] for name in _UNITS if name in attributes), "")
    return _word(found).strip()


def _unpacked(samples: Any, attributes: Any) -> Any:
    """Samples as netCDF packs them: fill values are missing ones, then a factor and an offset."""
    if not any(name in attributes for name in _PACKED):
        return samples
    values = samples.astype(np.float64)
    for name in ("_FillValue", "missing_value"):
        if name in attributes:
            values[samples == np.asarray(attributes[name]).reshape(-1)[0]] = np.nan
    for name, applied in (("scale_factor", np.multiply), ("add_offset", np.add)):
        if name in attributes:
            values = applied(values, float(np.asarray(attributes[name]).reshape(-1)[0]))
    return values
