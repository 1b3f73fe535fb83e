"""Transforms and their inverses, and their variances against Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from quietlight_training import transforms
from tests.conftest import random_buffers


@pytest.mark.parametrize("value", [0.0, 1e-6, 1.0, 1e8])
@pytest.mark.parametrize("albedo", [0.0, 0.5, 1.0])
def test_modulation_is_the_inverse_of_demodulation(value, albedo):
    buffers = random_buffers(4, 4)
    full = torch.full_like(buffers.diffuse, value)
    buffers = replace(buffers, diffuse=full, demodulation=torch.full_like(full, albedo))
    scale = torch.tensor(3.7)
    signal, _ = transforms.demodulate(buffers, scale)
    torch.testing.assert_close(transforms.modulate(signal, buffers.demodulation, scale), full, rtol=1e-6, atol=0)


def test_the_exponential_is_the_inverse_of_the_logarithm():
    values = torch.tensor([0.0, 1e-7, 1e-3, 1.0, 1e4, 1e8], dtype=torch.float64)
    signal, _ = transforms.log_specular(values, values)
    torch.testing.assert_close(transforms.exp_specular(signal), values, rtol=1e-12, atol=0)
    # Negative light, which filters can make, is none; a broken logit cannot overflow.
    assert transforms.log_specular(torch.tensor([-1.0]), torch.zeros(1))[0] == 0
    assert torch.isfinite(transforms.exp_specular(torch.tensor([1e9])))


def test_the_variances_are_those_of_transformed_samples():
    # 200 000 Gaussian radiances of deviation 1 % of 1 + c. The estimate of a variance from n samples has the relative
    # standard deviation √(2/n) = 0.32 %; the delta method's own error is of the order of the squared relative noise,
    # 1e-4 of the value. Five standard deviations.
    generator = np.random.default_rng(3)
    radiance, albedo, deviation = 0.8, 0.3, 0.018
    samples = torch.from_numpy(radiance + deviation * generator.standard_normal(200_000))
    bound = 5 * np.sqrt(2 / 200_000)
    signal, _ = transforms.log_specular(samples, samples)
    _, variance = transforms.log_specular(torch.tensor(radiance), torch.tensor(deviation**2))
    assert abs(signal.var().item() / variance.item() - 1) < bound
    buffers = random_buffers(1, 1, dtype=torch.float64)
    full = torch.ones_like(buffers.diffuse)
    buffers = replace(
        buffers, diffuse=full * radiance, diffuse_variance=full * deviation**2, demodulation=full * albedo
    )
    _, variance = transforms.demodulate(buffers, torch.tensor(2.0, dtype=torch.float64))
    signals = 2 * samples / (albedo + transforms.EPSILON)
    assert abs(signals.var().item() / variance[0, 0, 0, 0].item() - 1) < bound


def test_exposure_brings_a_grey_image_to_one_and_black_is_left_alone():
    grey = torch.full((1, 3, 4, 4), 0.25)
    torch.testing.assert_close(transforms.exposure(grey), torch.full((1, 1, 1, 1), 4.0))
    assert transforms.exposure(torch.zeros(1, 3, 4, 4)) == 1
    assert transforms.exposure(torch.full((1, 3, 4, 4), torch.inf)) == 1
    # Half black, half 4: the square root's mean is 1.
    half = torch.zeros(1, 3, 4, 4)
    half[..., :2] = 4
    torch.testing.assert_close(transforms.exposure(half), torch.ones(1, 1, 1, 1))


def test_the_spatial_variance_is_that_of_nine_neighbours():
    # The example of variance.rs: nine consecutive integers, and the corner's four.
    image = torch.arange(9.0).view(1, 1, 3, 3)
    variance = transforms.spatial_variance(image)[0, 0]
    torch.testing.assert_close(variance[1, 1], torch.tensor(7.5))
    torch.testing.assert_close(variance[0, 0], torch.tensor(10 / 3))
    assert transforms.spatial_variance(torch.ones(1, 1, 1, 1)) == 0
