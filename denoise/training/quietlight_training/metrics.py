"""The two figures that judge a denoiser, as `denoise/src/metrics` defines them, one value per image of a batch."""

import torch
from torch import Tensor
from torch.nn import functional

RELATIVE_L2_EPSILON = 0.01
# Of the Gaussian window of SSIM (Wang et al. 2004): 11×11, σ = 1.5; K1, K2 for a range of 1.
SSIM_RADIUS = 5
SSIM_SIGMA = 1.5
SSIM_C1 = 0.01**2
SSIM_C2 = 0.03**2


def relative_l2(image: Tensor, reference: Tensor) -> Tensor:
    """Mean over pixels and channels of `(x − r)²/(r² + 0.01)`, in float64, `[batch]`."""
    image, reference = image.double(), reference.double()
    return ((image - reference).square() / (reference.square() + RELATIVE_L2_EPSILON)).mean((1, 2, 3))


def srgb(radiance: Tensor) -> Tensor:
    """What is shown of linear radiance: clamped to [0, 1], with the sRGB transfer curve (IEC 61966-2-1)."""
    shown = radiance.clamp(0, 1)
    # The curve's power has no gradient at 0; the branch for small values does not use it.
    power = 1.055 * shown.clamp_min(0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(shown <= 0.0031308, 12.92 * shown, power)


def dissimilarity(shown: Tensor, reference_shown: Tensor) -> Tensor:
    """1 − SSIM of two pictures with values in [0, 1]: the mean over channels and the region 5 pixels inside, `[batch]`.

    A picture smaller than the window gives one value from the mean over all of it.
    """
    window = torch.arange(-SSIM_RADIUS, SSIM_RADIUS + 1, dtype=shown.dtype, device=shown.device)
    window = (-0.5 * (window / SSIM_SIGMA).square()).exp()
    window = window / window.sum()
    channels = shown.shape[1]
    products = (shown, reference_shown, shown.square(), reference_shown.square(), shown * reference_shown)
    stacked = torch.cat(products, 1)
    if min(shown.shape[-2:]) < window.numel():
        means = stacked.mean((2, 3), keepdim=True)
    else:
        count = stacked.shape[1]
        rows = functional.conv2d(stacked, window.view(1, 1, 1, -1).expand(count, 1, 1, -1), groups=count)
        means = functional.conv2d(rows, window.view(1, 1, -1, 1).expand(count, 1, -1, 1), groups=count)
    x, y, xx, yy, xy = means.split(channels, 1)
    numerator = (2 * x * y + SSIM_C1) * (2 * (xy - x * y) + SSIM_C2)
    denominator = (x.square() + y.square() + SSIM_C1) * (xx - x.square() + yy - y.square() + SSIM_C2)
    return 1 - (numerator / denominator).mean((1, 2, 3))
