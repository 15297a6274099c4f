"""A pump's state as a small picture for other people's pages: mark, words and priority, readable without colour."""

from detectors.drawing.svg import document, text
from service.answers.pumps import Pump
from service.reports.words import MARKS, WORDS

WIDTH, HEIGHT = 300, 64
COLOURS = {
    "healthy": "#1d6b3a",
    "insufficient_data": "#4d5866",
    "pump_degradation": "#98181f",
    "compensator_fault": "#98181f",
    "system_leakage": "#8a4b00",
    "drain_restriction": "#8a4b00",
    "sensor_fault": "#5b3a94",
    "indeterminate": "#14507f",
}
_MOST_LETTERS = 24


def state_svg(pump: Pump, urgency: str) -> str:
    """The picture; ``urgency`` is the priority of the pump's open alarm, ``none`` without one."""
    colour = COLOURS.get(pump["state"], "#4d5866")
    name = pump["serial"] if len(pump["serial"]) <= _MOST_LETTERS else f"{pump['serial'][: _MOST_LETTERS - 1]}…"
    words, since = WORDS[pump["state"]], f" since {pump['since'][:10]}" if pump["since"] else ""
    told = f"Pump {pump['serial']}: {words}{since}"
    last = "no record yet" if pump["last_record_at"] is None else f"last record {pump['last_record_at'][:10]}"
    if urgency != "none":
        last = f"alarm: {urgency}, {last}"
    if pump["silent"]:
        last += ", silent"
    body = [
        f'<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{HEIGHT - 1}" rx="6" fill="none" stroke="{colour}"/>',
        f'<rect width="8" height="{HEIGHT}" rx="3" fill="{colour}"/>',
        text(20, 21, f"Pump {name}", extra='font-weight="bold"'),
        text(20, 39, f"{MARKS[pump['state']]} {words}{since}", colour=colour),
        text(20, 56, last, colour="#4d5866"),
    ]
    return document(WIDTH, HEIGHT, told, f"{told}; {last}.", body)
