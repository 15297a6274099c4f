"""Rows of worlds that the judge was once over-sure of: shape x size x onset, sensors that lie, pumps that move.

Sizes reach from what is worth a word to ten times as much, onsets from the first flight on. The realities that these rows
are flown in differ from the judge as ``detectors.evaluation.reality`` lists.
"""

from detectors.evaluation.ground_runs import GroundRuns
from detectors.evaluation.rows import LEAKS, Growing, OnSomeFlights, Row, Stepping
from detectors.evaluation.sensing import Sensing
from detectors.words.verdict import State

_PUMP, _SYSTEM, _DRAIN, _SENSOR = (
    State.PUMP_DEGRADATION,
    State.SYSTEM_LEAKAGE,
    State.DRAIN_RESTRICTION,
    State.SENSOR_FAULT,
)
_BURST = Sensing(burst=True)
_RUNS = Sensing(ground_runs=GroundRuns(10))
STRANGE_ROWS: tuple[Row, ...] = (
    Row("drain x3 at once", _DRAIN, 85, Stepping(("drain",), 2.0, 45), "-"),
    Row("drain x3 at flight 5", _DRAIN, 50, Stepping(("drain",), 2.0, 5), "-"),
    Row("drain x10 at once", _DRAIN, 85, Stepping(("drain",), 9.0, 45), "-"),
    Row("drain growing to +100 %", _DRAIN, 150, Growing(("drain",), 1.0, 100, 30), "-"),
    Row("drain growing to +100 %, bursts", _DRAIN, 150, Growing(("drain",), 1.0, 100, 30), "-", _BURST),
    Row("drain growing to +100 %, ground runs", _DRAIN, 150, Growing(("drain",), 1.0, 100, 30), "-", _RUNS),
    Row("wear of 1 L/min in flights 1 to 9", _PUMP, 50, Growing(LEAKS, 1.0, 9, 1), "L/min"),
    Row("wear of 0.6 L/min in 10 flights", _PUMP, 90, Growing(LEAKS, 0.6, 10, 45), "L/min"),
    Row("wear of 0.6 L/min at once", _PUMP, 90, Stepping(LEAKS, 0.6, 45), "L/min"),
    Row("wear of 1.5 L/min at once", _PUMP, 90, Stepping(LEAKS, 1.5, 45), "L/min"),
    Row("wear of 1.5 L/min at once, bursts", _PUMP, 90, Stepping(LEAKS, 1.5, 45), "L/min", _BURST),
    Row("system leakage 3 L/min at once", _SYSTEM, 90, Stepping(("system",), 3.0, 45), "L/min"),
    Row("system leakage 3 L/min at once, bursts", _SYSTEM, 90, Stepping(("system",), 3.0, 45), "L/min", _BURST),
    Row("setting 3 bar at once", State.COMPENSATOR_FAULT, 90, Stepping(("setting",), -3.0, 45), "bar"),
    Row("wear of 0.6 L/min on half of the flights", _PUMP, 85, OnSomeFlights(("slippers", "port plate"), 0.6), "L/min"),
    Row("system leakage 3 L/min on half of the flights", _SYSTEM, 85, OnSomeFlights(("system",), 3.0), "L/min"),
    Row("drain +100 % on half of the flights", _DRAIN, 85, OnSomeFlights(("drain",), 1.0), "-"),
    Row("worn, then moved", _PUMP, 110, Growing(("slippers", "port plate"), 1.0, 40, 10), "L/min", moved_at=60),
    Row("case span -30 %", _SENSOR, 60, sensing=Sensing(case_span=0.7, step_at=30)),
    Row("case span -50 %", _SENSOR, 60, sensing=Sensing(case_span=0.5, step_at=30)),
    Row("case in another unit (a tenth)", _SENSOR, 60, sensing=Sensing(case_span=0.1, step_at=30)),
    Row("discharge span -30 %", _SENSOR, 60, sensing=Sensing(discharge_span=0.7, step_at=30)),
    Row("reservoir sensor absolute", _SENSOR, 60, sensing=Sensing(reservoir_added=1.013, step_at=30)),
)
