"""Choosing where to cut training patches: many where there is much to learn (METHODS 10.4).

Candidates are thrown like darts, no two nearer than a radius; an importance map says how much the picture and the normals
vary in the window of a patch; candidates are kept in proportion to it by error diffusion.
"""

import hashlib

import numpy as np

# Failures in a row after which the darts' radius shrinks by RADIUS_SHRINK.
DART_FAILURES = 5000
RADIUS_SHRINK = 0.96
# Rejections in a row after which a candidate is kept, so that no part of a picture is left out.
LARGEST_REJECTIONS = 50
# Windows darker than a mean of 0.1 are judged by their absolute variance.
DARKEST_MEAN_SQUARED = 0.01
GAMMA = 2.2


def seed_of(name: str) -> int:
    """A seed that depends on the name alone."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")


def importance_map(colour: np.ndarray, normal: np.ndarray, size: int) -> np.ndarray:
    """Importance in [0, 1] of the window of `size`² pixels around each pixel, `[height, width]`.

    The sum, over its largest value, of two maps `min(variance^(1/2.2), 1)`, each over its largest value: the variance
    within the window of the colour, relative to its squared mean, and of the normals.
    """
    total = np.zeros(colour.shape[1:])
    for image, is_relative in ((colour, True), (normal, False)):
        image = image.astype(np.float64)
        mean = _window_mean(image, size)
        variance = np.maximum(_window_mean(image**2, size) - mean**2, 0)
        if is_relative:
            variance /= np.maximum(mean**2, DARKEST_MEAN_SQUARED)
        varied = np.minimum(variance.max(0) ** (1 / GAMMA), 1)
        total += varied / varied.max() if varied.max() > 0 else varied
    return total / total.max() if total.max() > 0 else total


def _window_mean(image: np.ndarray, size: int) -> np.ndarray:
    """Mean over the window of `size`² pixels around each pixel, clipped at the borders."""
    for axis in (1, 2):
        count = image.shape[axis]
        sums = np.concatenate((np.zeros_like(image.take([0], axis)), image.cumsum(axis)), axis)
        first = np.clip(np.arange(count) - size // 2, 0, count)
        last = np.clip(np.arange(count) - size // 2 + size, 0, count)
        lengths = (last - first).reshape([-1 if a == axis else 1 for a in range(3)])
        image = (sums.take(last, axis) - sums.take(first, axis)) / lengths
    return image


def throw_darts(
    height: int, width: int, count: int, generator: np.random.Generator
) -> list[tuple[int, int]]:
    """`count` places `(y, x)` in a grid of `height`×`width`, as far apart as dart throwing gets them.

    The radius starts where discs would cover the area and shrinks when too many darts in a row have missed. At most one
    dart a place.
    """
    count = min(count, height * width)
    radius = np.sqrt(height * width / count)
    darts: list[tuple[int, int]] = []
    failures = 0
    while len(darts) < count:
        dart = (int(generator.integers(height)), int(generator.integers(width)))
        squared = min(((dart[0] - y) ** 2 + (dart[1] - x) ** 2 for y, x in darts), default=np.inf)
        if squared >= radius**2 and squared > 0:
            darts.append(dart)
            failures = 0
            continue
        failures += 1
        if failures >= DART_FAILURES:
            radius *= RADIUS_SHRINK
            failures = 0
    return darts


def prune(
    importance: np.ndarray, generator: np.random.Generator, largest_rejections: int = LARGEST_REJECTIONS
) -> tuple[np.ndarray, int]:
    """Which of a sequence of candidates to keep by their importance, and how many of these were forced.

    Error diffusion makes the kept fraction the mean importance: what one decision gave too much, the next gives less.
    """
    kept = np.zeros(len(importance), dtype=bool)
    error, rejections, forced = 0.0, 0, 0
    for index, value in enumerate(importance):
        accepted = value - error > generator.random()
        if not accepted and rejections >= largest_rejections:
            accepted = True
            forced += 1
        kept[index] = accepted
        rejections = 0 if accepted else rejections + 1
        error += float(accepted) - value
    return kept, forced


def choose(
    importance: np.ndarray, size: int, candidates: int, generator: np.random.Generator
) -> list[tuple[int, int]]:
    """Top left corners of the patches of `size`² pixels to train on; at least one; empty if the picture is too small."""
    height, width = (extent - size + 1 for extent in importance.shape)
    if height < 1 or width < 1:
        return []
    darts = throw_darts(height, width, candidates, generator)
    # Serpentine order over bands of rows, so that neighbours in the sequence are neighbours in the picture.
    band = max(1, int(np.sqrt(height * width / len(darts))))
    darts.sort(key=lambda dart: (dart[0] // band, dart[1] if dart[0] // band % 2 == 0 else -dart[1]))
    values = np.array([importance[y + size // 2, x + size // 2] for y, x in darts])
    kept, _ = prune(values, generator)
    if not kept.any():
        kept[int(values.argmax())] = True
    return [dart for dart, keep in zip(darts, kept, strict=True) if keep]
