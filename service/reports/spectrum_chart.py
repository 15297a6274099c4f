"""Spectrum of a channel as a picture: density over frequency, the shaft's orders marked."""

import math

from detectors.drawing.svg import QUIET, Frame, Scale, axes, document, line, padded, path, text
from service.answers.records import ChannelSpectrum
from service.units import METRIC, UnitSystem, unit_of

_WIDTH, _HEIGHT = 920, 260


def spectrum_svg(found: ChannelSpectrum, system: UnitSystem = METRIC) -> str:
    """Picture of a spectrum; the density is drawn as the logarithm of its value, written in the reader's unit."""
    density = found["density"]
    unit = system.word(density["unit"])
    scale = Scale(unit, 1.0, 2.0 * math.log10(system.scale(unit_of(found["channel"])).factor))
    pairs = [(f, v) for f, v in zip(density["frequency_hz"], density["value"], strict=True) if v > 0.0 and f > 0.0]
    heights = [math.log10(v) for _, v in pairs]
    low, high = padded(heights, smallest=0.2)
    last = max((f for f, _ in pairs), default=1.0)
    frame = Frame(70, 44, _WIDTH - 16, _HEIGHT - 46, 0.0, last, low, high)
    body = axes(frame, "frequency [Hz]", f"{found['channel']}: log10 of the density [{unit}]", y_scale=scale)
    for order in found["orders"]:
        if order["frequency_hz"] <= last:
            x = frame.x(order["frequency_hz"])
            body.append(line(x, frame.top, x, frame.bottom, QUIET, 1.0, 'stroke-dasharray="3 3"'))
            body.append(text(x + 4, frame.top + 12, f"order {order['order']}", colour=QUIET))
    points = [(frame.x(f), frame.y(h)) for (f, _), h in zip(pairs, heights, strict=True)]
    if points:
        body.append(f'<path class="p" d="{path(points)}"/>')
    words = f"{len(pairs)} frequencies up to {last:.4g} Hz, sampled at {found['sample_rate_hz']:.4g} Hz."
    return document(_WIDTH, _HEIGHT, f"Spectrum of {found['channel']}", words, body)
