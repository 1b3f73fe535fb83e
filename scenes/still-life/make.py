"""Writes sky.hdr, an invented sky with a low sun over a dull ground. Needs Python 3 and nothing else."""

import math
from pathlib import Path

WIDTH, HEIGHT = 256, 128
SUN = (math.radians(38), math.radians(52))  # elevation, azimuth
SUN_RADIUS = math.radians(2.5)
SUN_RADIANCE = (340.0, 270.0, 190.0)


def unit(elevation, azimuth):
    return (
        math.cos(elevation) * math.cos(azimuth),
        math.sin(elevation),
        math.cos(elevation) * math.sin(azimuth),
    )


def radiance(elevation, azimuth):
    """Colour of the sky; darker and bluer towards the zenith, warm around the sun."""
    cosine = sum(a * b for a, b in zip(unit(elevation, azimuth), unit(*SUN)))
    angle = math.acos(max(-1.0, min(1.0, cosine)))
    if angle < SUN_RADIUS:
        return SUN_RADIANCE
    if elevation < 0:
        return (0.10, 0.085, 0.07)
    t = math.sqrt(math.sin(elevation))
    sky = [low + (high - low) * t for low, high in zip((0.75, 0.78, 0.80), (0.16, 0.30, 0.58))]
    glow = 1.6 * math.exp(-angle / 0.25)
    return tuple(s + glow * g for s, g in zip(sky, (1.0, 0.85, 0.6)))


def rgbe(colour):
    """Three mantissas of eight bits and their common exponent."""
    mantissa, exponent = math.frexp(max(colour))
    scale = mantissa * 256 / max(colour)
    return bytes(min(255, int(value * scale)) for value in colour) + bytes([exponent + 128])


def pixel(row, column, samples=4):
    """Mean over the texel, so that the sun has a smooth edge."""
    total = [0.0, 0.0, 0.0]
    for i in range(samples):
        for j in range(samples):
            elevation = math.pi * (0.5 - (row + (i + 0.5) / samples) / HEIGHT)
            azimuth = 2 * math.pi * (column + (j + 0.5) / samples) / WIDTH
            for k, value in enumerate(radiance(elevation, azimuth)):
                total[k] += value / samples**2
    return rgbe(total)


data = b"".join(pixel(row, column) for row in range(HEIGHT) for column in range(WIDTH))
header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n"
(Path(__file__).parent / "sky.hdr").write_bytes(header.encode() + data)
