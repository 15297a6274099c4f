"""All comparisons with published evidence, by the name that the command line knows."""

from collections.abc import Callable, Mapping

from twin.validation.evidence import Evidence
from twin.validation.slippers import slippers
from twin.validation.wear import wear

EVIDENCE: Mapping[str, Callable[[], Evidence]] = {"slippers": slippers, "wear": wear}
