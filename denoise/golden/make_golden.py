"""Golden values of the metrics' tests: `python make_golden.py` with scikit-image 0.26.0 and flip-evaluator 1.7.

The images are formulas, the same as `golden_pair` in `denoise/src/metrics/mod.rs`; linear Rec. 709, some of it
outside [0, 1].
"""

import flip_evaluator
import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity


def golden_pair(height, width):
    """Reference and test image, float32 [height, width, 3]."""
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    wave = 0.5 + 0.5 * np.sin(0.3 * (c + 1) * x + 0.2 * y)
    tile = ((x // 5 + y // 7) % 2) * (0.1 + 0.15 * c)
    reference = (0.8 * wave * wave + tile).astype(np.float32)
    noise = ((73 * x + 151 * y + 57 * c + 3 * x * y) % 101) / 101.0 - 0.5
    image = (reference.astype(np.float64) + 0.3 * noise).astype(np.float32)
    return reference, image


def display(linear):
    """sRGB values of linear light, clamped to [0, 1]."""
    v = np.clip(linear.astype(np.float64), 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


for height, width in [(32, 40), (11, 11)]:
    r, t = golden_pair(height, width)
    relative_l2 = np.mean((t.astype(np.float64) - r) ** 2 / (r.astype(np.float64) ** 2 + 0.01))
    ssim = structural_similarity(
        display(r),
        display(t),
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1,
    )
    psnr = peak_signal_noise_ratio(display(r), display(t), data_range=1)
    clamp = [np.ascontiguousarray(np.clip(v, 0, 1)) for v in (r, t)]
    flip_map, flip, _ = flip_evaluator.evaluate(*clamp, "LDR", inputsRGB=False, applyMagma=False, parameters={"ppd": 67})
    exact = flip_map.astype(np.float64).mean()
    print(f"{height}x{width}: relative_l2 {relative_l2:.12f} 1-ssim {1 - ssim:.12f} psnr {psnr:.12f} flip {flip:.9f} {exact:.9f}")
    print(f"   flip map corner {flip_map[0, 0, 0]:.7f} middle {flip_map[height // 2, width // 2, 0]:.7f}")
