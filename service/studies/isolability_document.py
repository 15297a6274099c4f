"""What an isolability study found, as JSON."""

import math

from detectors.isolability.bounds import FaultBound, Isolability
from detectors.words.verdict import SIDE_OF
from service.answers import twin as answers


def isolability_document(found: Isolability) -> answers.IsolabilityStudy:
    """Bounds as JSON; null where no size inside the linear model would do."""
    plan = found.plan
    return {
        "flights": plan.flights,
        "baseline_flights": plan.baseline_flights,
        "temperature_range_degc": list(plan.temperature_range_degc),
        "windows_per_flight": plan.windows_per_flight,
        "ground_run_flows_lpm": list(plan.ground_run_flows_lpm),
        "ground_run_every": plan.ground_run_every,
        "burst": plan.burst,
        "false_alarm_probability": plan.false_alarm_probability,
        "detection_probability": plan.detection_probability,
        "case_pressure_range_bar": list(found.case_pressure_range_bar),
        "remarks": list(found.remarks),
        "faults": {fault.name: _fault(fault) for fault in found.faults},
    }


def _fault(fault: FaultBound) -> answers.FaultBounds:
    return {
        "state": fault.state.value,
        "side": SIDE_OF[fault.state].value,
        "unit": fault.unit,
        "smallest_detectable": _size(fault.smallest_detectable),
        "smallest_isolable": _size(fault.smallest_isolable),
        "largest_considered": fault.largest,
        "ambiguity_group": list(fault.ambiguity_group),
        "rivals": [
            {
                "name": r.name,
                "state": r.state.value,
                "smallest_isolable": _size(r.smallest_isolable),
                "cosine": r.cosine,
            }
            for r in fault.rivals
        ],
        "by_flights": {
            "smallest_detectable": [_size(float(v)) for v in fault.detectable_by_flights],
            "smallest_isolable": [_size(float(v)) for v in fault.isolable_by_flights],
        },
    }


def _size(value: float) -> float | None:
    return value if math.isfinite(value) else None
