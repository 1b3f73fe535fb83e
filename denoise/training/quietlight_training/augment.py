"""Changing a training pair into another that could have been rendered: turned, mirrored, recoloured, or written by
another renderer. Gradients are computed afterwards, from what comes out of here."""

from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from quietlight_training.examples import Pair
from quietlight_training.transforms import Buffers, spatial_variance

RADIANCE = ("diffuse", "specular", "reference_diffuse", "reference_specular")
COLOURED = (
    *RADIANCE,
    "diffuse_variance",
    "specular_variance",
    "beauty_variance",
    "albedo",
    "reference_albedo",
)


@dataclass(frozen=True)
class TrainingPair:
    """A pair as a network is to see it, each tensor `[channels, height, width]`: see [`Buffers`] and [`Pair`]."""

    buffers: Buffers
    reference_diffuse: Tensor
    reference_specular: Tensor
    reference_demodulation: Tensor
    input_exposure: float
    """Factor on the exposure that the network's input gets: a crop does not know the brightness of its picture."""
    loss_exposure: float
    """Factor on radiance in the loss, whose dark end is absolute."""


@dataclass(frozen=True)
class Augmentation:
    """How much is changed."""

    other_renderer: float = 0.1
    """Probability that buffers are taken away which other renderers do not write."""
    input_exposure_stops: float = 1.0
    """Standard deviation of the input's exposure, in stops."""
    loss_exposure_stops: float = 2.0
    """Largest change of the loss's exposure, in stops either way."""


def as_rendered(pair: Pair) -> TrainingPair:
    """The pair unchanged."""
    names = [field.name for field in fields(Buffers) if field.name != "demodulation"]
    buffers = Buffers(**{name: getattr(pair, name) for name in names}, demodulation=pair.albedo)
    return TrainingPair(buffers, pair.reference_diffuse, pair.reference_specular, pair.reference_albedo, 1.0, 1.0)


def augment(pair: Pair, options: Augmentation, generator: np.random.Generator) -> TrainingPair:
    """A random change of the pair."""
    pair = turn(pair, int(generator.integers(8)))
    pair = permute_colours(pair, generator.permutation(3))
    pair = replace(pair, normal=rotate(pair.normal, random_rotation(generator)))
    if generator.random() < options.other_renderer:
        without = generator.random(4) < (0.6, 0.5, 0.2, 0.4)
        training_pair = as_other_renderer(pair, *without.tolist())
    else:
        training_pair = as_rendered(pair)
    return replace(
        training_pair,
        input_exposure=float(2 ** (options.input_exposure_stops * generator.standard_normal())),
        loss_exposure=float(2 ** (options.loss_exposure_stops * generator.uniform(-1, 1))),
    )


def turn(pair: Pair, which: int) -> Pair:
    """One of the eight symmetries of the square, by number; normals are in world space and stay."""

    def turned(image: Tensor) -> Tensor:
        image = image.rot90(which % 4, (-2, -1))
        return image.flip(-1) if which >= 4 else image

    return Pair(**{field.name: turned(getattr(pair, field.name)) for field in fields(pair)})


def permute_colours(pair: Pair, order: np.ndarray) -> Pair:
    """The colour channels of radiance and albedo in another order."""
    return replace(pair, **{name: getattr(pair, name)[order.tolist()] for name in COLOURED})


def random_rotation(generator: np.random.Generator) -> np.ndarray:
    """A rotation or reflection of space, uniform: Q of the QR decomposition of Gaussian numbers (Mezzadri 2007)."""
    orthogonal, triangular = np.linalg.qr(generator.standard_normal((3, 3)))
    return orthogonal * np.sign(np.diag(triangular))


def rotate(normal: Tensor, rotation: np.ndarray) -> Tensor:
    """World-space normals as a turned world would have them."""
    return torch.einsum("ij,jyx->iyx", torch.from_numpy(rotation).to(normal), normal)


def as_other_renderer(
    pair: Pair, without_split: bool, without_depth: bool, without_albedo: bool, without_variance: bool
) -> TrainingPair:
    """The pair as a renderer gives it that lacks the diffuse and specular split, depth, albedo or variances."""
    if without_split:
        pair = replace(
            pair,
            diffuse=pair.diffuse + pair.specular,
            diffuse_variance=pair.beauty_variance,
            specular=torch.zeros_like(pair.specular),
            specular_variance=torch.zeros_like(pair.specular),
            reference_diffuse=pair.reference_diffuse + pair.reference_specular,
            reference_specular=torch.zeros_like(pair.reference_specular),
        )
    if without_depth:
        nothing = torch.zeros_like(pair.depth)
        pair = replace(pair, depth=nothing, depth_variance=nothing)
    if without_variance:
        spatial = {
            f"{name}_variance": spatial_variance(getattr(pair, name)[None])[0]
            for name in ("diffuse", "specular", "albedo", "normal", "depth")
        }
        for name in ("albedo_variance", "normal_variance"):
            spatial[name] = spatial[name].mean(0, keepdim=True)
        pair = replace(pair, **spatial)
    result = as_rendered(pair)
    if not without_albedo:
        return result
    ones, nothing = torch.ones_like(pair.albedo), torch.zeros_like(pair.albedo)
    buffers = replace(result.buffers, albedo=nothing, albedo_variance=nothing[:1], demodulation=ones)
    return replace(result, buffers=buffers, reference_demodulation=ones)
