"""Which case sensor is good enough: bounds on pump leakage over accuracy, with and without zero, reservoir and burst.

Two questions of the thesis that proposed the case sensor: can it detect pump degradation prior to failure (Q1), and can
pump degradation be told from that of the circuit by this one sensor (Q2)?
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from detectors.bank.hypotheses import pure_kinds
from detectors.isolability.bounds import Isolability, isolability
from detectors.isolability.plan import Plan, sensors_of
from detectors.words.verdict import Side, State
from twin.parameters import Circuit, PumpType, Sensor

ACCURACIES_FS = (0.001, 0.0025, 0.005, 0.01, 0.02)
PROPOSED_FULL_SCALE_BAR = 5.0
"""The thesis' proposal: 5 bar full scale and 1 % accuracy."""
REPEATABILITY_SHARE = 0.1
"""Repeatability over accuracy (estimate, as the pump type's own sensors have it)."""
EXAMPLE = "leakage, slippers"


@dataclass(frozen=True, slots=True)
class Row:
    """One sensor in one setting; sizes in L/min, infinite where no leakage inside the model would do.

    Attributes
    ----------
    detectable
        Slipper leakage that is detected.
    isolable
        Slipper leakage that is told from every fault of the circuit.
    isolable_any_law
        Pump leakage that is told from every fault of the circuit whatever law it follows: the worst of them.
    uneven_detectable, uneven_isolable
        The same for the leakage of one worn piston or slipper.
    system_isolable
        Leak of the circuit (orifice law) that is told from every fault of the pump.
    """

    full_scale_bar: float
    accuracy_fs: float
    zero_measured: bool
    reservoir_measured: bool
    burst: bool
    detectable: float
    isolable: float
    isolable_any_law: float
    uneven_detectable: float
    uneven_isolable: float
    system_isolable: float


def case_sensor(full_scale_bar: float, accuracy_fs: float) -> Sensor:
    """A case sensor off the data sheet."""
    return Sensor(full_scale_bar, accuracy_fs, REPEATABILITY_SHARE * accuracy_fs)


def sensor_table(
    pump: PumpType,
    circuit: Circuit,
    cases: Sequence[Sensor] | None = None,
    *,
    plan: Plan | None = None,
) -> list[Row]:
    """Bounds for every case sensor in every setting of zero, reservoir sensor and burst.

    Parameters
    ----------
    cases
        Case sensors; None: the proposed full scale in each of ``ACCURACIES_FS``.
    plan
        Temperatures and flights; None: the defaults.

    Raises
    ------
    PlanFaultsError
        naming every fault of the plan and the sensors.
    """
    cases = [case_sensor(PROPOSED_FULL_SCALE_BAR, a) for a in ACCURACIES_FS] if cases is None else cases
    base = plan or Plan(sensors_of(pump))
    rows = []
    for burst in (False, True):
        for reservoir in (True, False):
            for zero in (True, False):
                sensors = sensors_of(pump, reservoir=reservoir, zero_measured=zero)
                for case in cases:
                    asked = replace(base, sensors=replace(sensors, case=case), burst=burst)
                    rows.append(_row(isolability(asked, pump, circuit)))
    return rows


def _row(found: Isolability) -> Row:
    sensors = found.plan.sensors
    slippers, uneven = found.fault(EXAMPLE), found.fault("uneven wear")
    leaks = [k.name for k in pure_kinds() if k.state is State.PUMP_DEGRADATION]
    return Row(
        full_scale_bar=sensors.case.full_scale_bar,
        accuracy_fs=sensors.case.accuracy_fs,
        zero_measured=sensors.zero_measured,
        reservoir_measured=sensors.reservoir is not None,
        burst=found.plan.burst,
        detectable=slippers.smallest_detectable,
        isolable=slippers.isolable_from(Side.SYSTEM),
        isolable_any_law=max(found.fault(name).isolable_from(Side.SYSTEM) for name in leaks),
        uneven_detectable=uneven.smallest_detectable,
        uneven_isolable=uneven.isolable_from(Side.SYSTEM),
        system_isolable=found.fault("system leakage, orifice").isolable_from(Side.PUMP),
    )
