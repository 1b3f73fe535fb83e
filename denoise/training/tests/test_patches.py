"""Choosing patches by importance."""

import numpy as np
import pytest

from quietlight_training import patches


def test_the_importance_is_in_zero_to_one_and_high_where_the_picture_varies():
    colour = np.full((3, 60, 80), 0.5)
    colour[:, 20:40, 50:70] += np.random.default_rng(1).random((3, 20, 20))
    normal = np.zeros((3, 60, 80))
    normal[2] = 1
    importance = patches.importance_map(colour, normal, 9)
    assert importance.shape == (60, 80)
    assert importance.min() >= 0
    assert importance.max() == pytest.approx(1)
    assert importance[30, 60] > 0.5
    assert importance[5, 5] < 1e-3
    assert (patches.importance_map(np.ones((3, 8, 8)), normal[:, :8, :8], 5) == 0).all()


def test_the_importance_of_a_pixel_is_its_formula():
    generator = np.random.default_rng(2)
    colour, normal = generator.random((3, 12, 12)) * 4, generator.random((3, 12, 12))
    maps = []
    for image, relative in ((colour, True), (normal, False)):
        values = np.zeros((12, 12))
        for y in range(12):
            for x in range(12):
                window = image[:, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
                variance = window.var((1, 2)) / (np.maximum(window.mean((1, 2)) ** 2, 0.01) if relative else 1)
                values[y, x] = min(variance.max() ** (1 / 2.2), 1)
        maps.append(values / values.max())
    expected = sum(maps) / sum(maps).max()
    np.testing.assert_allclose(patches.importance_map(colour, normal, 5), expected, rtol=0, atol=1e-6)


def test_darts_keep_their_distance_and_their_number():
    darts = patches.throw_darts(60, 80, 100, np.random.default_rng(3))
    assert len(set(darts)) == 100
    assert all(0 <= y < 60 and 0 <= x < 80 for y, x in darts)
    distances = [np.hypot(y - v, x - u) for i, (y, x) in enumerate(darts) for v, u in darts[:i]]
    # Uniform places would come nearer than one pixel; the radius began at √48 = 6.9 and may have shrunk to half.
    assert min(distances) > 3.5
    assert len(patches.throw_darts(2, 3, 100, np.random.default_rng(3))) == 6


def test_the_kept_fraction_is_the_mean_importance():
    # Error diffusion: the sum of what was kept less what was due is a random walk that is drawn back to 0 with every
    # step; its standard deviation stays below 1, so that 2000 candidates keep the mean to 3/2000.
    importance = np.random.default_rng(4).random(2000) ** 2
    kept, forced = patches.prune(importance, np.random.default_rng(5))
    assert forced == 0
    assert abs(kept.mean() - importance.mean()) < 3 / 2000


def test_long_rejections_are_ended_by_force_and_counted():
    kept, forced = patches.prune(np.zeros(510), np.random.default_rng(6))
    # 50 rejections, then one kept: 510 candidates hold ten such rounds of 51.
    assert kept.sum() == forced == 10
    assert list(np.flatnonzero(kept)) == [50 + 51 * round_ for round_ in range(10)]


def test_chosen_patches_lie_inside_and_a_small_picture_has_none():
    generator = np.random.default_rng(7)
    corners = patches.choose(generator.random((40, 50)), 32, 20, generator)
    assert corners
    assert all(0 <= y <= 8 and 0 <= x <= 18 for y, x in corners)
    assert patches.choose(np.zeros((40, 50)), 32, 20, generator)
    assert patches.choose(np.ones((30, 50)), 32, 20, generator) == []
