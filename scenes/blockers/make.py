"""Writes lamps.hdr, an invented night with bright lamps all around a dim horizon. Needs Python 3 and nothing else."""

import math
from pathlib import Path

WIDTH, HEIGHT = 256, 128

# Elevation and azimuth of the middle, half its height and half its width in degrees, radiance.
LAMPS = [
    (62, 100, 5, 5, (160.0, 150.0, 130.0)),
    (35, 200, 9, 3, (70.0, 60.0, 40.0)),
    (28, 330, 3, 14, (30.0, 40.0, 60.0)),
    (48, 20, 4, 4, (90.0, 40.0, 20.0)),
    (18, 250, 6, 6, (20.0, 26.0, 20.0)),
]


def radiance(elevation, azimuth):
    """Colour of the lamp there, else of the night; both in degrees."""
    for middle, around, half_height, half_width, colour in LAMPS:
        across = (azimuth - around + 180) % 360 - 180
        if abs(elevation - middle) < half_height and abs(across) < half_width:
            return colour
    if elevation < 0:
        return (0.02, 0.02, 0.025)
    glow = math.exp(-elevation / 20)
    return (0.03 + 0.25 * glow, 0.04 + 0.2 * glow, 0.08 + 0.16 * glow)


def rgbe(colour):
    """Three mantissas of eight bits and their common exponent."""
    mantissa, exponent = math.frexp(max(colour))
    scale = mantissa * 256 / max(colour)
    return bytes(min(255, int(value * scale)) for value in colour) + bytes([exponent + 128])


def pixel(row, column, samples=4):
    """Mean over the texel, so that the lamps have smooth edges."""
    total = [0.0, 0.0, 0.0]
    for i in range(samples):
        for j in range(samples):
            elevation = 180 * (0.5 - (row + (i + 0.5) / samples) / HEIGHT)
            azimuth = 360 * (column + (j + 0.5) / samples) / WIDTH
            for k, value in enumerate(radiance(elevation, azimuth)):
                total[k] += value / samples**2
    return rgbe(total)


data = b"".join(pixel(row, column) for row in range(HEIGHT) for column in range(WIDTH))
header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n"
(Path(__file__).parent / "lamps.hdr").write_bytes(header.encode() + data)
