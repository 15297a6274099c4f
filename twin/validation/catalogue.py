"""All comparisons with published evidence, by the name that the command line knows."""

from collections.abc import Callable, Mapping

from twin.validation.acceptance import acceptance
from twin.validation.bench import bench
from twin.validation.compensator import compensator
from twin.validation.erosion import erosion
from twin.validation.evidence import Evidence
from twin.validation.frequency import frequency
from twin.validation.jamming import jamming
from twin.validation.slippers import slippers
from twin.validation.spectrum import spectrum
from twin.validation.static_point import static_point
from twin.validation.static_points import chapter_3
from twin.validation.wear import wear

EVIDENCE: Mapping[str, Callable[[], Evidence]] = {
    "acceptance": acceptance,
    "static-point": static_point,
    "bench": bench,
    "chapter-3": chapter_3,
    "frequency": frequency,
    "compensator": compensator,
    "erosion": erosion,
    "jamming": jamming,
    "slippers": slippers,
    "wear": wear,
    "spectrum": spectrum,
}
