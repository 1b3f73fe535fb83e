"""What a network is trained to make small.

The aim is a low relative L2 and a low 1 − SSIM at every sample count, against a reference that itself has a little noise.
Five terms, each a mean over an image:

- `branches`: |ln(1 + ŝ) − ln(1 + s)| of each branch's signal, which fireflies cannot dominate and which tells a branch
  its own faults where the other is brighter;
- `relative_l2`: the metric, with a Huber tail: quadratic in the relative error up to 1, linear beyond, where a convex
  combination that let a firefly in would otherwise outweigh all other pixels of a batch;
- `dissimilarity`: 1 − SSIM of what is shown;
- `shown`: L1 of what is shown, and of its gradients;
- `radiance`: L1 of the recombined radiance, the paper's (Bako et al. 2017, section 5.2); off unless one trains its network.

The second and third are divided by the square root of the same figure of the noisy image: the best that can be had grows
about so with the noise, and thus high sample counts, where denoisers do harm, matter as much as low ones.
"""

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from quietlight_training.config import LossConfig
from quietlight_training.denoiser import Denoised
from quietlight_training.metrics import RELATIVE_L2_EPSILON, dissimilarity, srgb

# A branch's radiance under an albedo of this counts half: where nothing is reflected its signal is mere noise over ε.
HALF_WEIGHT_ALBEDO = 0.05
# Noisy images better than this are not told apart: 1e-4 is well below the noise that references have (1e-3).
LEAST_RELATIVE_L2 = 1e-4
LEAST_DISSIMILARITY = 1e-3


@dataclass(frozen=True)
class Target:
    """What the networks should have made of a batch, `[batch, 3, height, width]`, and what they were given."""

    diffuse: Tensor
    specular: Tensor
    """Signals of the branches, as in [`Denoised`]."""
    demodulation: Tensor
    radiance: Tensor
    noisy: Tensor
    exposure: Tensor
    """Factor on radiances before they are judged, `[batch, 1, 1, 1]`."""
    is_log_specular: bool

    def to(self, device: torch.device) -> "Target":
        """The same on a device."""
        tensors = {f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "is_log_specular"}
        return replace(self, **tensors)


def loss(denoised: Denoised, target: Target, config: LossConfig) -> tuple[Tensor, dict[str, float]]:
    """The weighted sum of the terms, and the terms."""
    image, reference, noisy = (
        radiance * target.exposure for radiance in (denoised.radiance, target.radiance, target.noisy)
    )
    shown, reference_shown = srgb(image), srgb(reference)
    with torch.no_grad():
        noisy_l2 = robust_relative_l2(noisy, reference)
        noisy_dissimilarity = dissimilarity(srgb(noisy), reference_shown)
    terms = {
        "branches": branch_loss(denoised, target),
        "relative_l2": (robust_relative_l2(image, reference) / (noisy_l2 + LEAST_RELATIVE_L2).sqrt()).mean(),
        "dissimilarity": (
            dissimilarity(shown, reference_shown) / (noisy_dissimilarity + LEAST_DISSIMILARITY).sqrt()
        ).mean(),
        "shown": (shown - reference_shown).abs().mean() + gradient_difference(shown, reference_shown),
        "radiance": (image - reference).abs().mean(),
    }
    total = sum(getattr(config, name) * term for name, term in terms.items() if getattr(config, name))
    return total, {name: term.item() for name, term in terms.items()}


def robust_relative_l2(image: Tensor, reference: Tensor) -> Tensor:
    """Mean of `2(√(1 + q) − 1)` over each image, `[batch]`, with `q = (x − r)²/(r² + 0.01)`: q where it is small."""
    squared = (image - reference).square() / (reference.square() + RELATIVE_L2_EPSILON)
    return (2 * ((1 + squared).sqrt() - 1)).mean((1, 2, 3))


def branch_loss(denoised: Denoised, target: Target) -> Tensor:
    """L1 of both branches' logarithmic signals; the diffuse one weighted by how much of it is seen."""
    weight = target.demodulation / (target.demodulation + HALF_WEIGHT_ALBEDO)
    diffuse = (weight * (_log(denoised.diffuse) - _log(target.diffuse)).abs()).mean()
    if target.is_log_specular:
        return diffuse + (denoised.specular - target.specular).abs().mean()
    return diffuse + (_log(denoised.specular) - _log(target.specular)).abs().mean()


def gradient_difference(shown: Tensor, reference: Tensor) -> Tensor:
    """L1 of the differences between neighbours."""
    error = shown - reference
    return error.diff(dim=-1).abs().mean() + error.diff(dim=-2).abs().mean()


def _log(signal: Tensor) -> Tensor:
    return signal.clamp_min(0).log1p()
