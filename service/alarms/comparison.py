"""Two lists of alarms of one pump side by side: which of them the other list does not have."""

from collections.abc import Sequence
from typing import Any

from service.alarms.life_cycle import Life


def gained_and_lost(before: Sequence[Life], after: Sequence[Life]) -> dict[str, list[dict[str, Any]]]:
    """Alarms that share no instant with any on the other side, in the shape of the API."""
    return {
        "gained": [_shown(a) for a in after if not _meets(a, before)],
        "lost": [_shown(a) for a in before if not _meets(a, after)],
    }


def _meets(alarm: Life, others: Sequence[Life]) -> bool:
    return any(alarm.overlaps(other.onset_at, other.cleared_at) for other in others)


def _shown(alarm: Life) -> dict[str, Any]:
    return {
        "onset_at": alarm.onset_at,
        "raised_at": alarm.raised_at,
        "cleared_at": alarm.cleared_at,
        "verdict_state": alarm.state,
        "priority": alarm.priority,
    }
