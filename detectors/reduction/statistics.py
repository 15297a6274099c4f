"""Means that do not pretend: autocorrelation-aware standard errors, robust against single spikes."""

import numpy as np
from numpy.typing import NDArray

from detectors.words.numbers import MAD_TO_SIGMA
from detectors.words.observation import Mean
from twin.recording import Recording

Samples = NDArray[np.float64]

SPIKE_SIGMAS = 6.0
"""Robust sigmas from which a sample is a spike (estimate: a normal law shows one in 500 million)."""
WARMING_S = 60.0
"""Shortest time that a rate of warming is told from [s] (estimate: a probe that repeats to 0.1 K tells 0.2 K/min)."""
_FEWEST_FOR_RATE = 3


def warming_rate(recording: Recording, start_s: float, end_s: float) -> float | None:
    """How fast the fluid warms about a stretch [K/min]: a straight line through at least ``WARMING_S``; None without one."""
    middle, half = 0.5 * (start_s + end_s), 0.5 * max(end_s - start_s, WARMING_S)
    first, last = np.searchsorted(recording.time_s, (middle - half, np.nextafter(middle + half, np.inf)))
    time, temperature = recording.time_s[first:last], recording["fluid_temperature_degc"][first:last]
    known = np.isfinite(temperature)
    if known.sum() < _FEWEST_FOR_RATE or float(np.ptp(time[known])) < 0.5 * half:
        return None
    x = time[known] - float(time[known].mean())
    return float(60.0 * (x @ temperature[known]) / (x @ x))


def without_spikes(samples: Samples, smallest_sigma: float = 0.0) -> Samples:
    """Copy of ``samples``, shape (n,), with single spikes and non-numbers set to NaN.

    A spike lies more than 6 robust sigmas (median absolute deviation) from the median of the stretch;
    ``smallest_sigma`` keeps a quantised, nearly constant channel from losing honest samples.
    """
    clean = np.where(np.isfinite(samples), samples, np.nan)
    known = clean[np.isfinite(clean)]
    if len(known) < 3:
        return clean
    median = float(np.median(known))
    sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(known - median))), smallest_sigma, 1e-12)
    clean[np.abs(clean - median) > SPIKE_SIGMAS * sigma] = np.nan
    return clean


def correlation_time(samples: Samples) -> float:
    """Integrated autocorrelation time of evenly sampled, NaN-free ``samples`` [samples], at least 1.

    Geyer's initial positive sequence: sums of neighbouring autocovariance pairs are added as long as they are
    positive (Geyer 1992, Practical Markov chain Monte Carlo).
    """
    n = len(samples)
    deviation = samples - samples.mean()
    variance = float(deviation @ deviation) / n
    if n < 4 or variance <= 0.0:
        return 1.0
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(deviation, size)
    covariance = np.fft.irfft(spectrum * np.conj(spectrum), size)[:n] / n
    pairs = covariance[0 : 2 * (n // 2) : 2] + covariance[1 : 2 * (n // 2) : 2]
    ends = np.nonzero(pairs <= 0.0)[0]
    last = int(ends[0]) if len(ends) else len(pairs)
    return max(1.0, float(2.0 * pairs[:last].sum() / covariance[0] - 1.0))


def mean_with_error(samples: Samples, smallest_sigma: float = 0.0) -> Mean | None:
    """Mean of a steady stretch, shape (n,), and its standard error; None without a single number.

    Spikes and gaps are left out. The error is ``sigma sqrt(tau / n)`` with tau the integrated autocorrelation
    time, and never below ``smallest_sigma / sqrt(12 n)`` (a quantum hides what is smaller than itself).
    """
    clean = without_spikes(samples, smallest_sigma)
    known = clean[np.isfinite(clean)]
    n = len(known)
    if n == 0:
        return None
    mean = float(known.mean())
    if n == 1:
        return Mean(mean, max(smallest_sigma, 0.0))
    tau = correlation_time(known)
    # n / (n - tau): a correlated mean follows its own samples, so that their spread is too small
    spread = float(known.std()) * np.sqrt(n / max(n - tau, 0.5 * n / (n - 1)))
    return Mean(mean, float(max(spread * np.sqrt(min(tau, n) / n), smallest_sigma / np.sqrt(12.0 * n))))


def block_means(time_s: Samples, samples: Samples, block_s: float) -> tuple[Samples, Samples]:
    """Means over blocks of ``block_s``, NaN where a block holds no number; shapes (m,), (m,).

    Returns the block's start times and means. Gaps in time give empty blocks.
    """
    if len(time_s) == 0:
        return np.empty(0), np.empty(0)
    # a time stamp a hair before the edge of its block belongs to it
    index = ((time_s - time_s[0]) / block_s + 1.0e-6).astype(np.int64)
    m = int(index[-1]) + 1
    known = np.isfinite(samples)
    count = np.bincount(index[known], minlength=m)
    total = np.bincount(index[known], weights=samples[known], minlength=m)
    with np.errstate(invalid="ignore"):
        return time_s[0] + block_s * np.arange(m), np.where(count > 0, total / np.maximum(count, 1), np.nan)
