"""What a burst shows of true order amplitudes, without a single sample: for studies of whole fleets."""

import math

import numpy as np
from numpy.typing import NDArray

Amplitudes = NDArray[np.float64]

DITHER = 1.0 / 3.0
"""Noise over resolution below which a converter hides what is smaller than its step [-]."""


def resolution_of(full_scale_bar: float, bits: int) -> float:
    """Step of a converter [bar]: 350 bar in 12 bits are 85 mbar."""
    return full_scale_bar / 2.0**bits


def amplitude_error(noise_bar: float, resolution_bar: float, sample_rate_hz: float, duration_s: float) -> float:
    """One-sigma error of the real and of the imaginary part of an amplitude [bar].

    White noise of variance v over N samples gives an amplitude the variance 2 v / N in each part; a dithered
    converter adds its ``resolution^2 / 12`` to v (Widrow's model of quantisation).

    Raises
    ------
    ValueError
        naming every number that is not possible, and when the noise does not dither the converter.
    """
    faults = [
        f"{name} = {value:g} (must be above 0)"
        for name, value in (
            ("noise_bar", noise_bar),
            ("sample_rate_hz", sample_rate_hz),
            ("duration_s", duration_s),
        )
        if not (math.isfinite(value) and value > 0.0)
    ]
    if not (math.isfinite(resolution_bar) and resolution_bar >= 0.0):
        faults.append(f"resolution_bar = {resolution_bar:g} (must be 0 or more)")
    if not faults and noise_bar < DITHER * resolution_bar:
        faults.append(
            f"noise of {noise_bar:g} bar does not dither a converter of {resolution_bar:g} bar: amplitudes below its "
            "step cannot be told, take a finer converter"
        )
    if faults:
        raise ValueError("; ".join(faults))
    variance = noise_bar**2 + resolution_bar**2 / 12.0
    return math.sqrt(2.0 * variance / (sample_rate_hz * duration_s))


def measured_amplitudes(
    true: Amplitudes,
    rng: np.random.Generator,
    *,
    noise_bar: tuple[float, float] = (0.15, 0.003),
    resolution_bar: tuple[float, float] = (350.0 / 4096, 5.0 / 4096),
    sample_rate_hz: float = 10_000.0,
    duration_s: float = 2.0,
) -> tuple[Amplitudes, Amplitudes]:
    """Amplitudes as a burst shows them, and their standard errors.

    Parameters
    ----------
    true
        Amplitudes of discharge and case pressure [bar], shape (…, 2, m).
    noise_bar, resolution_bar
        White noise and converter's step of the discharge and of the case sensor [bar].

    Returns
    -------
    measured, standard_error
        Shapes of ``true`` [bar]. An amplitude is the length of the true line plus noise in both parts: it follows
        Rice's law, as the real one does.

    Raises
    ------
    ValueError
        as ``amplitude_error``.
    """
    errors = [
        amplitude_error(noise, step, sample_rate_hz, duration_s)
        for noise, step in zip(noise_bar, resolution_bar, strict=True)
    ]
    error = np.broadcast_to(np.array(errors)[:, None], true.shape)
    real, imaginary = rng.normal(size=(2, *true.shape)) * error
    return np.hypot(true + real, imaginary), error.copy()
