"""What the consumers of a circuit leak, beside the system leakage that a scenario asks for."""

from dataclasses import replace

from twin.simulation.scenario import Scenario, Schedule, Value

_LEAK = "system_leakage_lpm"


def leaking(scenario: Scenario, leak_lpm: float) -> Scenario:
    """The scenario with so much more system leakage [L/min at 175 bar], whether it is a constant or a schedule."""
    if leak_lpm == 0.0:
        return scenario
    health = scenario.health._replace(system_leakage_lpm=scenario.health.system_leakage_lpm + leak_lpm)
    changes: dict[str, Value] = dict(scenario.changes)
    given = changes.get(_LEAK)
    if isinstance(given, Schedule):
        changes[_LEAK] = replace(given, values=tuple(value + leak_lpm for value in given.values))
    elif given is not None:
        changes[_LEAK] = float(given) + leak_lpm
    return replace(scenario, health=health, changes=changes)
