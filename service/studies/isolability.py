"""An isolability study for the command line: options to bounds, bounds to a table, a picture and JSON."""

import json
import math
from dataclasses import dataclass, replace

from rich.table import Table

from detectors.isolability.bounds import Isolability, isolability
from detectors.isolability.picture import isolability_svg
from detectors.isolability.plan import Plan, PlanFaultsError, plan_faults, sensors_of
from detectors.isolability.table import case_sensor
from service.studies.isolability_document import isolability_document
from twin.pumps import PUMP_TYPES, circuit_parameters, pump_type
from twin.pumps.circuits import CIRCUITS

_GROUND_RUN_FLOWS_LPM = (10.0, 20.0)


@dataclass(frozen=True, slots=True)
class IsolabilityOptions:
    """What a call of the command asks for; accuracy in percent of full scale."""

    pump: str
    circuit: str
    flights: int
    baseline_flights: int
    windows: int
    temperatures_degc: tuple[float, float]
    full_scale_bar: float
    accuracy_percent: float
    zero: bool
    reservoir: bool
    burst: bool
    ground_run_every: int | None


@dataclass(frozen=True, slots=True)
class Study:
    """Bounds, and how they are shown."""

    found: Isolability
    title: str

    def svg(self) -> str:
        """Picture of every fault."""
        return isolability_svg(self.found, self.title)

    def json(self) -> str:
        """The document of the API."""
        return json.dumps(isolability_document(self.found), indent=1) + "\n"


def isolability_study(options: IsolabilityOptions) -> Study:
    """Bounds for the options.

    Raises
    ------
    PlanFaultsError
        naming every fault of them.
    """
    faults = [
        (where, f"{value!r} is not one of {', '.join(sorted(known))}")
        for where, value, known in (("pump", options.pump, PUMP_TYPES), ("circuit", options.circuit, CIRCUITS))
        if value not in known
    ]
    kind = pump_type(options.pump if options.pump in PUMP_TYPES else "h225")
    sensors = sensors_of(kind, reservoir=options.reservoir, zero_measured=options.zero)
    plan = Plan(
        sensors=replace(sensors, case=case_sensor(options.full_scale_bar, options.accuracy_percent / 100.0)),
        temperature_range_degc=options.temperatures_degc,
        baseline_flights=options.baseline_flights,
        flights=options.flights,
        windows_per_flight=options.windows,
        burst=options.burst,
    )
    if options.ground_run_every is not None:
        plan = replace(plan, ground_run_flows_lpm=_GROUND_RUN_FLOWS_LPM, ground_run_every=options.ground_run_every)
    faults += plan_faults(plan)
    if faults:
        raise PlanFaultsError(faults)
    return Study(isolability(plan, kind, circuit_parameters(options.circuit)), f"Isolability, {kind.title}")


def isolability_table(study: Study) -> Table:
    """One row per fault."""
    table = Table(title=study.title)
    for heading in ("fault", "detectable", "isolable", "unit", "worst rival", "not to be told from"):
        table.add_column(heading)
    for fault in study.found.faults:
        group = ", ".join(fault.ambiguity_group) or "–"
        sizes = [_words(v) for v in (fault.smallest_detectable, fault.smallest_isolable)]
        table.add_row(fault.name, *sizes, fault.unit, fault.rivals[0].name, group)
    return table


def _words(size: float) -> str:
    return f"{size:.3g}" if math.isfinite(size) else "never"
