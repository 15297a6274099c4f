"""What a recording is reduced to: pump-off zero, windows with their means, and what enters a pump's history.

Pressures are bar gauge; times within a record are s from its start.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum

from detectors.words.signature import Droop, Spectrum


class WindowKind(StrEnum):
    """What a stretch of a record shows."""

    PUMP_OFF = "pump_off"
    ZERO_FLOW = "zero_flow"
    CONSTANT_FLOW = "constant_flow"


@dataclass(frozen=True, slots=True)
class Mean:
    """Mean of a channel over a window with a standard error that respects autocorrelation."""

    mean: float
    standard_error: float


@dataclass(frozen=True, slots=True)
class Zero:
    """Offset of the case sensor against the reservoir on this flight [bar].

    ``measured`` is False where the record has no usable pump-off stretch: the offset is then 0 with the
    sensor's prior spread, an unknown that the history carries.
    """

    offset_bar: float
    standard_deviation_bar: float
    measured: bool


@dataclass(frozen=True, slots=True)
class Window:
    """One stretch of a record; ``reason`` says why it was rejected, None when accepted.

    ``means`` maps channel names to means over the stretch. They are as measured: no zero is taken out.
    ``scatter_bar`` is the one-sigma of the discharge pressure's samples, None where they cannot tell.
    ``bridged`` says how much of the stretch holds no samples and of which channels, None where none is lost.
    ``warming_k_per_min`` is how fast the fluid warms about it [K/min], None where that cannot be told.
    """

    kind: WindowKind
    start_s: float
    end_s: float
    accepted: bool
    reason: str | None
    means: Mapping[str, Mean]
    scatter_bar: float | None = None
    bridged: str | None = None
    warming_k_per_min: float | None = None


@dataclass(frozen=True, slots=True)
class Mark:
    """A stretch of a record [s] that an engineer has judged: ``good`` is a window as it stands, bad is no evidence."""

    start_s: float
    end_s: float
    good: bool


@dataclass(frozen=True, slots=True)
class Behaviour:
    """How one pressure channel behaved over a record: facts for the question whether it can be true.

    ``at_rest`` and ``running`` count different values while the pump stands and while it turns at speed, at most
    ``MOST_VALUES`` of them; ``samples`` counts samples at speed, ``at_full_scale`` is the share of them at the sensor's
    full scale.
    """

    at_rest: int
    running: int
    samples: int
    at_full_scale: float


MOST_VALUES = 8
"""Different values that are told apart: more than a converter that toggles ever shows."""


@dataclass(frozen=True, slots=True)
class Reduction:
    """All that the analysis keeps of one recording, in time order.

    ``explanation`` says in one sentence why a record without an accepted zero-flow window adds nothing;
    None when there is one. ``flags`` are quality remarks. ``spectrum`` is None where the record is too slow for one,
    ``droop`` where it holds no step of a known load. ``behaviours`` are those of both pressures, by channel; empty in
    reductions made before there were any.
    """

    zero: Zero
    windows: tuple[Window, ...]
    explanation: str | None
    flags: tuple[str, ...] = ()
    spectrum: Spectrum | None = None
    droop: Droop | None = None
    behaviours: Mapping[str, Behaviour] = field(default_factory=dict)

    @property
    def zero_flow(self) -> Window | None:
        """Last accepted zero-flow window: the one that a flight is judged by."""
        return next((w for w in reversed(self.windows) if w.accepted and w.kind is WindowKind.ZERO_FLOW), None)


@dataclass(frozen=True, slots=True)
class Residual:
    """Measured against twin at the matching condition; the zero is taken out of ``measured`` [bar]."""

    measured: float
    twin: float
    residual: float
    standard_deviation: float


@dataclass(frozen=True, slots=True)
class Observation:
    """One record of a pump as its history sees it: the reduced flight and where it stands in event time."""

    record_id: str
    at: datetime
    aircraft: str
    position: str
    flight_id: str
    reduction: Reduction
    flight_hours: float | None = None
    segment: str | None = None


@dataclass(frozen=True, slots=True)
class Maintenance:
    """Something done to the pump or around it: it frees what it names and nothing else.

    ``action`` is one of ``ACTIONS``. ``fluid`` is the product after ``fluid_changed`` and ``channel`` the sensor's after
    ``sensor_replaced``; None where nobody said.
    """

    at: datetime
    action: str
    fluid: str | None = None
    channel: str | None = None


ACTIONS: tuple[str, ...] = (
    "filter_changed",
    "drain_cleaned",
    "fluid_changed",
    "setting_adjusted",
    "sensor_replaced",
    "pump_overhauled",
)
"""What can be done, apart from exchanging the pump."""


@dataclass(frozen=True, slots=True)
class History:
    """Everything that a verdict is a function of, apart from versions; observations in any order.

    ``installed_at`` are the starts of explicit installations; a change of (aircraft, position) in event order
    starts one as well.
    """

    observations: tuple[Observation, ...]
    maintenance: tuple[Maintenance, ...] = ()
    installed_at: tuple[datetime, ...] = field(default_factory=tuple)
