"""A pair of networks, one a branch, and what they make of a batch of buffers."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from quietlight_training import channels, transforms
from quietlight_training.config import NetworkConfig
from quietlight_training.kernels import apply_kernel, apply_pyramid
from quietlight_training.network import SIZE_MULTIPLE, KernelNetwork, PyramidNetwork
from quietlight_training.transforms import Buffers

BRANCHES = ("diffuse", "specular")


@dataclass(frozen=True)
class Denoised:
    """What the networks made of a batch, `[batch, 3, height, width]`."""

    diffuse: Tensor
    """Diffuse signal: irradiance times exposure."""
    specular: Tensor
    """Specular signal: radiance times exposure (`kernel_pyramid`) or its ln(1 + c) (`kernel`)."""
    radiance: Tensor
    """Both put together again."""


class Denoiser(nn.Module):
    """Two networks of equal shape, for the diffuse and for the specular branch, trained together."""

    def __init__(self, config: NetworkConfig, bf16: bool = False):
        super().__init__()
        self.config = config
        self.bf16 = bf16
        self.diffuse = make_network(config)
        self.specular = make_network(config)

    def start_from(self, other: "Denoiser"):
        """Takes the weights of another denoiser, of the same networks or of narrower ones, and computes what it does.
        Raises `ValueError` where they are others.
        """
        if self.config == other.config:
            self.load_state_dict(other.state_dict())
        elif self.config.kind == other.config.kind == "kernel_pyramid":
            for branch in BRANCHES:
                getattr(self, branch).widen(getattr(other, branch))
        else:
            raise ValueError(f"{other.config} cannot become {self.config}")

    def forward(self, buffers: Buffers, scale: Tensor) -> Denoised:
        """Denoises a batch; `scale` is the exposure `[batch, 1, 1, 1]`."""
        if self.config.kind == "kernel_pyramid":
            return self._pyramid(buffers, scale)
        return self._kernel(buffers)

    def _pyramid(self, buffers: Buffers, scale: Tensor) -> Denoised:
        features = channels.pyramid_features(buffers)
        signals = (
            transforms.demodulate(buffers, scale),
            (buffers.specular * scale, buffers.specular_variance * scale.square()),
        )
        results = []
        for network, (signal, variance) in zip((self.diffuse, self.specular), signals, strict=True):
            inputs = _padded(channels.pyramid_channels(signal, variance, features))
            levels = self._logits(network, functional.pixel_unshuffle(inputs, 2))
            levels[0] = functional.pixel_shuffle(levels[0], 2)
            results.append(apply_pyramid(levels, signal))
        diffuse, specular = results
        radiance = transforms.modulate(diffuse, buffers.demodulation, scale) + specular / scale
        return Denoised(diffuse, specular, radiance)

    def _kernel(self, buffers: Buffers) -> Denoised:
        results = []
        for network, inputs in zip((self.diffuse, self.specular), channels.kernel_channels(buffers), strict=True):
            (logits,) = self._logits(network, inputs)
            results.append(apply_kernel(logits, inputs[:, :3], self.config.taps))
        diffuse, specular = results
        radiance = diffuse * (buffers.demodulation + transforms.EPSILON) + transforms.exp_specular(specular)
        return Denoised(diffuse, specular, radiance)

    def _logits(self, network: nn.Module, inputs: Tensor) -> list[Tensor]:
        """Only the convolutions run in bfloat16: three digits are too few for kernels that must keep an edge."""
        with torch.autocast(inputs.device.type, torch.bfloat16, enabled=self.bf16):
            outputs = network(inputs.contiguous(memory_format=torch.channels_last))
        return [logits.to(inputs.dtype) for logits in (outputs if isinstance(outputs, tuple) else (outputs,))]


def make_network(config: NetworkConfig) -> nn.Module:
    """The network of one branch."""
    if config.kind == "kernel_pyramid":
        return PyramidNetwork(config.widths)
    return KernelNetwork(config.depth, config.width, config.filter_size, config.taps)


def _padded(inputs: Tensor) -> Tensor:
    """Reflects on the right and bottom up to the size that a U-Net wants, over and over where there is too little."""
    for axis in (2, 3):
        wanted = -(-inputs.shape[axis] // SIZE_MULTIPLE) * SIZE_MULTIPLE
        while inputs.shape[axis] < wanted:
            size = inputs.shape[axis]
            amount = min(wanted - size, max(size - 1, 1))
            mode = "reflect" if size > 1 else "replicate"
            inputs = functional.pad(inputs, (0, amount, 0, 0) if axis == 3 else (0, 0, 0, amount), mode=mode)
    return inputs
