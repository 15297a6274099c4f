"""Reductions, residuals and verdicts as JSON and back."""

from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter
from pydantic_core import from_json

from detectors.words.observation import Reduction, Residual
from detectors.words.verdict import Estimate, Verdict
from service.answers import records as answers_of_records
from service.answers import verdicts as answers
from service.answers.records import StoredReduction

_REDUCTION = TypeAdapter(Reduction)
_RESIDUALS = TypeAdapter(dict[str, Residual])
_VERDICT = TypeAdapter(Verdict)
_TREND = TypeAdapter(dict[str, Estimate])


def _dumped(adapter: TypeAdapter[Any], value: Any) -> Any:
    # through text, so that NaN becomes null on both databases
    return from_json(adapter.dump_json(value))


def reduction_to_json(reduction: Reduction) -> StoredReduction:
    """Reduction as a JSON object."""
    document: StoredReduction = _dumped(_REDUCTION, reduction)
    return document


def reduction_from_json(document: Mapping[str, Any]) -> Reduction:
    """Inverse of ``reduction_to_json``."""
    return _REDUCTION.validate_python(document)


def residuals_to_json(residuals: Mapping[str, Residual]) -> dict[str, answers_of_records.Residual]:
    """Residuals by channel as a JSON object."""
    document: dict[str, answers_of_records.Residual] = _dumped(_RESIDUALS, dict(residuals))
    return document


def trend_to_json(trend: Mapping[str, Estimate]) -> dict[str, answers.Estimate]:
    """Trend points by metric as a JSON object."""
    document: dict[str, answers.Estimate] = _dumped(_TREND, dict(trend))
    return document


def verdict_to_json(
    verdict: Verdict, twin_version: str, threshold_version: int, software: answers.Software
) -> answers.Verdict:
    """Verdict in the shape of the API; ``software`` names what made it and is no part of two verdicts being equal."""
    document: answers.Verdict = _dumped(_VERDICT, verdict)
    return {
        **document,
        "twin_version": twin_version,
        "threshold_version": threshold_version,
        "software": software,
    }


def same_verdict(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """True where two verdicts in the shape of the API say the same, whichever software made them."""
    return {**one, "software": None} == {**other, "software": None}
