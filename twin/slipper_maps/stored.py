"""Which metamodel belongs to a pump: found by a hash over the numbers that decide its slippers' gap, or none."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.parameters import Pump
from twin.parts.slipper_map import ANSWERS, AXES, N_AXES, N_FEATURES, SlipperMap, write_features
from twin.units import PA_PER_BAR

_HEX = 12
_FREE: Mapping[str, tuple[str, ...]] = {"piston": ("b", "e_rel"), "slipper": ("h",)}
"""Numbers that may differ: the pistons' rings leak beside the slippers, and a variable gap has no ``slipper.h``."""
_ARRAYS = ("nodes", "weights", "centre", "per_length", "mean", "low", "high")


@dataclass(frozen=True, slots=True)
class StoredMap:
    """A metamodel with what is known of it.

    Attributes
    ----------
    fitted_to
        ``gap_numbers_hash`` of the pump whose transient it was fitted to.
    made_by
        Hash of the sources whose runs it was fitted to, for information: numbers decide, not layout.
    errors
        Of runs held out, by ``ANSWERS`` and ``case_leakage_lpm``: ``rms``, ``p95``, ``largest``, in the answer's unit.
    reach
        Largest scaled distance of a run held out from its nearest node [-]: the errors hold as far as that.
    """

    model: SlipperMap
    fitted_to: str
    title: str
    made_by: str
    errors: Mapping[str, Mapping[str, float]]
    reach: float


def gap_numbers_hash(pump: Pump) -> str:
    """Hash over the numbers that decide how the slippers of a pump lift: pistons, slippers, ports, tilt, fluid.

    Returns
    -------
    str
        12 hexadecimal digits, the same on every machine.
    """
    digest = hashlib.sha256()
    for name in ("piston", "slipper", "port_plate", "fluid"):
        block = getattr(pump, name)
        left_out = (*_FREE.get(name, ()), *(("h", "shape") if name == "port_plate" else ()))
        for field, value in block._asdict().items():
            if field not in left_out:
                digest.update(f"{name}.{field}={value!r};".encode())
    digest.update(f"swashplate.alpha_max={pump.swashplate.alpha_max!r}".encode())
    return digest.hexdigest()[:_HEX]


def map_from(document: Mapping[str, Any]) -> StoredMap:
    """A metamodel from its document.

    Raises
    ------
    ValueError
        naming what is missing or has the wrong shape.
    """
    faults = [f"{name} is missing" for name in (*_ARRAYS, "fitted_to") if name not in document]
    if list(document.get("axes", AXES)) != list(AXES) or list(document.get("answers", ANSWERS)) != list(ANSWERS):
        faults.append("its axes or answers are those of another release: fit it again")
    if faults:
        raise ValueError("no metamodel of a slipper gap: " + "; ".join(faults))
    arrays: dict[str, NDArray[np.float64]] = {
        name: np.ascontiguousarray(np.array(document[name], dtype=np.float64)) for name in _ARRAYS
    }
    m = len(arrays["nodes"])
    shapes = {"nodes": (m, N_FEATURES), "weights": (m, len(ANSWERS)), "mean": (len(ANSWERS),)}
    shapes |= {"centre": (N_FEATURES,), "per_length": (N_FEATURES,), "low": (N_AXES,), "high": (N_AXES,)}
    faults = [f"{n} must have shape {s}; got {arrays[n].shape}" for n, s in shapes.items() if arrays[n].shape != s]
    faults += [f"{n} holds what is no number" for n in _ARRAYS if not np.isfinite(arrays[n]).all()]
    if faults:
        raise ValueError("no metamodel of a slipper gap: " + "; ".join(faults))
    return StoredMap(
        SlipperMap(**arrays),
        str(document["fitted_to"]),
        str(document.get("title", "")),
        str(document.get("made_by", "")),
        document.get("errors", {}),
        float(document.get("reach", 0.0)),
    )


def document_of(stored: StoredMap) -> dict[str, Any]:
    """A metamodel as the document that ``map_from`` reads, numbers to nine digits."""
    document: dict[str, Any] = {
        "title": stored.title,
        "fitted_to": stored.fitted_to,
        "made_by": stored.made_by,
        "reach": stored.reach,
        "axes": list(AXES),
        "answers": list(ANSWERS),
        "errors": {name: dict(found) for name, found in stored.errors.items()},
    }
    for name in _ARRAYS:
        document[name] = _digits(getattr(stored.model, name).tolist())
    return document


def _digits(values: Any) -> Any:
    return [_digits(v) for v in values] if isinstance(values, list) else float(f"{values:.9g}")


_registered: dict[str, StoredMap] = {}


def register(stored: StoredMap) -> None:
    """Make a metamodel known to this process, beside those that come with the twin."""
    _registered[stored.fitted_to] = stored
    stored_map.cache_clear()


def is_inside(pump: Pump, stored: StoredMap, axes: NDArray[np.float64], ambient_bar: float) -> bool:
    """Whether a point of ``AXES`` (N_AXES,) at an ambient pressure lies where the errors hold."""
    model = stored.model
    if not ((axes >= model.low - 1.0e-9) & (axes <= model.high + 1.0e-9)).all():
        return False
    x = np.empty(N_FEATURES)
    write_features(pump, np.ascontiguousarray(axes), ambient_bar * PA_PER_BAR, x)
    scaled = (x - model.centre) * model.per_length
    return bool(np.sqrt(((model.nodes - scaled) ** 2).sum(axis=1).min()) <= stored.reach)


@lru_cache(maxsize=256)
def stored_map(pump: Pump) -> StoredMap | None:
    """Metamodel of a pump whose slipper gap is variable; None for a constant gap, and where none was fitted to it."""
    if pump.slipper.variable < 0.5:
        return None
    wanted = gap_numbers_hash(pump)
    if wanted in _registered:
        return _registered[wanted]
    source = files("twin.slipper_maps") / f"{wanted}.json"
    return map_from(json.loads(source.read_text(encoding="utf-8"))) if source.is_file() else None
