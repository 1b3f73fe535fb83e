"""The cross-bilateral filter at single pixels, with its gradients in closed form (METHODS 9.6 and 9.7).

    d = λ₀ ‖p_j − p_i‖² + λ_c Σ (c_j − c_i)² / (1e-10 + σ²_j + σ²_i) + Σ_k λ_k Σ (f_j − f_i)² / max(1e-4, σ²_f,i)
    ĉ_i = Σ e^−d c_j / Σ e^−d

(Kalantari, Bako and Sen 2015, equations 10 to 12). The multipliers are `[pixels, 7]`: λ₀ to λ₅ and λ_c.
"""

import torch
from torch import Tensor

RADIUS = 27
COLOUR_EPSILON = 1e-10
FEATURE_FLOOR = 1e-4
# Channels of the five feature groups: position, normal, albedo, texture2, visibility.
GROUPS = (3, 3, 3, 3, 1)
MULTIPLIERS = 7
# Distances are cut here, so that a weight of 0 times one of them is 0.
LARGEST_DISTANCE = 1e30


class Filter(torch.autograd.Function):
    """Filtered colours of some pixels from the distances of their windows.

    `multipliers` `[pixels, 7]`, `distances` `[pixels, 7, taps]` (λ₀'s, λ₁'s to λ₅'s, the colour's), `colours`
    `[pixels, taps, 3]`; returns `[pixels, 3]`. One pass over the taps gives all sums that the gradient needs:

        ∂ĉ_q/∂λ_m = −(Σ d Δ_m c_q − ĉ_q Σ d Δ_m) / Σ d
    """

    @staticmethod
    def forward(ctx, multipliers: Tensor, distances: Tensor, colours: Tensor) -> Tensor:
        weights = torch.bmm(multipliers.unsqueeze(1), distances).squeeze(1).neg_().exp_()
        total = weights.sum(1, keepdim=True)
        weighted = torch.cat((weights.unsqueeze(2) * colours, weights.unsqueeze(2)), 2)
        filtered = weighted[:, :, :3].sum(1) / total
        sums = torch.bmm(distances, weighted)
        gradient = (filtered.unsqueeze(1) * sums[:, :, 3:] - sums[:, :, :3]) / total.unsqueeze(2)
        ctx.save_for_backward(gradient)
        return filtered

    @staticmethod
    def backward(ctx, upstream: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return torch.bmm(gradient, upstream.unsqueeze(2)).squeeze(2), None, None


def windows(planes: Tensor, rows: Tensor, columns: Tensor, radius: int = RADIUS) -> tuple[Tensor, Tensor]:
    """Distances `[pixels, 7, taps]` and colours `[pixels, taps, 3]` of the windows around some pixels.

    `planes` `[32, height, width]`: colour, its variance, and mean and variance of each feature group in turn. Taps
    outside the picture are infinitely far in effect.
    """
    height, width = planes.shape[1:]
    offsets = torch.arange(-radius, radius + 1)
    dy, dx = (grid.reshape(-1) for grid in torch.meshgrid(offsets, offsets, indexing="ij"))
    y, x = rows.unsqueeze(1) + dy, columns.unsqueeze(1) + dx
    outside = (y < 0) | (y >= height) | (x < 0) | (x >= width)
    taps = y.clamp(0, height - 1) * width + x.clamp(0, width - 1)
    flat = planes.reshape(planes.shape[0], -1).t().contiguous()
    near, centre = flat[taps], flat[rows * width + columns].unsqueeze(1)

    distances = near.new_empty(len(rows), MULTIPLIERS, len(dy))
    distances[:, 0] = (dy.square() + dx.square()).to(near.dtype)
    first = 6
    for index, count in enumerate(GROUPS):
        mean, variance = slice(first, first + count), slice(first + count, first + 2 * count)
        scale = 1 / centre[..., variance].clamp_min(FEATURE_FLOOR)
        distances[:, 1 + index] = ((near[..., mean] - centre[..., mean]).square() * scale).sum(2)
        first += 2 * count
    variance = COLOUR_EPSILON + near[..., 3:6] + centre[..., 3:6]
    distances[:, 6] = ((near[..., :3] - centre[..., :3]).square() / variance).sum(2)
    distances[:, 0].masked_fill_(outside, LARGEST_DISTANCE)
    return distances.clamp_max_(LARGEST_DISTANCE), near[..., :3].contiguous()


def relative_error(filtered: Tensor, reference: Tensor, weight: Tensor) -> Tensor:
    """`w/2 Σ_q (ĉ_q − c_q)² / (c_q² + 0.01)` of each pixel (METHODS 9.7, where w is the number of samples)."""
    return 0.5 * weight * ((filtered - reference).square() / (reference.square() + 0.01)).sum(1)
