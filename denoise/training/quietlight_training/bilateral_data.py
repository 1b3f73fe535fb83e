"""Training data of the bilateral filter: noisy images as the filter prepares them, and pixels drawn from them.

The preparation (variances, prefilter, secondary features) is the filter's own: the program
`denoise/examples/bilateral_examples.rs` writes it into a NumPy file for each noisy image, once.
"""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from quietlight_training.bilateral_filter import MULTIPLIERS, RADIUS, relative_error, windows
from quietlight_training.bilateral_network import FEATURES
from quietlight_training.exr import read_layers
from quietlight_training.views import View

# Colour, features and their variances come first, the secondary features last.
PLANES = 32
CHANNELS_FILE = "channels.json"
REPOSITORY = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Example:
    """A noisy image: its prepared planes `[68, height, width]` on disk, its reference and its samples per pixel."""

    prepared: Path
    reference: Path
    spp: int

    def load(self) -> tuple[Tensor, Tensor, Tensor]:
        """The planes of the filter, the secondary features and the reference, `[channels, height, width]` each."""
        planes = torch.from_numpy(np.load(self.prepared))
        if planes.shape[0] != PLANES + FEATURES:
            raise ValueError(f"{self.prepared}: {planes.shape[0]} channels, expected {PLANES + FEATURES}")
        reference = torch.from_numpy(read_layers(self.reference, ("noisy",)).layers["noisy"].mean)
        return planes[:PLANES], planes[PLANES:], reference


def run_example(name: str, arguments: list[str]) -> str:
    """Runs an example program of the denoiser and returns its standard output."""
    command = ["cargo", "run", "--release", "--quiet", "-p", "quietlight-denoise", "--example", name, "--", *arguments]
    result = subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True, check=False)
    if result.returncode != 0:
        raise ValueError(f"the program {name} ended with {result.returncode}; what it said is above")
    return result.stdout


def prepare(views: list[View], folder: Path) -> list[Example]:
    """The examples of all noisy images of the views; those that `folder` has not are prepared first."""
    folder.mkdir(parents=True, exist_ok=True)
    examples, waiting = [], []
    for view in views:
        for index, noisy in enumerate(view.noisy):
            prepared = folder / f"{view.id}-{index}.npy"
            examples.append(Example(prepared, view.reference, noisy.spp))
            if not prepared.exists():
                waiting += [str(noisy.path.resolve()), str(prepared.resolve())]
    # As many at a time as a command line holds with ease.
    for start in range(0, len(waiting), 200):
        names = run_example("bilateral_examples", waiting[start : start + 200])
        (folder / CHANNELS_FILE).write_text(names)
    return examples


def feature_names(folder: Path) -> list[str]:
    """Names of the secondary features, as the program that prepared the examples told them."""
    return json.loads((folder / CHANNELS_FILE).read_text())[PLANES:]


def normalisation(examples: list[Example]) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each secondary feature over all pixels of the examples, `[36]` each."""
    count, total, squares = 0, torch.zeros(FEATURES, dtype=torch.float64), torch.zeros(FEATURES, dtype=torch.float64)
    for example in examples:
        features = torch.from_numpy(np.load(example.prepared, mmap_mode="r")[PLANES:].reshape(FEATURES, -1).copy())
        features = features.double()
        count += features.shape[1]
        total += features.sum(1)
        squares += features.square().sum(1)
    mean = total / count
    return mean.float(), (squares / count - mean.square()).clamp_min(0).sqrt().float()


@dataclass
class Pool:
    """Pixels drawn from many images, in random order: all that the loss and its gradient need."""

    distances: Tensor
    """`[pixels, 7, taps]`"""
    colours: Tensor
    """`[pixels, taps, 3]`"""
    features: Tensor
    """`[pixels, 36]`"""
    reference: Tensor
    """`[pixels, 3]`"""
    weight: Tensor
    """Weight of each pixel's error, `[pixels]`, the same for all of an image."""

    @property
    def noisy(self) -> Tensor:
        """The colours before the filter, `[pixels, 3]`: the middle taps."""
        return self.colours[:, self.colours.shape[1] // 2]


BALANCES = ("noise", "samples")
# Images with less noise than this (relative L2) count no more than if they had it.
LEAST_NOISE = 1e-6


def image_weight(planes: Tensor, reference: Tensor, spp: int, balance: str) -> float:
    """What an image's errors count.

    The paper multiplies by the samples per pixel (`samples`), by which the noise of one scene falls. Scenes differ in
    noise by far more, and those of fireflies would decide alone: `noise` divides by the noise itself, so that the mean
    error of an image left as it is is 1.
    """
    if balance == "samples":
        return float(spp)
    noise = relative_error(planes[:3].reshape(3, -1).t(), reference.reshape(3, -1).t(), torch.ones(1)).mean()
    return 1 / max(noise.item(), LEAST_NOISE)


def draw(examples: list[Example], pixels: int, seed: int, balance: str = "noise", radius: int = RADIUS) -> Pool:
    """Draws `pixels` pixels of each example; the same seed draws the same pixels."""
    generator = torch.Generator().manual_seed(seed)
    count, taps = len(examples) * pixels, (2 * radius + 1) ** 2
    pool = Pool(
        torch.empty(count, MULTIPLIERS, taps),
        torch.empty(count, taps, 3),
        torch.empty(count, FEATURES),
        torch.empty(count, 3),
        torch.empty(count),
    )
    order = torch.randperm(count, generator=generator).view(len(examples), pixels)
    for example, slots in zip(examples, order, strict=True):
        planes, features, reference = example.load()
        height, width = reference.shape[1:]
        rows = torch.randint(height, (pixels,), generator=generator)
        columns = torch.randint(width, (pixels,), generator=generator)
        pool.distances[slots], pool.colours[slots] = windows(planes, rows, columns, radius)
        pool.features[slots] = features[:, rows, columns].t()
        pool.reference[slots] = reference[:, rows, columns].t()
        pool.weight[slots] = image_weight(planes, reference, example.spp, balance)
    return pool
