"""Augmentation changes what it says and nothing else."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from quietlight_training import augment
from quietlight_training.augment import Augmentation
from quietlight_training.examples import Pair
from quietlight_training.transforms import spatial_variance

SINGLE = ("albedo_variance", "normal_variance", "depth", "depth_variance")


@pytest.fixture
def pair() -> Pair:
    return Pair(**{field.name: torch.rand(1 if field.name in SINGLE else 3, 6, 6) for field in fields(Pair)})


def test_the_eight_turns_are_all_the_symmetries_of_a_square(pair):
    seen = {tuple(augment.turn(pair, which).depth.flatten().tolist()) for which in range(8)}
    assert len(seen) == 8
    for which in range(8):
        turned = augment.turn(pair, which)
        # Every tensor turns alike: pixels that were together stay together.
        order = augment.turn(replace(pair, depth=torch.arange(36.0).view(1, 6, 6)), which).depth.long().flatten()
        for field in fields(Pair):
            before, after = getattr(pair, field.name), getattr(turned, field.name)
            assert torch.equal(after.flatten(1), before.flatten(1)[:, order]), field.name


def test_colours_are_permuted_in_radiance_and_albedo_together(pair):
    permuted = augment.permute_colours(pair, np.array([2, 0, 1]))
    ratio, permuted_ratio = (p.reference_diffuse / p.reference_albedo for p in (pair, permuted))
    assert torch.equal(permuted_ratio, ratio[[2, 0, 1]])
    for name in augment.COLOURED:
        assert torch.equal(getattr(permuted, name), getattr(pair, name)[[2, 0, 1]]), name
    assert torch.equal(permuted.normal, pair.normal)


def test_turned_normals_keep_their_angles(pair):
    rotation = augment.random_rotation(np.random.default_rng(1))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    turned = augment.rotate(pair.normal, rotation)
    products = [torch.einsum("iyx,ivu->yxvu", normal, normal) for normal in (pair.normal, turned)]
    torch.testing.assert_close(*products, rtol=1e-5, atol=1e-6)
    assert not torch.allclose(turned, pair.normal)


def test_another_renderer_lacks_what_it_lacks(pair):
    whole = augment.as_rendered(pair)
    assert torch.equal(whole.buffers.demodulation, pair.albedo)
    without = augment.as_other_renderer(pair, True, True, True, True)
    buffers = without.buffers
    beauty = pair.diffuse + pair.specular
    assert torch.equal(buffers.diffuse, beauty)
    assert torch.equal(buffers.diffuse_variance, spatial_variance(beauty[None])[0])
    assert torch.equal(without.reference_diffuse, pair.reference_diffuse + pair.reference_specular)
    for nothing in (buffers.specular, buffers.specular_variance, buffers.depth, buffers.albedo, buffers.albedo_variance):
        assert (nothing == 0).all()
    assert (buffers.demodulation == 1).all()
    assert (without.reference_demodulation == 1).all()
    split = augment.as_other_renderer(pair, True, False, False, False).buffers
    assert torch.equal(split.diffuse_variance, pair.beauty_variance)
    assert torch.equal(split.depth, pair.depth)


def test_augmented_pairs_keep_their_shapes(pair):
    generator = np.random.default_rng(2)
    shapes = {name: tensor.shape for name, tensor in vars(augment.as_rendered(pair).buffers).items()}
    for _ in range(40):
        augmented = augment.augment(pair, Augmentation(other_renderer=0.9), generator)
        assert {name: tensor.shape for name, tensor in vars(augmented.buffers).items()} == shapes
        assert 0.25 <= augmented.loss_exposure <= 4
