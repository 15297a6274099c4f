"""Unit words as exports print them: the numbers stand here, by the definitions of the units."""

import pytest

from service.ingest.conversion import conversion

PSI = 0.0689475729316836
GPM = 3.785411784
# one of the foreign unit in ours, for words of a kind
TRUTH: dict[str, list[tuple[float, str]]] = {
    "case_pressure_bar": [
        (PSI, "psi PSI Psi lbf/in2 lb/in²"),
        (1.0, "bar Bar BAR"),
        (1e-5, "Pa PA N/m2 N/m²"),
        (1e-3, "mbar MBAR hPa hpa HPA"),
        (1e-2, "kPa KPA kpa"),
        (10.0, "MPa MPA mpa N/mm2"),
        (0.980665, "kg/cm2 kgf/cm² kg/cm^2 kp/cm2 at"),
        (1.01325, "atm"),
        (0.0338639, "inHg in_Hg INHG"),
        (0.001333224, "mmHg torr Torr"),
    ],
    "shaft_speed_rpm": [
        (1.0, "rpm RPM r/min rev/min U/min u/min 1/min min-1 min^-1 min⁻¹ min**-1 tr/min об/мин tpm"),
        (60.0, "Hz HZ 1/s s-1 rev/s rps"),
        (9.549296585513721, "rad/s RAD/S"),
        (1.0 / 6.0, "deg/s °/s"),
    ],
    "case_flow_lpm": [
        (1.0, "L/min l/min lpm LPM ltr/min litre/min dm3/min"),
        (GPM, "gpm GPM USgpm USGPM US_gpm gal/min"),
        (4.54609, "Imp_gpm ImpGPM igpm"),
        (1000.0 / 60.0, "m3/h m³/h"),
        (0.06, "cc/s mL/s cm³/s"),
        (0.001, "ml/min mL/min cc/min"),
    ],
    "time_s": [
        (1.0, "s sec S seconds"),
        (1e-3, "ms MS msec"),
        (1e-6, "us µs μs"),
        (60.0, "min MIN minutes"),
        (3600.0, "h hr hours H"),
    ],
    "flight_control_activity": [(0.01, "% percent PCT"), (1.0, "1 - fraction")],
}
CASES = [(channel, factor, word) for channel, rows in TRUTH.items() for factor, words in rows for word in words.split()]
TEMPERATURES = {  # two fixed points of each scale: water freezes and boils
    "degC °C ℃ C *C deg_C Deg_C celsius º_C": (0.0, 100.0),
    "degF °F ℉ F deg_F DEGF fahrenheit": (32.0, 212.0),
    "K kelvin": (273.15, 373.15),
}
REFERENCES = {
    "gauge": ["bar(g)", "barg", "bar g", "BARG", "psig", "PSI(G)", "kPag", "kPa (g)", "MPa gauge", "barü", "kg/cm2(g)"],
    "absolute": ["bar abs", "bara", "bar(a)", "psia", "PSIA", "psi(a)", "kPa(a)", "hPa abs.", "mbar absolute", "ata"],
}


@pytest.mark.parametrize("printed", ["{}", " {} ", "[{}]", "({})", "{} [measured]", "in [{}]"])
def test_words_of_exports_convert_by_the_definitions(printed: str) -> None:
    for channel, factor, word in CASES:
        found = conversion(printed.format(word.replace("_", " ")), channel)
        assert found.slope == pytest.approx(factor, rel=1e-6), word
        assert (found.intercept, found.reference) == (0.0, None), word


def test_scales_of_temperature_meet_at_their_fixed_points() -> None:
    for words, (freezes, boils) in TEMPERATURES.items():
        for word in words.split():
            found = conversion(word.replace("_", " "), "fluid_temperature_degc")
            assert found.slope * freezes + found.intercept == pytest.approx(0.0, abs=1e-9)
            assert found.slope * boils + found.intercept == pytest.approx(100.0)


@pytest.mark.parametrize(("reference", "word"), [(r, w) for r, words in REFERENCES.items() for w in words])
def test_a_word_says_the_reference(reference: str, word: str) -> None:
    assert conversion(word, "case_pressure_bar").reference == reference


def test_case_is_kept_where_it_means_something() -> None:
    for word, meant in {"mPa": "MPa", "mPa(a)": "MPa", "Mbar": "mbar"}.items():
        with pytest.raises(ValueError, match=meant):
            conversion(word, "case_pressure_bar")
    with pytest.raises(ValueError, match="ms"):
        conversion("Ms", "time_s")


def test_a_word_without_meaning_names_its_neighbours() -> None:
    with pytest.raises(ValueError, match="did you mean psi"):
        conversion("pis", "case_pressure_bar")
    with pytest.raises(ValueError, match="cannot become the unit of case_pressure_bar"):
        conversion("degC", "case_pressure_bar")
    with pytest.raises(ValueError, match="pressure_reference"):
        conversion("psid", "case_pressure_bar")
    with pytest.raises(ValueError, match="rpm"):
        conversion("%", "shaft_speed_rpm")


def test_any_unit_that_can_be_read_still_is() -> None:
    assert conversion("kilonewton / cm**2", "case_pressure_bar").slope == pytest.approx(100.0)
    assert conversion("1/hour", "shaft_speed_rpm").slope == pytest.approx(1.0 / 60.0)
