#!/usr/bin/env python3
"""Writes `denoise/tests/fixtures`: what Rust and Python must both compute from the same numbers.

    layers.json     a small layered image with the extremes that matter: no albedo, unknown depth, black, very bright
    pyramid.json    its network inputs, random logits of the five levels, and the radiance that these make of it
    kernel.json     the same for the network of Bako et al. 2017, with kernels of 5×5
    kpcn-unit-BRANCH.onnx, kpcn-unit-kernel-BRANCH.onnx
                    tiny networks of both kinds with random weights
    networks.json   the radiance that these make of the layered image, from torch in float32

Arrays are flat, planar and row-major. The inputs are exact in float32; everything else is computed in float64.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from quietlight_training import channels, kernels, onnx_model, transforms
from quietlight_training.config import NetworkConfig
from quietlight_training.denoiser import BRANCHES, Denoiser
from quietlight_training.examples import write_text
from quietlight_training.network import SIZE_MULTIPLE
from quietlight_training.transforms import Buffers

FIXTURES = Path(__file__).resolve().parent.parent / "tests" / "fixtures"
# Levels of 13, 7, 4, 2, 1 by 11, 6, 3, 2, 1.
WIDTH, HEIGHT = 13, 11
KERNEL_SIZE = 5
NETWORKS = {
    "unit": NetworkConfig("kernel_pyramid", widths=(4, 4, 4, 4)),
    "unit-kernel": NetworkConfig("kernel", depth=3, width=6, filter_size=3, taps=KERNEL_SIZE),
}
# Random heads predict nearly equal logits; times this they have a standard deviation of about 1.
LOGIT_SCALE = 4.0
SEED = 20170720


def random_layers(generator: np.random.Generator) -> dict[str, dict[str, np.ndarray]]:
    """Means and variances `[channels, height, width]` by layer; `noisy` is diffuse + specular."""

    def rounded(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32).round(4)

    def image(count: int) -> np.ndarray:
        return generator.random((count, HEIGHT, WIDTH))

    layers = {
        "diffuse": (image(3) ** 2, 0.1 * image(3) ** 3),
        "specular": (0.3 * image(3) ** 6, 0.05 * image(3) ** 3),
        "albedo": (image(3), 0.02 * image(3) ** 2),
        "normal": (image(3) * 2 - 1, 0.1 * image(3) ** 2),
        "depth": (1 + image(1), 0.1 * image(1) ** 2),
    }
    layers = {name: {"mean": rounded(mean), "variance": rounded(var)} for name, (mean, var) in layers.items()}
    layers["albedo"]["mean"][:, 2, 3:6] = 0
    layers["diffuse"]["mean"][:, 2, 3:6] = 0
    layers["depth"]["mean"][:, :3, :2] = 0
    layers["depth"]["variance"][:, :3, :2] = 0
    layers["depth"]["mean"][:, 7:, 6:] += 100
    layers["specular"]["mean"][:, 8, 4] = (900, 1200, 0)
    layers["specular"]["variance"][:, 8, 4] = (1e5, 2e6, 0)
    layers["specular"]["mean"][1, 1, 1] = -0.25
    layers["diffuse"]["variance"][:, 5] = 0
    layers["specular"]["variance"][:, 5] = 0
    return layers


def buffers_of(layers: dict[str, dict[str, np.ndarray]]) -> Buffers:
    """The layers as a batch of one, float64."""
    tensors = {}
    for name, layer in layers.items():
        tensors[name] = torch.from_numpy(layer["mean"]).double()[None]
        tensors[f"{name}_variance"] = torch.from_numpy(layer["variance"]).double()[None]
    return Buffers(**tensors, demodulation=tensors["albedo"])


def numbers(values: Tensor | np.ndarray) -> list[float]:
    """All values with the eight digits that a float32 needs at most, and one more."""
    return [float(f"{value:.9g}") for value in np.asarray(values, dtype=np.float64).ravel()]


def random_logits(generator: np.random.Generator, *shape: int) -> Tensor:
    """Logits of standard deviation 2 in steps of 1/8, which are exact and short."""
    return torch.from_numpy((generator.standard_normal(shape) * 16).round() / 8)


def pyramid_fixture(buffers: Buffers, generator: np.random.Generator) -> dict:
    """Network inputs, logits and results of the kernel pyramid."""
    scale = transforms.exposure(buffers.beauty)
    features = channels.pyramid_features(buffers)
    padded = [-(-size // SIZE_MULTIPLE) * SIZE_MULTIPLE for size in (HEIGHT, WIDTH)]
    fixture: dict = {"epsilon": transforms.EPSILON, "exposure": scale.item(), "channels": channels.PYRAMID_CHANNELS}
    signals = {
        "diffuse": transforms.demodulate(buffers, scale),
        "specular": (buffers.specular * scale, buffers.specular_variance * scale.square()),
    }
    results = {}
    for branch, (signal, variance) in signals.items():
        levels = [
            random_logits(generator, 1, *shape)
            for shape in (
                (4 * kernels.LEVEL_LOGITS, padded[0] // 2, padded[1] // 2),
                (kernels.LEVEL_LOGITS, padded[0] // 2, padded[1] // 2),
                (kernels.LEVEL_LOGITS, padded[0] // 4, padded[1] // 4),
                (kernels.LEVEL_LOGITS, padded[0] // 8, padded[1] // 8),
                (kernels.FINE_TAPS, padded[0] // 16, padded[1] // 16),
            )
        ]
        results[branch] = kernels.apply_pyramid([functional.pixel_shuffle(levels[0], 2), *levels[1:]], signal)
        fixture[branch] = {
            "signal": numbers(signal),
            "input": numbers(channels.pyramid_channels(signal, variance, features)),
            "level_shapes": [list(level.shape) for level in levels],
            **{f"level{level}": numbers(logits) for level, logits in enumerate(levels)},
            "result": numbers(results[branch]),
        }
    fixture["radiance"] = numbers(
        transforms.modulate(results["diffuse"], buffers.demodulation, scale) + results["specular"] / scale
    )
    return fixture


def kernel_fixture(buffers: Buffers, generator: np.random.Generator) -> dict:
    """Network inputs, logits and results of the network of Bako et al. 2017."""
    fixture: dict = {"epsilon": transforms.EPSILON, "channels": channels.KERNEL_CHANNELS, "kernel_size": KERNEL_SIZE}
    results = {}
    for branch, inputs in zip(("diffuse", "specular"), channels.kernel_channels(buffers), strict=True):
        logits = random_logits(generator, 1, KERNEL_SIZE**2, HEIGHT, WIDTH)
        results[branch] = kernels.apply_kernel(logits, inputs[:, :3], KERNEL_SIZE)
        fixture[branch] = {
            "input": numbers(inputs),
            "logits": numbers(logits),
            "result": numbers(results[branch]),
        }
    radiance = results["diffuse"] * (buffers.demodulation + transforms.EPSILON)
    fixture["radiance"] = numbers(radiance + transforms.exp_specular(results["specular"]))
    return fixture


def network_fixture(buffers: Buffers, tier: str, config: NetworkConfig, output: Path) -> list[float]:
    """Writes the weight files of random networks; returns the radiance they make of the buffers."""
    torch.manual_seed(SEED)
    denoiser = Denoiser(config)
    with torch.no_grad():
        for name, weight in denoiser.named_parameters():
            # Away from the tidy start: biases other than 0, logits that differ.
            weight.add_(0.1 * torch.randn_like(weight))
            if "heads" in name and "weight" in name:
                weight.mul_(LOGIT_SCALE)
    onnx_model.round_weights(denoiser)
    for branch in BRANCHES:
        model = onnx_model.to_onnx(getattr(denoiser, branch), config, tier, branch)
        onnx_model.halve_weights(model)
        (output / f"kpcn-{tier}-{branch}.onnx").write_bytes(model.SerializeToString())
    single = buffers.map(lambda tensor: tensor.float())
    with torch.no_grad():
        return numbers(denoiser(single, transforms.exposure(single.beauty)).radiance)


def write(output: Path) -> None:
    """Writes all fixtures into a folder."""
    output.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(SEED)
    layers = random_layers(generator)
    buffers = buffers_of(layers)
    fixtures = {
        "layers": {
            "width": WIDTH,
            "height": HEIGHT,
            "layers": {
                name: {role: numbers(values) for role, values in layer.items()} for name, layer in layers.items()
            },
        },
        "pyramid": pyramid_fixture(buffers, generator),
        "kernel": kernel_fixture(buffers, generator),
        "networks": {tier: network_fixture(buffers, tier, config, output) for tier, config in NETWORKS.items()},
    }
    for name, fixture in fixtures.items():
        write_text(output / f"{name}.json", json.dumps(fixture, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=FIXTURES, help=f"folder (default {FIXTURES})")
    write(parser.parse_args().output)
