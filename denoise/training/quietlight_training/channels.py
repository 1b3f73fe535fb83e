"""The input channels of the networks: the one table on this side, proven equal to Rust's by the fixtures.

Gradients are backward differences, `f[x] − f[x−1]`, 0 in the first column or row; they are computed on the full image,
before any padding or cutting into tiles. Every function returns `[batch, channels, height, width]` in the order of its
table.
"""

import torch
from torch import Tensor

from quietlight_training.transforms import EPSILON, Buffers, log_specular

# Of the kernel pyramid, for either branch; `l = ln(1 + max(s, 0))` of the branch's signal s.
PYRAMID_CHANNELS = (
    "log.R", "log.G", "log.B",
    "log.dx.R", "log.dx.G", "log.dx.B",
    "log.dy.R", "log.dy.G", "log.dy.B",
    "log.deviation", "log.deviation.log",
    "normal.X", "normal.Y", "normal.Z", "normal.deviation",
    "albedo.R", "albedo.G", "albedo.B", "albedo.deviation",
    "depth.log.dx", "depth.log.dy", "depth.deviation",
)  # fmt: skip

# Of the kernel-predicting network of Bako et al. 2017 (METHODS 10.2), for either branch.
KERNEL_CHANNELS = (
    "signal.R", "signal.G", "signal.B",
    "signal.dx.R", "signal.dx.G", "signal.dx.B",
    "signal.dy.R", "signal.dy.G", "signal.dy.B",
    "signal.variance",
    "normal.dx.X", "normal.dx.Y", "normal.dx.Z",
    "normal.dy.X", "normal.dy.Y", "normal.dy.Z",
    "normal.variance",
    "albedo.dx.R", "albedo.dx.G", "albedo.dx.B",
    "albedo.dy.R", "albedo.dy.G", "albedo.dy.B",
    "albedo.variance",
    "depth.dx", "depth.dy",
    "depth.variance",
)  # fmt: skip

# A deviation of ln(1 + s) of 10 already says "nothing is known".
LARGEST_LOG_DEVIATION = 10.0
# Normals and albedos lie within a range of 1; so do relative depths that mean something.
LARGEST_FEATURE_DEVIATION = 1.0
# A step of ln(depth) of 2 is a factor of 7: an edge, however far behind the background lies.
LARGEST_DEPTH_STEP = 2.0
# Variances of the paper's channels are fed as they are; this keeps a firefly from overflowing the first layer.
LARGEST_VARIANCE = 1e4


def backward_x(image: Tensor) -> Tensor:
    """`f[x] − f[x−1]` along the rows, 0 in the first column."""
    result = torch.zeros_like(image)
    torch.sub(image[..., 1:], image[..., :-1], out=result[..., 1:])
    return result


def backward_y(image: Tensor) -> Tensor:
    """`f[y] − f[y−1]` along the columns, 0 in the first row."""
    result = torch.zeros_like(image)
    torch.sub(image[..., 1:, :], image[..., :-1, :], out=result[..., 1:, :])
    return result


def deviation(variance: Tensor, largest: float) -> Tensor:
    """Standard deviation of the mean over the channels of a variance, at most `largest`; one channel."""
    return variance.mean(1, keepdim=True).sqrt().clamp_max(largest)


def log_depth_gradients(depth: Tensor) -> tuple[Tensor, Tensor]:
    """Backward differences of ln(depth) in x and y, 0 where either depth is unknown (≤ 0 or not finite)."""
    known = (depth > 0) & torch.isfinite(depth)
    logarithm = torch.where(known, depth, torch.ones_like(depth)).log()
    gradients = []
    for difference, axis in ((backward_x, -1), (backward_y, -2)):
        both = known & known.roll(1, axis)
        step = difference(logarithm).clamp(-LARGEST_DEPTH_STEP, LARGEST_DEPTH_STEP)
        gradients.append(torch.where(both, step, torch.zeros_like(step)))
    return gradients[0], gradients[1]


def pyramid_features(buffers: Buffers) -> Tensor:
    """The last 11 of the [`PYRAMID_CHANNELS`], which both branches share."""
    depth = buffers.depth
    known = (depth > 0) & torch.isfinite(depth)
    relative = buffers.depth_variance.sqrt() / torch.where(known, depth, torch.ones_like(depth))
    relative = torch.where(known, relative, torch.zeros_like(relative))
    return torch.cat(
        (
            buffers.normal,
            deviation(buffers.normal_variance, LARGEST_FEATURE_DEVIATION),
            buffers.albedo,
            deviation(buffers.albedo_variance, LARGEST_FEATURE_DEVIATION),
            *log_depth_gradients(depth),
            relative.clamp_max(LARGEST_FEATURE_DEVIATION),
        ),
        1,
    )


def pyramid_channels(signal: Tensor, variance: Tensor, features: Tensor) -> Tensor:
    """The [`PYRAMID_CHANNELS`] of a branch from its signal, the signal's variance and the shared features."""
    logarithm, log_variance = log_specular(signal, variance)
    noise = deviation(log_variance, LARGEST_LOG_DEVIATION)
    return torch.cat(
        (
            logarithm,
            backward_x(logarithm),
            backward_y(logarithm),
            noise,
            ((noise.square() + 1e-8).log() + 9) / 9,
            features,
        ),
        1,
    )


def kernel_channels(buffers: Buffers) -> tuple[Tensor, Tensor]:
    """The [`KERNEL_CHANNELS`] of the diffuse and of the specular branch. The first three are the branch's signal."""
    farthest = torch.where(torch.isfinite(buffers.depth), buffers.depth, 0).amax((2, 3), keepdim=True)
    farthest = torch.where(farthest > 0, farthest, torch.ones_like(farthest))
    features = torch.cat(
        (
            *_gradients_and_variance(buffers.normal, buffers.normal_variance),
            *_gradients_and_variance(buffers.albedo, buffers.albedo_variance),
            *_gradients_and_variance(buffers.depth / farthest, buffers.depth_variance / farthest.square()),
        ),
        1,
    )
    factor = 1 / (buffers.demodulation + EPSILON)
    diffuse = (buffers.diffuse * factor, buffers.diffuse_variance * factor.square())
    specular = log_specular(buffers.specular, buffers.specular_variance)
    branches = (torch.cat((signal, *_gradients_and_variance(signal, v), features), 1) for signal, v in (diffuse, specular))
    return next(branches), next(branches)


def _gradients_and_variance(image: Tensor, variance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    mean = variance.mean(1, keepdim=True).clamp_max(LARGEST_VARIANCE)
    return backward_x(image), backward_y(image), mean
