"""Batches of augmented training patches; each a function of the seed, the rank and the step alone, so that a resumed run
sees what an uninterrupted one would have seen."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from quietlight_training import transforms
from quietlight_training.augment import Augmentation, TrainingPair, augment
from quietlight_training.examples import Example, read_pair
from quietlight_training.losses import Target
from quietlight_training.transforms import Buffers


@dataclass(frozen=True)
class Batch:
    """Buffers `[batch, channels, height, width]`, exposures `[batch, 1, 1, 1]` and what should come out."""

    buffers: Buffers
    scale: Tensor
    target: Target


class PatchSampler:
    """Draws patches of preprocessed examples: every chosen place equally often, every noisy image of it equally often."""

    def __init__(self, folder: Path, examples: list[Example], augmentation: Augmentation, is_log_specular: bool):
        self.folder = folder
        self.augmentation = augmentation
        self.is_log_specular = is_log_specular
        self.patches = [(example, corner) for example in examples for corner in example.patches]
        if not self.patches:
            raise ValueError(f"{folder}: expected training patches, found none in {len(examples)} examples")
        self.size = self.patches[0][0].patch_size

    def batch(self, count: int, seed: int, rank: int, step: int) -> Batch:
        """The batch of `count` patches of a step."""
        generator = np.random.default_rng([seed, rank, step])
        pairs = []
        for _ in range(count):
            example, corner = self.patches[generator.integers(len(self.patches))]
            image = int(generator.integers(len(example.noisy)))
            pair = read_pair(self.folder, example, image, corner, example.patch_size)
            pairs.append(augment(pair, self.augmentation, generator))
        return collate(pairs, self.is_log_specular)


def collate(pairs: list[TrainingPair], is_log_specular: bool) -> Batch:
    """Puts pairs of one size together and makes the targets of the networks."""
    names = [field.name for field in fields(Buffers)]
    buffers = Buffers(**{name: torch.stack([getattr(pair.buffers, name) for pair in pairs]) for name in names})
    diffuse, specular, demodulation = (
        torch.stack([getattr(pair, f"reference_{name}") for pair in pairs])
        for name in ("diffuse", "specular", "demodulation")
    )

    def factors(name: str) -> Tensor:
        return torch.tensor([getattr(pair, name) for pair in pairs], dtype=diffuse.dtype).view(-1, 1, 1, 1)

    scale = transforms.exposure(buffers.beauty) * factors("input_exposure")
    # The paper's networks take radiance as it comes (METHODS 10.1).
    signal_scale = torch.ones_like(scale) if is_log_specular else scale
    target = Target(
        diffuse=signal_scale * diffuse / (demodulation + transforms.EPSILON),
        specular=specular.clamp_min(0).log1p() if is_log_specular else scale * specular,
        demodulation=demodulation,
        radiance=diffuse + specular,
        noisy=buffers.beauty,
        exposure=factors("loss_exposure"),
        is_log_specular=is_log_specular,
    )
    return Batch(buffers, scale, target)
