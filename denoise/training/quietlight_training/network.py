"""The networks that predict kernels. They yield logits only; softmax and kernels are `kernels`, in Rust `kpcn::kernel`.

- [`PyramidNetwork`]: a U-Net on the five-level kernel pyramid; its widths make the tiers.
- [`KernelNetwork`]: the plain stack of Bako et al. 2017, section 5.1: 9 layers of 5×5×100, kernels of 21×21.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from quietlight_training.channels import KERNEL_CHANNELS, PYRAMID_CHANNELS
from quietlight_training.kernels import COARSE_TAPS, FINE_TAPS, LEVEL_LOGITS

# Height and width of an image must be multiples of this: half resolution by space-to-depth, then three poolings.
SIZE_MULTIPLE = 16

# Where training starts: each pixel mostly itself, a little of its neighbours and of the coarser level. With the weight
# e^3 on the centre tap, 24 others and e^1 on the central coarse tap the identity has 36 %, which neither blurs the
# image away nor leaves the other taps without a gradient.
CENTRE_LOGIT = 3.0
COARSE_CENTRE_LOGIT = 1.0


class _Block(nn.Sequential):
    """Two 3×3 convolutions, each with a ReLU; zero padding keeps the size."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(outputs, outputs, 3, padding=1),
            nn.ReLU(inplace=True),
        )


class PyramidNetwork(nn.Module):
    """Logits of the kernel pyramid for an image of H×W pixels, both multiples of 16.

    The input is the 22 channels by space-to-depth, `[batch, 88, H/2, W/2]`: channel `4 c + 2 dy + dx` of the
    half-sized pixel P is channel c of pixel `2 P + (dx, dy)`. `level0` `[batch, 140, H/2, W/2]` spreads its 35
    logits a pixel in the same way; `level1` is `[batch, 35, H/2, W/2]`, `level2` and `level3` as much at 1/4 and 1/8,
    `level4` `[batch, 25, H/16, W/16]`. The shuffles are left to the caller because in onnxruntime they took two
    thirds of the time of a small network, and so is the head of `level0` where onnxruntime runs the rest
    (`onnx_model`): its 140 channels took half of the memory.

    The encoder has the `widths` at 1/2, 1/4, 1/8 and 1/16 of the resolution.
    """

    def __init__(self, widths: tuple[int, int, int, int]):
        super().__init__()
        self.widths = widths
        w0, w1, w2, w3 = widths
        self.encoder = nn.ModuleList(
            (_Block(4 * len(PYRAMID_CHANNELS), w0), _Block(w0, w1), _Block(w1, w2), _Block(w2, w3))
        )
        self.decoder = nn.ModuleList((_Block(w3 + w2, w2), _Block(w2 + w1, w1), _Block(w1 + w0, w0)))
        self.heads = nn.ModuleList(
            (
                nn.Conv2d(w0, 4 * LEVEL_LOGITS, 1),
                nn.Conv2d(w0, LEVEL_LOGITS, 1),
                nn.Conv2d(w1, LEVEL_LOGITS, 1),
                nn.Conv2d(w2, LEVEL_LOGITS, 1),
                nn.Conv2d(w3, FINE_TAPS, 1),
            )
        )
        self.apply(_initialise)
        with torch.no_grad():
            for head in self.heads:
                # Small weights, so that the start is the filter of the biases and not noise of the initialisation.
                head.weight.mul_(0.1)
            bias = _mild_bias()
            # Channel 4 c + k is logit c of pixel k of the four.
            self.heads[0].bias.copy_(bias.repeat_interleave(4))
            for head in self.heads[1:-1]:
                head.bias.copy_(bias)
            self.heads[-1].bias.copy_(bias[:FINE_TAPS])

    def widen(self, narrow: "PyramidNetwork"):
        """Starts from a narrower network, and computes what it does: the first channels take its weights; the others
        stay random, and the first do not listen to them before training tells them to. Raises `ValueError` where the
        other is wider somewhere.
        """
        if any(mine < theirs for mine, theirs in zip(self.widths, narrow.widths, strict=True)):
            raise ValueError(f"a network of {narrow.widths} channels cannot be widened to {self.widths}")
        with torch.no_grad():
            for (wide, groups), (other, other_groups) in zip(self._layers(), narrow._layers(), strict=True):
                outputs = other.out_channels
                wide.bias[:outputs] = other.bias
                wide.weight[:outputs] = 0
                to = of = 0
                for group, other_group in zip(groups, other_groups, strict=True):
                    wide.weight[:outputs, to : to + other_group] = other.weight[:, of : of + other_group]
                    to, of = to + group, of + other_group

    def _layers(self) -> list[tuple[nn.Conv2d, tuple[int, ...]]]:
        """All convolutions, and the groups of channels that each one's input was put together from."""
        w0, w1, w2, w3 = self.widths
        inputs = ((4 * len(PYRAMID_CHANNELS),), (w0,), (w1,), (w2,), (w3, w2), (w2, w1), (w1, w0))
        layers = []
        for (first, _, second, _), groups in zip((*self.encoder, *self.decoder), inputs, strict=True):
            layers += [(first, groups), (second, (second.in_channels,))]
        return layers + [(head, (head.in_channels,)) for head in self.heads]

    def forward(self, channels: Tensor) -> tuple[Tensor, ...]:
        half, *others = self.all_but_finest(channels)
        return self.heads[0](half), *others

    def all_but_finest(self, channels: Tensor) -> tuple[Tensor, ...]:
        """What `forward` gives, but for `level0` the features `[batch, widths[0], H/2, W/2]` that its head is given."""
        features = channels
        skips = []
        for level, block in enumerate(self.encoder):
            features = block(functional.max_pool2d(features, 2) if level else features)
            skips.append(features)
        decoded = [features]
        for block, skip in zip(self.decoder, skips[-2::-1], strict=True):
            upsampled = functional.interpolate(features, scale_factor=2, mode="nearest")
            features = block(torch.cat((upsampled, skip), 1))
            decoded.append(features)
        half = decoded[-1]
        return half, *(head(features) for head, features in zip(self.heads[1:], reversed(decoded), strict=True))


class KernelNetwork(nn.Module):
    """Logits `[batch, taps², H, W]` of one kernel a pixel from `[batch, 27, H, W]`; zero padding keeps the size."""

    def __init__(self, depth: int, width: int, filter_size: int, taps: int):
        super().__init__()
        widths = [len(KERNEL_CHANNELS), *[width] * (depth - 1), taps * taps]
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(widths):
            layers += [nn.Conv2d(inputs, outputs, filter_size, padding=filter_size // 2), nn.ReLU(inplace=True)]
        self.layers = nn.Sequential(*layers[:-1])
        self.apply(_initialise)

    def forward(self, channels: Tensor) -> Tensor:
        return self.layers(channels)


def _initialise(module: nn.Module):
    """Xavier's uniform initialisation with zero biases (Bako et al. 2017, section 6)."""
    if isinstance(module, nn.Conv2d):
        nn.init.xavier_uniform_(module.weight)
        nn.init.zeros_(module.bias)


def _mild_bias() -> Tensor:
    bias = torch.zeros(LEVEL_LOGITS)
    bias[FINE_TAPS // 2] = CENTRE_LOGIT
    bias[FINE_TAPS + COARSE_TAPS // 2] = COARSE_CENTRE_LOGIT
    return bias
