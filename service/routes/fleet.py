"""The fleet at a glance."""

from collections import Counter
from typing import Any

from fastapi import APIRouter

from service import queries
from service.context import Asker, ContextOf
from service.registry.findings import judged_findings, rates
from service.routes.pumps import shown

router = APIRouter(prefix="/fleet", tags=["fleet"])
URGENCY: tuple[str, ...] = (
    "pump_degradation",
    "compensator_fault",
    "system_leakage",
    "drain_restriction",
    "indeterminate",
    "sensor_fault",
    "insufficient_data",
    "healthy",
)
"""States from the most to the least urgent, as the fleet page orders them (our choice)."""


def fleet(context: ContextOf, asker: Asker) -> list[dict[str, Any]]:
    """All pumps that this key may see, the most urgent first."""
    with context.database.reading() as session:
        pumps = shown(session, list(session.scalars(queries.pumps(asker))))
    return sorted(pumps, key=lambda p: (URGENCY.index(p["state"]), -p["confidence"], p["operator"], p["serial"]))


@router.get("/summary", summary="How the fleet is")
def summary(context: ContextOf, asker: Asker) -> dict[str, Any]:
    """Counts by state and side, pumps that want attention or have gone silent, and how often the workshop agreed."""
    pumps = fleet(context, asker)
    with context.database.reading() as session:
        judged = judged_findings(session, asker)
    quiet = ("healthy", "insufficient_data")
    return {
        "pumps": len(pumps),
        "records": sum(p["records"] for p in pumps),
        "by_state": dict(Counter(p["state"] for p in pumps)),
        "by_side": dict(Counter(p["side"] for p in pumps)),
        "attention": [p for p in pumps if p["state"] not in quiet],
        "silent": [p for p in pumps if p["silent"]],
        "findings": rates(judged),
    }
