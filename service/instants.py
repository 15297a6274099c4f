"""Instants of a request: they need a time zone."""

from datetime import datetime

from service.errors import Fault, Invalid


def check_instants(**instants: datetime | None) -> None:
    """Raise ``Invalid`` naming every query parameter that has no time zone."""
    faults = [
        Fault(f"query.{name}", "has no time zone: write Z for UTC")
        for name, instant in instants.items()
        if instant is not None and instant.tzinfo is None
    ]
    if faults:
        raise Invalid("an instant needs a time zone", faults)
