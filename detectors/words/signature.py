"""What fast records and load steps are reduced to: lines at orders of the shaft, ripple, limit cycles, droop.

Pressures are bar, as measured: neither the sensor's filter nor its noise is taken out of an amplitude.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OrderLine:
    """Line of one pressure at a whole multiple of the shaft's speed.

    Attributes
    ----------
    order
        Multiple of the shaft's speed [-].
    amplitude_bar
        Amplitude [bar], root mean square over the pieces of the stretch. Near the floor it follows Rice's law: noise
        alone shows ``sqrt(pi / 2)`` standard errors.
    standard_error_bar
        One-sigma error of the amplitude from noise in the neighbouring bins [bar].
    phase_to_discharge_deg
        How far the line leads the same order of the discharge pressure [deg], in -180..180; None for the discharge
        pressure itself and where either line does not stand out.
    """

    order: int
    amplitude_bar: float
    standard_error_bar: float
    phase_to_discharge_deg: float | None


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """Strongest line below the shaft's own order.

    Attributes
    ----------
    frequency_hz, amplitude_bar
        Where it stands and how large it is.
    false_alarm_probability
        Chance that noise alone shows a line this far above its floor anywhere in the band [-].
    autocorrelation
        Autocorrelation of the band eight periods later [-]: 1 for an oscillation that keeps its beat.
    present
        True where it stands out and keeps its beat.
    """

    frequency_hz: float
    amplitude_bar: float
    false_alarm_probability: float
    autocorrelation: float
    present: bool


@dataclass(frozen=True, slots=True)
class ChannelSpectrum:
    """Spectrum of one pressure.

    Attributes
    ----------
    lines
        Orders 1, n - 1, n, n + 1 and 2 n.
    noise_bar
        One-sigma of what no order explains [bar].
    ripple_bar
        Root mean square below order 1 beyond the white floor [bar]: regulation at work.
    limit_cycle
        Strongest line below order 1; None where the stretch is too short to show one.
    resolution_bar
        Smallest difference between two samples [bar].
    dithered
        False where noise is below a third of the resolution, so that amplitudes below it cannot be trusted.
    regulation_hz
        Mean frequency of the ripple below order 1, geometric and weighed by power [Hz]; None where no ripple stands out.
    """

    lines: tuple[OrderLine, ...]
    noise_bar: float
    ripple_bar: float
    limit_cycle: LimitCycle | None
    resolution_bar: float
    dithered: bool
    regulation_hz: float | None = None

    def line(self, order: int) -> OrderLine:
        """Line of one of the orders.

        Raises
        ------
        KeyError
            when that order was not asked for.
        """
        for line in self.lines:
            if line.order == order:
                return line
        raise KeyError(f"no line of order {order}; there are {[line.order for line in self.lines]}")


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Spectra of both pressures over one stretch at constant load.

    Attributes
    ----------
    start_s, end_s
        Stretch [s].
    speed_rpm
        Mean speed by the porting line where it stands out, else by the speed channel [rpm].
    revolutions
        Revolutions that the lines were taken from.
    channels
        Channel name to its spectrum.
    """

    start_s: float
    end_s: float
    speed_rpm: float
    revolutions: float
    channels: Mapping[str, ChannelSpectrum]


@dataclass(frozen=True, slots=True)
class LoadStep:
    """One step of the load between two steady stretches, and how the regulated pressure took it.

    Attributes
    ----------
    at_s
        Instant of the step [s].
    flow_before_lpm, flow_change_lpm
        Discharge flow before the step and its change [L/min]; None where neither the flow nor its command is recorded.
    pressure_change_bar, pressure_error_bar
        Change of the steady discharge pressure and its one-sigma error [bar].
    droop_bar_per_lpm, droop_error_bar_per_lpm
        Fall of the steady pressure per flow and its one-sigma error; None without a flow.
    excursion_bar
        Largest deviation from the new steady pressure on the way [bar], with its sign.
    recovery_s, recovery_error_s
        Time from the step until the pressure stays within the band round its new value, and its one-sigma error [s].
    band_bar
        That band: a tenth of the excursion, and never below four times the noise [bar].
    """

    at_s: float
    flow_before_lpm: float | None
    flow_change_lpm: float | None
    pressure_change_bar: float
    pressure_error_bar: float
    droop_bar_per_lpm: float | None
    droop_error_bar_per_lpm: float | None
    excursion_bar: float
    recovery_s: float
    recovery_error_s: float
    band_bar: float


@dataclass(frozen=True, slots=True)
class Droop:
    """Fall of the steady discharge pressure from zero flow to ``flow_lpm``, and its one-sigma error [bar]."""

    flow_lpm: float
    fall_bar: float
    error_bar: float
