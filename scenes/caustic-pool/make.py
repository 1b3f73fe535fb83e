"""Writes water.ply, the surface of the pool, and tiles.png, its floor. Needs Python 3 and nothing else."""

import math
import random
import struct
import zlib
from pathlib import Path

FOLDER = Path(__file__).parent

# Amplitude in metres, waves per metre along x and z, phase.
WAVES = [
    (0.022, 0.55, 0.30, 0.0),
    (0.016, -0.40, 0.70, 1.3),
    (0.009, 1.10, -0.60, 2.1),
    (0.006, 0.90, 1.40, 4.0),
    (0.003, -2.10, 1.20, 0.7),
]
HALF_WIDTH = 2.0
CELLS = 48


def height_and_normal(x, z):
    """Height of the water at a point, and the upward unit normal."""
    y = slope_x = slope_z = 0.0
    for amplitude, along_x, along_z, phase in WAVES:
        kx, kz = 2 * math.pi * along_x, 2 * math.pi * along_z
        y += amplitude * math.sin(kx * x + kz * z + phase)
        slope_x += amplitude * kx * math.cos(kx * x + kz * z + phase)
        slope_z += amplitude * kz * math.cos(kx * x + kz * z + phase)
    length = math.sqrt(1 + slope_x**2 + slope_z**2)
    return y, (-slope_x / length, 1 / length, -slope_z / length)


def write_water():
    side = CELLS + 1
    vertices = bytearray()
    for row in range(side):
        for column in range(side):
            x = HALF_WIDTH * (2 * column / CELLS - 1)
            z = HALF_WIDTH * (2 * row / CELLS - 1)
            y, normal = height_and_normal(x, z)
            vertices += struct.pack("<6f", x, y, z, *normal)
    faces = bytearray()
    for row in range(CELLS):
        for column in range(CELLS):
            a = row * side + column
            b, c, d = a + 1, a + side, a + side + 1
            # Counter-clockwise from above.
            for triangle in ((a, c, b), (b, c, d)):
                faces += struct.pack("<B3i", 3, *triangle)
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {side * side}\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        + f"element face {2 * CELLS * CELLS}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (FOLDER / "water.ply").write_bytes(header.encode() + vertices + faces)


def write_tiles(tiles=8, size=16):
    """A mosaic of blue tiles, each with its own shade, with light joints between them."""
    random.seed(1)
    shades = [[random.uniform(0.75, 1.1) for _ in range(tiles)] for _ in range(tiles)]
    rows = bytearray()
    for y in range(tiles * size):
        rows.append(0)  # no PNG row filter
        for x in range(tiles * size):
            if x % size == 0 or y % size == 0:
                pixel = (225, 228, 224)
            else:
                shade = shades[y // size][x // size]
                pixel = tuple(min(255, round(value * shade)) for value in (110, 178, 196))
            rows += bytes(pixel)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    width = tiles * size
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, width, 8, 2, 0, 0, 0))
    png += chunk(b"IDAT", zlib.compress(bytes(rows), 9)) + chunk(b"IEND", b"")
    (FOLDER / "tiles.png").write_bytes(png)


write_water()
write_tiles()
