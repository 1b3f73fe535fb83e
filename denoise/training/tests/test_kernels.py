"""The kernels: convex combinations, from whatever logits, with the gradients that finite differences find."""

import numpy as np
import pytest
import torch

from quietlight_training.kernels import LEVEL_LOGITS, LEVELS, apply_kernel, apply_pyramid, down, halved

SIZES = [(16, 16), (11, 13), (5, 3), (1, 1)]
CENTRE = 12


def padded(size: int) -> int:
    return -(-size // 16) * 16


def random_levels(height: int, width: int, scale: float = 3.0, batch: int = 1) -> list[torch.Tensor]:
    """Logits of the five levels for an image that a network has got padded to multiples of 16."""
    channels = (*[LEVEL_LOGITS] * (LEVELS - 1), 25)
    return [
        scale * torch.randn(batch, count, padded(height) >> level, padded(width) >> level, dtype=torch.float64)
        for level, count in enumerate(channels)
    ]


def taps(image: np.ndarray, y: int, x: int, side: int):
    """Offsets of a kernel's taps that lie inside, with what they see."""
    for tap in range(side * side):
        row, column = y + tap // side - side // 2, x + tap % side - side // 2
        if 0 <= row < image.shape[1] and 0 <= column < image.shape[2]:
            yield tap, image[:, row, column]


def naive_pyramid(levels: list[np.ndarray], image: np.ndarray) -> np.ndarray:
    """The definition, pixel by pixel."""
    images = [image]
    for logits in levels[:-1]:
        fine = images[-1]
        _, height, width = fine.shape
        coarse = np.zeros((3, halved(height), halved(width)))
        for y in range(coarse.shape[1]):
            for x in range(coarse.shape[2]):
                cell = [(2 * y + dy, 2 * x + dx) for dy in (0, 1) for dx in (0, 1)]
                inside = [(v, u) for v, u in cell if v < height and u < width]
                weights = np.array([np.exp(logits[34, v, u]) for v, u in inside])
                coarse[:, y, x] = sum(
                    w * fine[:, v, u] for w, (v, u) in zip(weights / weights.sum(), inside, strict=True)
                )
        images.append(coarse)
    result = None
    for logits, fine in zip(levels[::-1], images[::-1], strict=True):
        combined = np.zeros_like(fine)
        for y in range(fine.shape[1]):
            for x in range(fine.shape[2]):
                seen = [(logits[tap, y, x], value) for tap, value in taps(fine, y, x, 5)]
                if result is not None:
                    seen += [(logits[25 + tap, y, x], value) for tap, value in taps(result, y // 2, x // 2, 3)]
                weights = np.exp([logit for logit, _ in seen])
                combined[:, y, x] = sum(w * v for w, (_, v) in zip(weights / weights.sum(), seen, strict=True))
        result = combined
    return result


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_the_pyramid_equals_its_definition(height, width):
    image = torch.rand(1, 3, height, width, dtype=torch.float64)
    levels = random_levels(height, width)
    expected = naive_pyramid([level[0].numpy() for level in levels], image[0].numpy())
    np.testing.assert_allclose(apply_pyramid(levels, image)[0], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("height", "width"), SIZES)
@pytest.mark.parametrize("size", [3, 5, 21])
def test_a_kernel_equals_its_definition(height, width, size):
    image = torch.rand(1, 3, height, width, dtype=torch.float64)
    logits = 3 * torch.randn(1, size * size, height, width, dtype=torch.float64)
    result = apply_kernel(logits, image, size)[0].numpy()
    for y in range(height):
        for x in range(width):
            seen = list(taps(image[0].numpy(), y, x, size))
            weights = np.exp([logits[0, tap, y, x].item() for tap, _ in seen])
            expected = sum(w * v for w, (_, v) in zip(weights / weights.sum(), seen, strict=True))
            np.testing.assert_allclose(result[:, y, x], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("height", "width"), SIZES)
@pytest.mark.parametrize("extreme", [0.0, 1.0, 1e4, -1e4])
def test_softmax_rows_sum_to_one_everywhere(height, width, extreme):
    # A constant comes out as itself only if the weights of every pixel sum to 1, borders included, on every level.
    levels = [
        level * extreme if abs(extreme) <= 1 else level.sign() * extreme for level in random_levels(height, width)
    ]
    image = torch.full((1, 3, height, width), 0.7, dtype=torch.float64)
    result = apply_pyramid(levels, image)
    torch.testing.assert_close(result, image, rtol=0, atol=1e-14)


def test_single_kernels_sum_to_one_at_extreme_logits():
    image = torch.full((1, 1, 6, 7), 2.0, dtype=torch.float64)
    for logits in (
        torch.randn(1, 25, 6, 7, dtype=torch.float64).sign() * 1e4,
        torch.full((1, 25, 6, 7), -1e4).double(),
    ):
        torch.testing.assert_close(apply_kernel(logits, image, 5), image, rtol=0, atol=1e-14)


def test_one_hot_centre_logits_are_the_identity():
    image = torch.rand(1, 3, 11, 13, dtype=torch.float64)
    levels = random_levels(11, 13)
    levels[0][:, CENTRE] = 1e4
    torch.testing.assert_close(apply_pyramid(levels, image), image, rtol=0, atol=0)
    logits = torch.zeros(1, 25, 11, 13, dtype=torch.float64)
    logits[:, CENTRE] = 1e4
    torch.testing.assert_close(apply_kernel(logits, image, 5), image, rtol=0, atol=0)


def test_equal_logits_are_the_mean_of_the_neighbours_inside():
    image = torch.rand(1, 2, 6, 7, dtype=torch.float64)
    result = apply_kernel(torch.zeros(1, 25, 6, 7, dtype=torch.float64), image, 5)
    for y, x in ((0, 0), (0, 3), (3, 3), (5, 6)):
        window = image[0, :, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
        torch.testing.assert_close(result[0, :, y, x], window.mean((1, 2)), rtol=0, atol=1e-15)


def test_the_result_is_within_the_range_of_the_image():
    image = torch.rand(2, 3, 11, 13, dtype=torch.float64) ** 8 * 1000
    result = apply_pyramid(random_levels(11, 13, batch=2), image)
    assert (result >= image.amin((2, 3), keepdim=True)).all()
    assert (result <= image.amax((2, 3), keepdim=True)).all()
    assert not torch.allclose(result, image)


def test_pixels_outside_an_odd_image_have_no_weight_in_the_coarser_level():
    image = torch.arange(15.0, dtype=torch.float64).view(1, 1, 3, 5)
    coarse = down(torch.zeros(1, 1, 16, 16, dtype=torch.float64), image)
    expected = torch.tensor([[3.0, 5.0, 6.5], [10.5, 12.5, 14.0]], dtype=torch.float64)
    torch.testing.assert_close(coarse[0, 0], expected)


@pytest.mark.parametrize(("height", "width", "fast"), [(3, 5, False), (11, 13, True)])
def test_the_gradients_of_the_pyramid_are_those_of_finite_differences(height, width, fast):
    # The full Jacobian of a tiny image (no more padding than is read), random projections of that of a larger one.
    sizes = [(height, width)]
    for _ in range(LEVELS - 1):
        sizes.append(tuple(map(halved, sizes[-1])))
    levels = [
        level[..., : 2 * halved(rows), : 2 * halved(columns)].clone().requires_grad_()
        for level, (rows, columns) in zip(random_levels(height, width, scale=1.0), sizes, strict=True)
    ]
    image = torch.rand(1, 1, height, width, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(
        lambda image, *levels: apply_pyramid(list(levels), image), (image, *levels), fast_mode=fast
    )


def test_the_gradients_of_a_kernel_are_those_of_finite_differences():
    logits = torch.randn(1, 49, 4, 5, dtype=torch.float64, requires_grad=True)
    image = torch.rand(1, 3, 4, 5, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda logits, image: apply_kernel(logits, image, 7), (logits, image))


def test_channels_last_logits_give_the_same():
    image = torch.rand(1, 3, 16, 16, dtype=torch.float64)
    levels = random_levels(16, 16)
    other = [level.contiguous(memory_format=torch.channels_last) for level in levels]
    torch.testing.assert_close(apply_pyramid(other, image), apply_pyramid(levels, image), rtol=0, atol=0)
