"""Applying predicted kernels: every output pixel is a convex combination of input pixels.

Two kinds. A single kernel of `size`×`size` taps (Bako et al. 2017), and a pyramid of five levels whose kernels and
whose partition among the levels are softmaxes, so that the combination stays convex over all of them (the multi-scale
reconstruction of Vogels et al. 2018 can overshoot; EVIDENCE 6). Gradients are in closed form (METHODS 10.3):

    o = Σ_k w_k v_k, w = softmax(z):   ∂ℓ/∂z_k = w_k · (g·v_k − g·o),   ∂ℓ/∂v_k += w_k · g

A tap outside the image has the logit −∞, hence no weight.
"""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional

# Levels of the pyramid; level l has 2^−l of the resolution.
LEVELS = 5
# Taps of a pixel on its own level: 5×5, row-major, dy from −2 to 2, then dx.
FINE_TAPS = 25
# Taps of a pixel on the next coarser level: 3×3 around ⌊p/2⌋, row-major.
COARSE_TAPS = 9
# Logits of a pixel on every level but the coarsest: the taps, and its weight in the next coarser level's pixel.
LEVEL_LOGITS = FINE_TAPS + COARSE_TAPS + 1


def halved(size: int) -> int:
    """Pixels of the next coarser level, which a last odd pixel has for its own."""
    return (size + 1) // 2


class _Combine(torch.autograd.Function):
    """`o = Σ softmax(logits)·taps`: taps on the image itself and, where there is one, on a coarser image.

    `logits` `[batch, taps, H, W]` with −∞ outside, `image` `[batch, C, H, W]`, `coarse` `[batch, C, H/2, W/2]` or None.
    """

    @staticmethod
    def forward(context, logits: Tensor, image: Tensor, coarse: Tensor | None, size: int) -> Tensor:
        weights = logits.softmax(1)
        height, width = image.shape[-2:]
        padded = functional.pad(image, [size // 2] * 4)
        result = torch.zeros_like(image)
        for tap in range(size * size):
            result.addcmul_(weights[:, tap, None], _window(padded, tap, size, 1, height, width))
        upsampled = None
        if coarse is not None:
            # Nearest-upsampled, the neighbours ⌊p/2⌋ + d of all pixels p are one window shifted by 2d.
            upsampled = _upsample(functional.pad(coarse, [1] * 4))
            for tap in range(COARSE_TAPS):
                window = _window(upsampled, tap, 3, 2, height, width)
                result.addcmul_(weights[:, size * size + tap, None], window)
        context.size = size
        context.save_for_backward(weights, padded, upsampled, result)
        return result

    @staticmethod
    def backward(context, gradient: Tensor):
        weights, padded, upsampled, result = context.saved_tensors
        size = context.size
        height, width = result.shape[-2:]
        needs_logits, needs_image, needs_coarse, _ = context.needs_input_grad
        along_result = (gradient * result).sum(1)
        planes = gradient.unbind(1)
        to_logits = torch.empty_like(weights) if needs_logits else None
        to_padded = torch.zeros_like(padded) if needs_image else None
        to_upsampled = torch.zeros_like(upsampled) if needs_coarse else None
        sources = [(padded, to_padded, tap, size, 1) for tap in range(size * size)]
        if upsampled is not None:
            sources += [(upsampled, to_upsampled, tap, 3, 2) for tap in range(COARSE_TAPS)]
        for index, (source, to_source, tap, side, step) in enumerate(sources):
            if needs_logits:
                window = _window(source, tap, side, step, height, width)
                along = torch.mul(planes[0], window[:, 0], out=to_logits[:, index])
                for plane, values in zip(planes[1:], window.unbind(1)[1:], strict=True):
                    along.addcmul_(plane, values)
                along.sub_(along_result).mul_(weights[:, index])
            if to_source is not None:
                _window(to_source, tap, side, step, height, width).addcmul_(weights[:, index, None], gradient)
        radius = size // 2
        to_image = to_padded[..., radius : radius + height, radius : radius + width] if needs_image else None
        to_coarse = None
        if needs_coarse:
            to_coarse = 4 * functional.avg_pool2d(to_upsampled, 2)[..., 1:-1, 1:-1]
        return to_logits, to_image, to_coarse, None


def _window(image: Tensor, tap: int, side: int, step: int, height: int, width: int) -> Tensor:
    """What tap number `tap` of `side`×`side` sees from every pixel, of an image padded by its radius."""
    y, x = step * (tap // side), step * (tap % side)
    return image[..., y : y + height, x : x + width]


def _planar(logits: Tensor) -> Tensor:
    # A channels-last network hands its logits over pixel by pixel; the loops above run over planes.
    return logits.contiguous(memory_format=torch.contiguous_format)


def _upsample(image: Tensor) -> Tensor:
    return image.repeat_interleave(2, -1).repeat_interleave(2, -2)


@lru_cache(maxsize=64)
def _outside(size: int, side: int, stride: int, padded: int) -> Tensor:
    """Whether tap offset `d` (of `side`) from pixel `⌊p/stride⌋` leaves `[0, size)`: `[side, padded]`."""
    pixel = torch.arange(padded) // stride
    place = pixel[None, :] + (torch.arange(side) - side // 2)[:, None]
    return (place < 0) | (place >= size)


@lru_cache(maxsize=64)
def _barrier(height: int, width: int, side: int, has_coarse: bool, padded: tuple[int, int]) -> Tensor:
    """0 for taps inside the image and −∞ outside, `[1, taps, *padded]`; padding pixels have 0 everywhere."""

    def grid(height: int, width: int, side: int, stride: int) -> Tensor:
        rows = _outside(height, side, stride, padded[0])
        columns = _outside(width, side, stride, padded[1])
        return (rows[:, None, :, None] | columns[None, :, None, :]).reshape(side * side, *padded)

    outside = [grid(height, width, side, 1)]
    if has_coarse:
        outside.append(grid(halved(height), halved(width), 3, 2))
    barrier = torch.zeros(1, side * side + (COARSE_TAPS if has_coarse else 0), *padded)
    barrier.masked_fill_(torch.cat(outside)[None], -torch.inf)
    barrier[..., height:, :] = 0
    barrier[..., width:] = 0
    return barrier


def apply_kernel(logits: Tensor, image: Tensor, size: int) -> Tensor:
    """Filters `image` `[batch, C, h, w]` by one kernel a pixel, `logits` `[batch, size², H ≥ h, W ≥ w]`."""
    height, width = image.shape[-2:]
    barrier = _barrier(height, width, size, False, (height, width)).to(logits)
    return _Combine.apply(_planar(logits[..., :height, :width]) + barrier, image, None, size)


def down(weight_logits: Tensor, image: Tensor) -> Tensor:
    """The next coarser level: the mean of each 2×2 cell weighted by a softmax of its logits.

    `weight_logits` `[batch, 1, H ≥ 2⌈h/2⌉, W ≥ 2⌈w/2⌉]`, `image` `[batch, C, h, w]`. Pixels outside have no weight.
    """
    height, width = image.shape[-2:]
    rows, columns = halved(height), halved(width)
    logits = weight_logits[..., : 2 * rows, : 2 * columns]
    if (height, width) != (2 * rows, 2 * columns):
        barrier = torch.full((2 * rows, 2 * columns), -torch.inf).to(logits)
        barrier[:height, :width] = 0
        logits = logits + barrier
        image = functional.pad(image, (0, 2 * columns - width, 0, 2 * rows - height))
    weights = functional.pixel_unshuffle(logits, 2).softmax(1)
    cells = [(y, x) for y in (0, 1) for x in (0, 1)]
    return sum(weights[:, k, None] * image[..., y::2, x::2] for k, (y, x) in enumerate(cells))


def apply_pyramid(levels: list[Tensor], image: Tensor) -> Tensor:
    """Filters `image` `[batch, C, h, w]` by the logits of the five levels.

    `levels[l]` is `[batch, 35, H_l, W_l]`, the last `[batch, 25, H_4, W_4]`, each at least as large as its level
    rounded up to even; the rest is the padding of the network's input and is not read.
    """
    images = [image]
    for logits in levels[:-1]:
        images.append(down(logits[:, LEVEL_LOGITS - 1 :], images[-1]))
    result = apply_kernel(levels[-1], images[-1], 5)
    for logits, fine in zip(levels[-2::-1], images[-2::-1], strict=True):
        height, width = fine.shape[-2:]
        padded = (2 * halved(height), 2 * halved(width))
        barrier = _barrier(height, width, 5, True, padded).to(logits)
        taps = _planar(logits[:, : FINE_TAPS + COARSE_TAPS, : padded[0], : padded[1]]) + barrier
        even = functional.pad(fine, (0, padded[1] - width, 0, padded[0] - height))
        result = _Combine.apply(taps, even, result, 5)[..., :height, :width]
    return result
