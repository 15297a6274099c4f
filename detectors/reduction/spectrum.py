"""Spectrum of a fast record: orders of the shaft, regulation ripple and limit cycles of both pressures.

Order tracking is a least-squares fit on the shaft's angle, which is the integral of the speed channel. Nothing is
resampled: gaps and missing samples cost no more than their number, and no interpolation damps the high orders. A
speed sensor's error of 2 rpm would smear order 18 within two seconds, so the angle is first scaled until the porting
line is sharpest. There is no mark on the shaft: phases are known between the two pressures only.
"""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.reduction.statistics import without_spikes
from detectors.words.numbers import MOST_MISSING
from detectors.words.signature import ChannelSpectrum, LimitCycle, OrderLine, Spectrum
from twin.parameters import PumpType
from twin.recording import Recording

Samples = NDArray[np.float64]
Complex = NDArray[np.complex128]

PRESSURES: tuple[str, ...] = ("discharge_pressure_bar", "case_pressure_bar")
SAMPLES_PER_HIGHEST_PERIOD = 2.2
"""Samples that a period of order 2 n needs at least."""
LEAST_REVOLUTIONS = 40
_PIECE_REVOLUTIONS = 160
_MOST_PIECES = 16
_SPEED_SEARCH = 0.004
"""How far the speed channel may be off [-]."""
_STANDS_OUT = 4.0
"""Standard errors above which a line has a phase, and may correct the speed."""
_BAND = (0.04, 0.85)
"""Band of regulation in orders of the shaft: 3 to 65 Hz on the H225, clear of drift and of order 1."""
_FLOOR_UNTIL = 6.0
"""Order up to which the white floor is taken: the fit has left no lines there."""
_FALSE_ALARM = 1.0e-4
"""Probability that noise alone makes the band's largest line as large (estimate: one burst in ten thousand)."""
_RIPPLE_STANDS_OUT = 10.0
"""Errors of the band's sum that its ripple must stand out by to have a frequency (estimate)."""
_BEAT_KEPT, _BEAT_PERIODS = 0.3, 8
"""Correlation that a limit cycle keeps over so many periods (estimate: noise of a damped loop has lost it by then)."""
_DITHER = 1.0 / 3.0
"""Noise in steps of the resolution from which digitising adds no lines (dither: of the step's bias a third of a step leaves
``exp(-2 pi^2 / 9)``, a tenth)."""


def spectrum(recording: Recording, start_s: float, end_s: float, pump: PumpType) -> Spectrum | None:
    """Spectrum of both pressures in ``start_s <= time < end_s``, a stretch at constant load.

    Parameters
    ----------
    recording
        As measured; missing samples are NaN, time may have gaps.
    pump
        Its number of pistons says which orders to look at.

    Returns
    -------
    Spectrum or None
        None where the stretch cannot show order 2 n: sampled below 2.2 times its frequency, shorter than 40
        revolutions, the shaft at rest, or more than a fifth of a pressure or of the speed missing.
    """
    part = recording.between(start_s, end_s)
    n = int(pump.pump.piston.n)
    if len(part) < 2:
        return None
    speed = without_spikes(part["shaft_speed_rpm"])
    if not _usable(part, speed, n):
        return None
    angle = _shaft_angle(part.time_s, speed)
    pieces = _pieces(angle)
    fits: dict[str, list[_Fit]] = {name: [] for name in PRESSURES}
    turned: list[float] = []
    for piece in pieces:
        theta = angle[piece] - angle[piece.start]
        scale = _sharpest(theta, without_spikes(part[PRESSURES[0]][piece]), n)
        turned.append(scale)
        for name in PRESSURES:
            fits[name].append(_Fit(theta * scale, part[name][piece], n))
    lines_d = [fit.lines for fit in fits[PRESSURES[0]]]
    floors_d = [fit.floors for fit in fits[PRESSURES[0]]]
    rate = 1.0 / float(np.median(np.diff(part.time_s)))
    shaft_hz = float(angle[-1] - angle[0]) / (2.0 * math.pi * float(part.time_s[-1] - part.time_s[0]))
    channels = {
        name: _channel(part[name], fits[name], None if name == PRESSURES[0] else (lines_d, floors_d), rate, shaft_hz)
        for name in PRESSURES
    }
    return Spectrum(
        float(part.time_s[0]),
        float(part.time_s[-1]),
        60.0 * shaft_hz * float(np.mean(turned)),
        sum(float(angle[piece.stop - 1] - angle[piece.start]) for piece in pieces) / (2.0 * math.pi),
        channels,
    )


def orders_of(n: int) -> tuple[int, ...]:
    """Orders that a pump with n pistons is looked at: 1, n - 1, n, n + 1, 2 n."""
    return (1, n - 1, n, n + 1, 2 * n)


def _usable(part: Recording, speed: Samples, n: int) -> bool:
    """True where the stretch is fast, long and complete enough."""
    known = np.isfinite(speed)
    if known.mean() < 1.0 - MOST_MISSING:
        return False
    shaft_hz = float(np.median(speed[known])) / 60.0
    step = float(np.median(np.diff(part.time_s)))
    if shaft_hz <= 0.0 or 1.0 / step < SAMPLES_PER_HIGHEST_PERIOD * 2 * n * shaft_hz:
        return False
    if len(part) * step * shaft_hz < LEAST_REVOLUTIONS:
        return False
    return all(np.isfinite(part[name]).mean() >= 1.0 - MOST_MISSING for name in PRESSURES)


def _shaft_angle(time_s: Samples, speed: Samples) -> Samples:
    """Angle turned since the first sample [rad], shape (n,): trapezoids under the speed channel."""
    known = np.isfinite(speed)
    omega = np.interp(time_s, time_s[known], speed[known]) * (2.0 * math.pi / 60.0)
    steps = 0.5 * (omega[1:] + omega[:-1]) * np.diff(time_s)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _pieces(angle: Samples) -> list[slice]:
    """Pieces of at most 160 revolutions: longer ones would smear; at most 16, spread evenly."""
    total = float(angle[-1]) / (2.0 * math.pi)
    count = max(1, round(total / _PIECE_REVOLUTIONS))
    edges = np.searchsorted(angle, np.linspace(0.0, angle[-1], count + 1))
    edges[-1] = len(angle)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_PIECES)).round().astype(np.int64))
    return [slice(int(edges[i]), int(edges[i + 1])) for i in chosen]


def _sharpest(theta: Samples, pressure: Samples, n: int) -> float:
    """Factor on the angle that makes the porting line of the discharge pressure sharpest; 1 where none stands out."""
    known = np.isfinite(pressure)
    x, at = pressure[known] - pressure[known].mean(), theta[known]
    width = 2.0 * math.pi / (n * (at[-1] - at[0]))
    scales = 1.0 + np.arange(-_SPEED_SEARCH, _SPEED_SEARCH + 0.2 * width, 0.2 * width)
    power = np.abs([np.exp(-1j * n * scale * at) @ x for scale in scales]) ** 2
    best = int(np.argmax(power))
    # power of white noise at any one frequency is exponential with this mean
    floor = float(x @ x)
    if power[best] < (math.log(len(scales)) + 10.0) * floor or not 0 < best < len(scales) - 1:
        return 1.0
    left, top, right = power[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * top + right)
    return float(scales[best] + 0.2 * width * shift)


class _Fit:
    """Least-squares fit of all whole orders up to 2 n + 1 and a parabola to one piece of one pressure.

    Attributes
    ----------
    lines
        Complex amplitudes of ``orders_of(n)`` [bar], shape (5,).
    floors
        One-sigma of the real and of the imaginary part of each [bar], shape (5,).
    residual
        What is left, NaN where a sample is missing or a spike, shape (m,) [bar].
    """

    def __init__(self, theta: Samples, pressure: Samples, n: int) -> None:
        orders = np.arange(1, 2 * n + 2)
        self.orders = orders_of(n)
        x = without_spikes(pressure)
        span = theta[-1] - theta[0]
        t = 2.0 * (theta - theta[0]) / span - 1.0
        waves = np.outer(theta, orders)
        design = np.column_stack((np.ones_like(t), t, t * t, np.cos(waves), np.sin(waves)))
        for _ in range(2):
            known = np.isfinite(x)
            solution = np.linalg.lstsq(design[known], x[known], rcond=None)[0]
            self.residual = x - design @ solution
            # a spike between the peaks of the ripple shows only once the ripple is gone
            x = np.where(np.isfinite(without_spikes(self.residual)), x, np.nan)
        m = len(orders)
        cosines, sines = solution[3 : 3 + m], solution[3 + m :]
        self.lines: Complex = (cosines - 1j * sines)[[k - 1 for k in self.orders]]
        self.floors = self._noise(theta, span)

    def _noise(self, theta: Samples, span: float) -> Samples:
        """Root mean square of the residual's amplitudes 3 to 12 bins off each order, over root 2."""
        known = np.isfinite(self.residual)
        at, x = theta[known], self.residual[known]
        bins = np.concatenate((np.arange(-12, -2), np.arange(3, 13))) * (2.0 * math.pi / span)
        beside = np.exp(-1j * np.outer(bins, at))
        floors = []
        for order in self.orders:
            amplitudes = 2.0 / len(x) * np.abs(beside @ (np.exp(-1j * order * at) * x))
            floors.append(float(np.sqrt(np.mean(amplitudes**2) / 2.0)))
        return np.array(floors)


def _channel(
    samples: Samples,
    fits: list[_Fit],
    discharge: tuple[list[Complex], list[Samples]] | None,
    rate: float,
    shaft_hz: float,
) -> ChannelSpectrum:
    lines = np.array([fit.lines for fit in fits])
    floors = np.array([fit.floors for fit in fits])
    power = np.sqrt((np.abs(lines) ** 2).mean(axis=0))
    error = np.sqrt((floors**2).mean(axis=0) / len(fits))
    phases: list[float | None] = [None] * len(power)
    if discharge is not None:
        lines_d, floors_d = np.array(discharge[0]), np.array(discharge[1])
        power_d = np.sqrt((np.abs(lines_d) ** 2).mean(axis=0))
        error_d = np.sqrt((floors_d**2).mean(axis=0) / len(fits))
        clear = (power > _STANDS_OUT * error) & (power_d > _STANDS_OUT * error_d)
        relative = np.angle((lines * np.conj(lines_d)).mean(axis=0), deg=True)
        phases = [float(p) if ok else None for p, ok in zip(relative, clear, strict=True)]
    residual = np.concatenate([fit.residual for fit in fits])
    noise = float(np.nanstd(residual))
    resolution = _resolution(samples)
    ripple, frequency, cycle = _regulation(max((fit.residual for fit in fits), key=len), rate, shaft_hz)
    return ChannelSpectrum(
        tuple(
            OrderLine(order, float(a), float(e), p)
            for order, a, e, p in zip(fits[0].orders, power, error, phases, strict=True)
        ),
        noise,
        ripple,
        cycle,
        resolution,
        noise >= _DITHER * resolution,
        frequency,
    )


def _resolution(samples: Samples) -> float:
    """Smallest difference between two different samples [bar]; 0 where all are equal."""
    values = np.unique(samples[np.isfinite(samples)])
    steps = np.diff(values)
    # rounding of decimal places makes steps that are no steps
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) else 0.0


def _regulation(residual: Samples, rate: float, shaft_hz: float) -> tuple[float, float | None, LimitCycle | None]:
    """Ripple below order 1 beyond the white floor [bar], its mean frequency [Hz], and the strongest line there."""
    x = np.where(np.isfinite(residual), residual, 0.0)
    m = len(x)
    window = np.hanning(m)
    transform = np.fft.rfft(x * window)
    # scaled so that white noise of variance v has the mean v / m * m = v per bin
    power = np.abs(transform) ** 2 / float(window @ window)
    hz = np.asarray(np.fft.rfftfreq(m, 1.0 / rate), dtype=np.float64)
    inside = (hz > _BAND[0] * shaft_hz) & (hz < _BAND[1] * shaft_hz)
    above = (hz > 1.15 * shaft_hz) & (hz < _FLOOR_UNTIL * shaft_hz)
    if inside.sum() < 16:
        return 0.0, None, None
    # the median of an exponential law is ln 2 of its mean, and lines do not move it
    floor = float(np.median(power[above])) / math.log(2.0)
    ripple = math.sqrt(max(2.0 * float((power[inside] - floor).sum()) / m, 0.0))
    # power of noise alone strays by the root of the number of bins: a mean of less than ten of that is noise's own
    beyond = power[inside] - floor
    frequency = None
    if beyond.sum() > _RIPPLE_STANDS_OUT * floor * math.sqrt(inside.sum()):
        frequency = math.exp(float(beyond @ np.log(hz[inside])) / float(beyond.sum()))
        frequency = min(max(frequency, _BAND[0] * shaft_hz), _BAND[1] * shaft_hz)
    return ripple, frequency, _strongest(x, power, hz, inside, rate)


def _strongest(x: Samples, power: Samples, hz: Samples, inside: NDArray[np.bool_], rate: float) -> LimitCycle:
    """Strongest line of the band: against the band's own level, and by whether it keeps its beat."""
    places = np.flatnonzero(inside)
    peak = int(places[np.argmax(power[places])])
    local = float(np.median(power[places])) / math.log(2.0)
    # Fisher's test with a robust level; a Hann window makes neighbours dependent, so counting all is on the safe side
    ratio = float(power[peak]) / max(local, 1e-300)
    alarm = 1.0 if ratio < 1.0 else -math.expm1(len(places) * math.log1p(-math.exp(-ratio)))
    left, top, right = np.sqrt(power[peak - 1 : peak + 2])
    # between the bins of a Hann window
    shift = (2.0 * right - top) / (right + top) if right > left else -(2.0 * left - top) / (left + top)
    frequency = float(hz[peak] + shift * hz[1])
    t = np.arange(len(x)) / rate
    wave = np.exp(-2j * math.pi * frequency * t)
    amplitude = 2.0 * abs(wave @ x) / len(x)
    lag = round(_BEAT_PERIODS * rate / frequency)
    # within a band of a quarter of the frequency, the envelope is what a beat loses
    band = np.fft.rfft(x)
    band[np.abs(np.fft.rfftfreq(len(x), 1.0 / rate) - frequency) > 0.25 * frequency] = 0.0
    y = np.fft.irfft(band, len(x))
    energy = float(y @ y)
    kept = float(y[:-lag] @ y[lag:]) / energy * len(y) / (len(y) - lag) if 0 < lag < len(y) and energy > 0.0 else 0.0
    return LimitCycle(frequency, float(amplitude), float(alarm), kept, alarm < _FALSE_ALARM and kept > _BEAT_KEPT)
