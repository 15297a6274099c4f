"""Words that exports print for units, and what each is in a channel's own unit; blanks, brackets and case are forgiven.

Case is not forgiven where it carries a meaning: mPa is no MPa.
"""

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

_LB = 0.45359237
_G = 9.80665
_INCH = 0.0254
_PSI = _LB * _G / _INCH**2 / 1e5
_US_GALLON = 3.785411784
_IMPERIAL_GALLON = 4.54609
_TURN_DEG = 360.0
_PI = 3.141592653589793

_PRESSURE: dict[float, str] = {
    1e-5: "Pa N/m2 pascal",
    1e-3: "hPa mbar millibar",
    1e-2: "kPa kN/m2 kilopascal",
    0.1: "dbar decibar",
    1.0: "bar bars daN/cm2",
    10.0: "MPa N/mm2 megapascal",
    _PSI: "psi lb/in2 lbf/in2 lbs/in2 lb/sqin lbf/sqin pounds/in2 poundspersquareinch",
    1000.0 * _PSI: "ksi kpsi",
    33.86389e-3: "inHg inchHg inchesHg",
    101325.0 / 760.0 / 1e5: "mmHg torr",
    _G * 1e-5: "mmH2O mmWC mmWS",
    _INCH * 1000.0 * _G * 1e-5: "inH2O inWC",
    _G / 10.0: "kg/cm2 kgf/cm2 kp/cm2 kg/sqcm kgf/sqcm at",
    1.01325: "atm",
}
_SPEED: dict[float, str] = {
    1.0: "rpm r/min rev/min revs/min revolutions/min revolution/minute turn/min turns/min 1/min min-1 /min U/min upm "
    "Umdr/min tr/min tours/min t/min giri/min g/min tpm об/мин vueltas/min rev.p.m",
    1000.0: "krpm rpmx1000 rpm*1000 x1000rpm",
    100.0: "rpmx100 rpm*100 x100rpm",
    60.0: "Hz hertz cps rps r/s rev/s revs/s 1/s s-1 /s U/s tr/s",
    60e3: "kHz",
    30.0 / _PI: "rad/s rads rad/sec radian/s radians/s rads-1",
    0.5 / _PI: "rad/min",
    60.0 / _TURN_DEG: "deg/s °/s deg/sec degrees/s degs-1",
}
_FLOW: dict[float, str] = {
    1.0: "L/min lpm l/mn ltr/min ltrs/min lit/min liter/min liters/min litre/min litres/min lmin-1 dm3/min sl/min",
    60.0: "L/s ltr/s liter/s litre/s ls-1 dm3/s",
    1.0 / 60.0: "L/h lph ltr/h litre/h liter/h",
    1e-3: "mL/min cc/min ccm cm3/min ccpm",
    0.06: "mL/s cc/s cm3/s ccps",
    1000.0 / 60.0: "m3/h cbm/h",
    1000.0: "m3/min",
    60e3: "m3/s",
    _US_GALLON: "gpm USgpm USG/min USgal/min gal/min gallon/min gallons/min galUS/min gpmUS",
    _IMPERIAL_GALLON: "Impgpm igpm impgal/min UKgpm UKgal/min galImp/min galUK/min gpmImp gpmUK",
    _US_GALLON / 60.0: "gph USgph gal/h gal/hr USgal/h",
    _INCH**3 * 1000.0 * 60.0: "in3/s cuin/s cis",
    _INCH**3 * 1000.0: "in3/min cuin/min cim",
}
_TIME: dict[float, str] = {
    1.0: "s sec secs second seconds sek sekunde sekunden seg segundos",
    1e-3: "ms msec msecs millisecond milliseconds",
    1e-6: "us usec microsecond microseconds",
    1e-9: "ns nsec nanosecond nanoseconds",
    60.0: "min mins minute minutes minuten minutos",
    3600.0: "h hr hrs hour hours std stunden heures",
    86400.0: "d day days tage",
}
_SHARE: dict[float, str] = {
    1.0: "1 - -- ratio fraction frac norm normalised normalized none dimensionless 0..1 0-1",
    0.01: "% percent pct percentage prozent pourcent 0..100 0-100",
    0.001: "permille",
}
_TEMPERATURE: dict[tuple[float, float], str] = {
    (1.0, 0.0): "degC C celsius °C oC *C degcelsius degreec degreescelsius gradc centigrade",
    (1.0, -273.15): "K kelvin degK °K",
    (5.0 / 9.0, -160.0 / 9.0): "degF F fahrenheit °F oF *F degfahrenheit degreef degreesfahrenheit gradf",
    (5.0 / 9.0, -273.15): "degR R rankine °R",
}
_MEANS_OTHERWISE = {
    "mPa": "MPa",
    "Mbar": "mbar",
    "MBar": "mbar",
    "Ms": "ms",
    "Msec": "ms",
    "ML/min": "mL/min",
    "Ml/min": "mL/min",
}
"""Words whose case makes them another unit, and the one that was probably meant."""
_REFERENCES: Mapping[str, str] = {
    "a": "absolute", "abs": "absolute", "absolute": "absolute", "absolut": "absolute", "absolu": "absolute",
    "g": "gauge", "ga": "gauge", "gage": "gauge", "gauge": "gauge", "rel": "gauge", "relative": "gauge", "relativ": "gauge",
    "ü": "gauge", "ue": "gauge", "überdruck": "gauge", "eff": "gauge",
}  # fmt: skip
_DIFFERENTIAL = ("d", "diff", "dif", "differential")


def _straight(table: Mapping[float, str]) -> dict[str, tuple[float, float]]:
    return {_key(word): (slope, 0.0) for slope, words in table.items() for word in words.split()}


def _key(word: str) -> str:
    """A word without what carries no meaning: blanks, brackets, case, signs of powers, dots at its end."""
    text = unicodedata.normalize("NFKC", word).replace("\u2212", "-").replace("\u00b5", "u").replace("\u03bc", "u")
    text = re.sub(r"[\s_\[\](){}<>^]", "", text).casefold().rstrip(".,;:")
    text = re.sub(r"^(degrees?|deg\.|grad|°)(?=[cfkr]$)", "deg", text)
    text = re.sub(r"/(minutes?|mins|mn)$", "/min", text)
    text = re.sub(r"/(seconds?|secs?)$", "/s", text)
    text = re.sub(r"/(hours?|hrs?|std)$", "/h", text)
    return text.replace("liters", "liter").replace("litres", "litre").replace("**", "")


@dataclass(frozen=True, slots=True)
class Word:
    """A unit by its word: ``ours = slope * foreign + intercept``; ``reference`` of a pressure where the word names one."""

    slope: float
    intercept: float
    reference: str | None = None


WORDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "bar": _straight(_PRESSURE),
    "rpm": _straight(_SPEED),
    "lpm": _straight(_FLOW),
    "s": _straight(_TIME),
    "degc": {_key(word): line for line, words in _TEMPERATURE.items() for word in words.split()},
    "": _straight(_SHARE),
}
"""Words by the suffix of the channels that they can be the unit of; channels without a unit under an empty one."""
_SHOWN: Mapping[str, tuple[str, ...]] = {
    "bar": tuple(w for words in _PRESSURE.values() for w in words.split()),
    "rpm": tuple(w for words in _SPEED.values() for w in words.split()),
    "lpm": tuple(w for words in _FLOW.values() for w in words.split()),
    "s": tuple(w for words in _TIME.values() for w in words.split()),
    "degc": tuple(w for words in _TEMPERATURE.values() for w in words.split()),
    "": tuple(w for words in _SHARE.values() for w in words.split()),
}
_EXAMPLES = {
    "bar": "bar, psi, kPa, MPa, psia, bar(g)",
    "rpm": "rpm, 1/min, Hz, rad/s",
    "lpm": "L/min, US gpm, m3/h, mL/min",
    "s": "s, ms, min, h",
    "degc": "degC, degF, K",
    "": "%, 1",
}


def suffix_of(channel: str) -> str:
    """The part of a channel's name that says its unit; empty for one without."""
    last = channel.rsplit("_", 1)[-1]
    return last if last in WORDS else ""


def word(unit: str, channel: str) -> Word | None:
    """What a word means for a channel; None where the table has it not.

    Raises
    ------
    ValueError
        for a word whose case makes it another unit than was probably meant, and for a differential pressure.
    """
    suffix = suffix_of(channel)
    for text in (unit, re.sub(r"\s*[\[(].*$", "", unit), re.sub(r"^.*[\[(]([^\])]+)[\])]\s*$", r"\1", unit)):
        found = _found(text, unit, suffix)
        if found is not None:
            return found
    return None


def _found(text: str, unit: str, suffix: str) -> Word | None:
    compact = re.sub(r"[\s\[\](){}]", "", text)
    key = _key(text)
    line = WORDS[suffix].get(key)
    reference = None
    if line is None and suffix == "bar":
        if key in ("atü", "atu", "ata"):
            line, reference = WORDS["bar"]["at"], "absolute" if key == "ata" else "gauge"
        for base in sorted(WORDS["bar"], key=len, reverse=True):
            rest = key[len(base) :].strip("-.,;:/") if line is None and key.startswith(base) else ""
            if rest in _DIFFERENTIAL:
                raise ValueError(
                    f"{unit!r} is a differential pressure: give the unit alone and say the pressure_reference"
                )
            if rest in _REFERENCES:
                line, reference, compact = WORDS["bar"][base], _REFERENCES[rest], compact[: len(base)]
                break
    if line is None:
        return None
    if compact in _MEANS_OTHERWISE:
        raise ValueError(
            f"{unit!r} is another unit than {_MEANS_OTHERWISE[compact]!r}, by its case: write which is meant"
        )
    return Word(line[0], line[1], reference)


def near(unit: str, channel: str) -> str:
    """Words that might be meant, as the end of a sentence."""
    suffix = suffix_of(channel)
    by_key = {_key(shown): shown for shown in reversed(_SHOWN[suffix])}
    close = [by_key[key] for key in get_close_matches(_key(unit), by_key, n=3, cutoff=0.6)]
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"a unit of it is {_EXAMPLES[suffix]} …"
