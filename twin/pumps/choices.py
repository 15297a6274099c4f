"""Numbers of a parameter set that choose a law or a form, and the names under which a document may give them."""

from collections.abc import Mapping

from twin.laws.metering_edge import AMESIM, ATTAR, MARE, SMOOTH

CHOICES: Mapping[str, Mapping[str, int]] = {
    "compensator.edge_law": {"smooth": SMOOTH, "mare": MARE, "amesim": AMESIM, "attar": ATTAR},
    "slipper.variable": {"constant": 0, "variable": 1},
    "servo.rate_fed": {"vented": 0, "fed": 1},
    "servo.contact": {"carried": 0, "contact": 1},
}
"""By path: names and the codes that stand for them in the set. Metering edges (2-16 to 2-20, section 2.5.1.1.1); a slipper's gap
as given or from the forces (section 2.6.2); the rate piston's bore; servo pistons as one with the plate or on their own (2-14)."""


def code_of(path: str, value: object) -> int | None:
    """The code that a name or a code stands for; None where the path does not offer it."""
    names = CHOICES.get(path, {})
    if isinstance(value, str):
        return names.get(value)
    return next((code for code in names.values() if code == value and not isinstance(value, bool)), None)


def offered(path: str) -> str:
    """Names and codes of a path in words, as ``smooth (0), mare (1)``; empty where it is no choice."""
    return ", ".join(f"{name} ({code})" for name, code in CHOICES.get(path, {}).items())
