"""Scales of TDMS channels: chains of steps from what a converter counted to what a sensor measured, as DAQmx writes them.

The reader's library takes the counts where it does not know a step, and gives up in the middle where a number is missing. What
cannot be followed is said here before, by channel.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

_TYPE = re.compile(r"NI_Scale\[(\d+)\]_Scale_Type")
_KNOWN = frozenset(
    {
        "Polynomial",
        "Linear",
        "RTD",
        "Strain",
        "Table",
        "Thermistor",
        "Thermocouple",
        "Add",
        "Subtract",
        "AdvancedAPI",
    }
)
"""Steps that npTDMS computes."""
_SOURCE = re.compile(r"NI_Scale\[(\d+)\]_\w+_(Input_Source|Left_Operand_Input_Source|Right_Operand_Input_Source)")
_UNITS = {"RTD": "degC"}
"""Units of what a step gives, where it is the last one and the file states none."""
_ICE_K = 273.15
_RAW = 0xFFFFFFFF
_MOST_STEPS = 100
Properties = Mapping[str, Any]


def scale_fault(levels: Sequence[Properties]) -> str | None:
    """Why a channel's scale cannot be followed; None where it can, or there is none.

    Parameters
    ----------
    levels
        Properties of the channel, of its group and of the file: the first of them that has a scale counts.
    """
    chain = _chain(levels)
    if chain is None:
        return None
    properties, n = chain
    if n > _MOST_STEPS:
        return f"has a scale of {n} steps: save it scaled"
    for step in range(n):
        kind = properties.get(f"NI_Scale[{step}]_Scale_Type")
        if kind is not None and kind not in _KNOWN:
            return f"is scaled by {str(kind)!r}, a step that is not read: save it scaled"
    sources: dict[int, list[int]] = {}
    for key, value in properties.items():
        found = _SOURCE.fullmatch(key)
        if found is None:
            continue
        if not isinstance(value, int) or not (0 <= value < n or value == _RAW):
            return f"has a scale whose step {found[1]} takes from step {value!r}, which is not there: save it scaled"
        sources.setdefault(int(found[1]), []).append(value)
    if _leads_back(n - 1, sources):
        return "has a scale whose steps lead back to themselves: save it scaled"
    return None


def scaled_unit(levels: Sequence[Properties]) -> str:
    """Unit that the last step of a scale gives by itself; empty where it does not say."""
    chain = _chain(levels)
    if chain is None:
        return ""
    properties, n = chain
    kind = properties.get(f"NI_Scale[{n - 1}]_Scale_Type")
    if kind == "Thermistor":  # Kelvin less an offset
        offset = properties.get(f"NI_Scale[{n - 1}]_Thermistor_Temperature_Offset")
        return {0.0: "K", _ICE_K: "degC"}.get(offset, "")  # type: ignore[arg-type]
    return _UNITS.get(str(kind), "")


def _chain(levels: Sequence[Properties]) -> tuple[Properties, int] | None:
    """Properties with the scale that counts, and its number of steps."""
    for properties in levels:
        n = properties.get("NI_Number_Of_Scales")
        if not isinstance(n, int):
            found = [int(match[1]) for match in map(_TYPE.fullmatch, properties) if match]
            n = max(found) + 1 if found else 0
        if n > 0 and properties.get("NI_Scaling_Status", "unscaled") != "scaled":
            return properties, n
    return None


def _leads_back(last: int, sources: Mapping[int, Sequence[int]]) -> bool:
    """Whether the way from the last step to what was counted comes by a step twice."""
    done: set[int] = set()

    def circles(step: int, way: frozenset[int]) -> bool:
        if step == _RAW or step in done:
            return False
        if step in way:
            return True
        if any(circles(source, way | {step}) for source in sources.get(step, ())):
            return True
        done.add(step)
        return False

    return circles(last, frozenset())
