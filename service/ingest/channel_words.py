"""What columns are called: words of the field in English, German, French and Spanish, and what they speak for."""

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


QUANTITIES: Mapping[str, frozenset[str]] = {
    "pressure": _set("p press pressure druck pression presion prs pr dp"),
    "temperature": _set("t temp temperature temperatur temperatura tmp"),
    "speed": _set("n nr n2 rpm speed drehzahl regime vitesse velocidad revs rev tacho omega giri np ng"),
    "flow": _set("q flow debit durchfluss volumenstrom caudal flowrate fluss"),
    "time": _set("time zeit temps tiempo t timestamp utc clock elapsed sec seconds uhrzeit heure hora tod"),
    "activity": _set("activity stick aktivitat activite actividad cyclic controls"),
}
_CASE = _set(
    "case casing gehause gehaeuse carter carcasa leck leckol leak leakage drain cd cdp fuite fuga drenaje housing c pc"
)
_RESERVOIR = _set(
    "reservoir res resv rsvr tank behalter behaelter bache deposito suction inlet boost r rsv "
    "return ret rucklauf retour retorno saug pr"
)
_DISCHARGE = _set(
    "discharge outlet delivery system sys supply hp high main out vorlauf hochdruck refoulement "
    "salida descarga pump pumpe pompe bomba line p1 systemdruck alta"
)
_FLUID = _set(
    "fluid oil oel ol huile aceite fluido medium hyd hydraulic hydraulik hydraulique reservoir tank inlet bache"
)
_COMMANDED = _set("commanded command demand soll sollwert set setpoint consigne")
_FOREIGN = _set(
    "oat tat egt itt engine eng gearbox mgb tgb ambient baro static ias tas ground gs altitude "
    "alt torque trq fuel cabin bus volt battery oilp pitot lat lon hdg heading vib motor gen"
)
_COMPOUNDS = {
    "druck": "druck", "temperatur": "temperatur", "drehzahl": "drehzahl", "gehause": "gehause", "leck": "leck", "tank": "tank",
    "pressure": "pressure", "press": "press", "speed": "speed", "flow": "flow", "temp": "temp", "case": "case", "drain": "drain",
    "zeit": "zeit", "time": "time", "behalter": "behalter", "pumpe": "pumpe", "system": "system", "reservoir": "reservoir",
    "discharge": "discharge", "oil": "oil", "oltemp": "oil", "oeltemp": "oil", "rpm": "rpm", "tiempo": "tiempo", "pression": "pression",
}  # fmt: skip
_SPEAKS: Mapping[str, tuple[str, frozenset[str], float]] = {
    "case_pressure_bar": ("pressure", _CASE, 0.0),
    "reservoir_pressure_bar": ("pressure", _RESERVOIR, 0.0),
    "discharge_pressure_bar": ("pressure", _DISCHARGE, 0.2),
    "case_flow_lpm": ("flow", _CASE, 0.0),
    "discharge_flow_lpm": ("flow", _DISCHARGE, 0.1),
    "commanded_flow_lpm": ("flow", _COMMANDED, 0.0),
    "shaft_speed_rpm": (
        "speed",
        _set("shaft rotor welle arbre eje pump pumpe nr n2"),
        0.35,
    ),
    "fluid_temperature_degc": ("temperature", _FLUID, 0.25),
    "time_s": ("time", frozenset(), 0.5),
    "flight_control_activity": ("activity", frozenset(["control", "flight", "stick"]), 0.3),
}
"""Quantity of each channel, words that tell it from its neighbours, and what the quantity alone is worth."""
_WORD = 0.3
_BRACKET = re.compile(r"[\[(<{]\s*([^\])>}]+?)\s*[\])>}]\s*$")
_METADATA: Mapping[str, frozenset[str]] = {
    "pump_serial": _set(
        "pump_serial pumpsn pump_sn sn serial serialno serial_no pumpserial seriennummer pump_id n_serie"
    ),
    "aircraft": _set(
        "aircraft tail tail_no tailno tailnumber tail_number registration reg ac a_c kennzeichen "
        "immatriculation matricula msn"
    ),
    "position": _set("position pos side location seite einbauort cote"),
    "flight_id": _set(
        "flight_id flight flt flightno flight_no flight_number flug vol vuelo sortie test run run_id testnumber mission"
    ),
    "started_at": _set(
        "started_at start start_time starttime begin beginn start_utc recorded_at date datetime debut inicio"
    ),
    "flight_hours": _set("flight_hours hours pump_hours tsn fh operating_hours betriebsstunden"),
    "ambient_pressure_bar": frozenset(("ambient_pressure_bar",)),
}


def plain(text: str) -> str:
    """Lower case without accents."""
    decomposed = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(c for c in decomposed if not unicodedata.combining(c)).casefold()


def words_of(name: str) -> frozenset[str]:
    """Words that a name is made of, split at marks, at capitals and at digits, compounds also by their parts."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", _BRACKET.sub("", name))
    parts = set(re.split(r"[^a-z0-9]+", plain(text))) - {""}
    for part in tuple(parts):
        parts |= {bare for bare in (re.sub(r"\d+$", "", part), re.sub(r"^\d+", "", part)) if bare}
        if part[0] in "pntq" and part[1:].rstrip("0123456789") in _KNOWN:  # PHYD1, NPUMP
            parts |= {part[0], part[1:].rstrip("0123456789")}
        parts |= {word for piece, word in _COMPOUNDS.items() if piece in part and len(part) > len(piece)}
    return frozenset(parts)


_KNOWN = _CASE | _RESERVOIR | _DISCHARGE | _FLUID | _set("hyd rotor shaft pump") - _set("p t n q")


def unit_in(name: str) -> str | None:
    """Unit that a name ends with in brackets: ``P1 [psi]``, ``T (degC)``; or after its last mark: ``speed_rpm``."""
    found = _BRACKET.search(name)
    if found:
        return found[1]
    last = re.split(r"[\s_.,/]+", name.strip())[-1]
    return last if last != name and last.lower() in _ENDINGS else None


_ENDINGS = _set("psi psia psig bar bara barg kpa mpa mbar hpa rpm hz degc degf lpm gpm ms sec")


@lru_cache(maxsize=4096)
def spoken_for(name: str, channel: str) -> float:
    """How much a column's name speaks for a channel of ours, 0 to 1."""
    if name == channel:
        return 1.0
    quantity, tells, alone = _SPEAKS[channel]
    words = words_of(name)
    of_quantity = words & QUANTITIES[quantity]
    telling = words & tells
    others = frozenset().union(*(s for c, (q, s, _) in _SPEAKS.items() if q == quantity and c != channel))
    others -= tells | QUANTITIES[quantity]
    score = 0.0
    if of_quantity and telling - of_quantity:
        score = 0.9
    elif of_quantity:
        # a word says more than a letter
        score = alone + (_WORD if quantity in ("speed", "time") and any(len(word) > 2 for word in of_quantity) else 0.0)
    elif telling and quantity == "pressure" and not any(words & other for other in QUANTITIES.values()):
        score = 0.5 if any(len(word) > 2 for word in telling) else 0.3
    score -= 0.3 * bool(words & others) + 0.4 * bool(words & _FOREIGN - tells)
    return max(0.0, score)


def metadata_of(name: str) -> str | None:
    """Metadata of a record that a foreign name stands for; None for any other."""
    key = re.sub(r"[^a-z0-9]+", "_", plain(name)).strip("_")
    return next((ours for ours, names in _METADATA.items() if key in names or key.replace("_", "") in names), None)
