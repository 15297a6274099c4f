"""Metamodel of the gap between slippers and swashplate: design, runs of the transient pump, fit, error (sections 2.6.3, 3.4)."""

from twin.metamodel.fit import Fit, fit_map
from twin.metamodel.held import held_run
from twin.metamodel.places import places

__all__ = ["Fit", "fit_map", "held_run", "places"]
