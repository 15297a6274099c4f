"""How a fault ends in a bank: the healthy pump goes on from where its filter stands, or a filter goes on without it."""

import numpy as np

from detectors.bank.hypotheses import GONE
from detectors.bank.shapes import STEP, Filters
from detectors.expectation.components import AMPLITUDE, LAW, N_STATE, PLACE, RATE


def end_fault(filters: Filters, of: int, row: int, records: int) -> None:
    """Put into a row the filter of another one whose fault ended now."""
    for array in filters:
        array[row] = array[of]
    filters.kind[row], filters.shape[row], filters.onset[row] = GONE, STEP, records
    for place in (AMPLITUDE, RATE, LAW):
        filters.mean[row, place] = 0.0
        filters.covariance[row, place, :] = filters.covariance[row, :, place] = 0.0


def take_over(filters: Filters, row: int, moves: tuple[tuple[str, float], ...] = ()) -> None:
    """Let the healthy pump go on from where a filter stands: ``moves`` stay moved, the amplitude ends."""
    into = np.eye(N_STATE)
    for name, share in moves:
        into[PLACE[name], AMPLITUDE] = share
    into[AMPLITUDE] = into[RATE] = into[LAW] = 0.0
    filters.mean[0] = into @ filters.mean[row]
    filters.covariance[0] = into @ filters.covariance[row] @ into.T
    filters.log_evidence[0], filters.unexplained[0] = filters.log_evidence[row], filters.unexplained[row]
