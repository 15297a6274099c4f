"""Two lists of alarms of one pump side by side: which of them the other list does not have."""

from collections.abc import Sequence

from service.alarms.life_cycle import Life
from service.answers.alarms import AlarmChanges, AlarmOutline
from service.answers.words import instant


def gained_and_lost(before: Sequence[Life], after: Sequence[Life]) -> AlarmChanges:
    """Alarms that share no instant with any on the other side, in the shape of the API."""
    return {
        "gained": [_shown(a) for a in after if not _meets(a, before)],
        "lost": [_shown(a) for a in before if not _meets(a, after)],
    }


def _meets(alarm: Life, others: Sequence[Life]) -> bool:
    return any(alarm.overlaps(other.onset_at, other.cleared_at) for other in others)


def _shown(alarm: Life) -> AlarmOutline:
    return {
        "onset_at": instant(alarm.onset_at),
        "raised_at": instant(alarm.raised_at),
        "cleared_at": instant(alarm.cleared_at),
        "verdict_state": alarm.state,
        "priority": alarm.priority,
    }
