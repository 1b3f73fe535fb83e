"""From rendered radiance to the signals that kernels are applied to, and back (METHODS 10.1).

The picture is split in two branches: the diffuse radiance with the albedo divided out (the irradiance, nearly free of
texture), and the specular radiance. `ε` keeps the division finite (Bako et al. 2017, section 4.1). The *same noisy
albedo* is divided out before and multiplied back after; only the training target is divided by the reference's own.
"""

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor
from torch.nn import functional

EPSILON = 0.00316
# Rec. 709; the same numbers as in `denoise/src/metrics`.
LUMINANCE = (0.2126, 0.7152, 0.0722)
# exp(20) is 4.9e8: brighter log-specular values come from broken logits only, and would overflow the loss.
LARGEST_LOG = 20.0


@dataclass(frozen=True)
class Buffers:
    """What a denoiser is given, a batch of it: every tensor `[batch, channels, height, width]`.

    Radiances, albedo and normal have three channels, depth one; each `_variance` is the variance of the mean and has
    the shape of its layer. A missing feature is all zeros with zero variance.
    """

    diffuse: Tensor
    diffuse_variance: Tensor
    specular: Tensor
    specular_variance: Tensor
    albedo: Tensor
    albedo_variance: Tensor
    normal: Tensor
    normal_variance: Tensor
    depth: Tensor
    depth_variance: Tensor
    demodulation: Tensor
    """What the diffuse radiance is divided by, less ε: the albedo, or 1 where the file has none."""

    @property
    def beauty(self) -> Tensor:
        """The whole radiance."""
        return self.diffuse + self.specular

    def map(self, function) -> "Buffers":
        """The same function on every tensor."""
        return replace(self, **{field.name: function(getattr(self, field.name)) for field in fields(self)})


def luminance(radiance: Tensor) -> Tensor:
    """Rec. 709 luminance `[batch, 1, height, width]` of linear RGB."""
    weights = torch.tensor(LUMINANCE, dtype=radiance.dtype, device=radiance.device).view(1, 3, 1, 1)
    return (radiance * weights).sum(1, keepdim=True)


def exposure(beauty: Tensor) -> Tensor:
    """The factor `e = 1/m` that brings each image near 1, `[batch, 1, 1, 1]`; 1 for a black or broken image.

    `m = (mean over pixels of sqrt(max(0, luminance)))²`: the square root keeps fireflies from deciding. In float64.
    """
    mean = luminance(beauty.double()).clamp_min(0).sqrt().mean((1, 2, 3), keepdim=True).square()
    usable = torch.isfinite(mean) & (mean > 0)
    return torch.where(usable, 1 / mean, torch.ones_like(mean)).to(beauty.dtype)


def demodulate(buffers: Buffers, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Diffuse signal `e·c/(a + ε)` and its variance."""
    factor = scale / (buffers.demodulation + EPSILON)
    return buffers.diffuse * factor, buffers.diffuse_variance * factor.square()


def modulate(signal: Tensor, demodulation: Tensor, scale: Tensor) -> Tensor:
    """Diffuse radiance of a diffuse signal; the inverse of [`demodulate`]."""
    return signal * (demodulation + EPSILON) / scale


def log_specular(specular: Tensor, variance: Tensor) -> tuple[Tensor, Tensor]:
    """`ln(1 + max(c, 0))` and its variance by the delta method, `σ²/(1 + c)²` of the *linear* value."""
    positive = specular.clamp_min(0)
    return positive.log1p(), variance / (1 + positive).square()


def exp_specular(signal: Tensor) -> Tensor:
    """Specular radiance of a log-specular signal; the inverse of [`log_specular`]."""
    return signal.clamp_max(LARGEST_LOG).expm1()


def spatial_variance(image: Tensor) -> Tensor:
    """Variance among the 3×3 neighbours of each pixel (`n − 1` in the denominator), clipped at the borders.

    The stand-in where samples say nothing, as `variance::spatial_variance` in Rust.
    """
    channels = image.shape[1]
    ones = torch.ones_like(image[:1, :1])
    box = torch.ones(1, 1, 3, 3, dtype=image.dtype, device=image.device)
    count = functional.conv2d(ones, box, padding=1)
    boxes = box.expand(channels, 1, 3, 3)
    centred = image - image.mean((2, 3), keepdim=True)
    total = functional.conv2d(centred, boxes, padding=1, groups=channels)
    squares = functional.conv2d(centred.square(), boxes, padding=1, groups=channels)
    return ((squares - total.square() / count) / (count - 1).clamp_min(1)).clamp_min(0)
