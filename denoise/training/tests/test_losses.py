"""The metrics against their definitions, and the loss against its own."""

import numpy as np
import pytest
import torch

from quietlight_training import losses, metrics
from quietlight_training.config import LossConfig
from quietlight_training.denoiser import Denoised
from quietlight_training.losses import Target


def test_relative_l2_of_a_worked_example():
    image, reference = torch.tensor([[[[0.5, 1.0]]]]), torch.tensor([[[[0.3, 2.0]]]])
    expected = (0.04 / 0.1 + 1 / 4.01) / 2
    assert metrics.relative_l2(image, reference).item() == pytest.approx(expected, rel=1e-6)


def test_the_dissimilarity_is_wangs():
    generator = np.random.default_rng(1)
    x, y = generator.random((2, 14, 15))
    offsets = np.arange(-5, 6)
    window = np.exp(-0.5 * (offsets[:, None] ** 2 + offsets[None, :] ** 2) / 1.5**2)
    window /= window.sum()
    values = []
    for row in range(5, 9):
        for column in range(5, 10):
            a, b = (image[row - 5 : row + 6, column - 5 : column + 6] for image in (x, y))
            ma, mb = (window * a).sum(), (window * b).sum()
            va, vb = (window * (a - ma) ** 2).sum(), (window * (b - mb) ** 2).sum()
            covariance = (window * (a - ma) * (b - mb)).sum()
            values.append((2 * ma * mb + 1e-4) * (2 * covariance + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4)))
    found = metrics.dissimilarity(*(torch.from_numpy(image)[None, None] for image in (x, y)))
    assert found.item() == pytest.approx(1 - np.mean(values), rel=1e-10)
    assert metrics.dissimilarity(torch.ones(1, 3, 20, 20), torch.ones(1, 3, 20, 20)).item() == pytest.approx(0, abs=1e-6)


def test_the_transfer_curve_is_srgb_and_has_finite_slopes():
    radiance = torch.tensor([-1.0, 0.0, 0.001, 0.0031308, 0.18, 1.0, 50.0], requires_grad=True)
    shown = metrics.srgb(radiance)
    expected = [0, 0, 0.01292, 0.04045, 0.46135612, 1, 1]
    torch.testing.assert_close(shown.detach(), torch.tensor(expected), rtol=1e-4, atol=1e-6)
    shown.sum().backward()
    assert torch.isfinite(radiance.grad).all()


def random_case() -> tuple[Denoised, Target]:
    images = [torch.rand(2, 3, 16, 16, dtype=torch.float64) for _ in range(7)]
    exposure = torch.tensor([0.5, 2.0], dtype=torch.float64).view(2, 1, 1, 1)
    denoised = Denoised(*(image.requires_grad_() for image in images[:3]))
    return denoised, Target(images[3], images[4], images[5], images[6], images[6] + 0.3, exposure, False)


def test_a_perfect_image_has_no_loss():
    _, target = random_case()
    perfect = Denoised(target.diffuse, target.specular, target.radiance)
    total, terms = losses.loss(perfect, target, LossConfig(radiance=1.0))
    assert total.item() == pytest.approx(0, abs=1e-12)
    assert set(terms) == {"branches", "relative_l2", "dissimilarity", "shown", "radiance"}


def test_the_gradients_of_the_loss_are_those_of_finite_differences():
    _, target = random_case()
    images = [(0.2 + torch.rand(2, 3, 16, 16, dtype=torch.float64)).requires_grad_() for _ in range(3)]

    def total(*images):
        return losses.loss(Denoised(*images), target, LossConfig(radiance=1.0))[0]

    # Along one random direction: 4608 single differences would say no more.
    direction = [torch.randn_like(image) for image in images]
    total(*images).backward()
    along = sum((image.grad * step).sum() for image, step in zip(images, direction, strict=True)).item()
    h = 1e-7
    with torch.no_grad():
        ends = [total(*(i + s * h * d for i, d in zip(images, direction, strict=True))).item() for s in (1, -1)]
    assert along == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4)


def test_robust_relative_l2_is_the_metric_where_small_and_linear_where_large():
    reference = torch.ones(1, 3, 4, 4, dtype=torch.float64)
    near, far, farther = (losses.robust_relative_l2(reference + error, reference).item() for error in (1e-3, 1e4, 2e4))
    assert near == pytest.approx(metrics.relative_l2(reference + 1e-3, reference).item(), rel=1e-5)
    assert farther / far == pytest.approx(2, rel=1e-3)
