"""Scores of a denoiser on held-out views, by sample count, against the noisy image."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from quietlight_training import metrics
from quietlight_training.augment import as_rendered
from quietlight_training.batches import Batch, collate
from quietlight_training.examples import Example, read_pair

# Sample counts are judged in groups: these are the lowest of each.
BUCKETS = (1, 4, 16, 64)


@dataclass(frozen=True)
class Score:
    """Figures of one noisy image."""

    id: str
    spp: int
    noisy_relative_l2: float
    relative_l2: float
    noisy_dissimilarity: float
    dissimilarity: float


@dataclass(frozen=True)
class Summary:
    """Scores of a group of sample counts; `ratio`s are geometric means of denoised over noisy."""

    name: str
    count: int
    relative_l2: float
    relative_l2_ratio: float
    dissimilarity: float
    dissimilarity_ratio: float
    worse: int
    """Images whose relative L2 the denoiser raised."""


def choose(examples: list[Example], limit: int | None) -> list[tuple[Example, int]]:
    """All noisy images of the examples, or `limit` of them spread evenly over the sample counts."""
    pairs = [(example, image) for example in examples for image in range(len(example.noisy))]
    pairs.sort(key=lambda pair: (pair[0].noisy[pair[1]].spp, pair[0].id))
    if limit is None or limit >= len(pairs):
        return pairs
    return [pairs[index] for index in np.linspace(0, len(pairs) - 1, limit).astype(int)]


def score(
    denoise: Callable[[Batch], Tensor], folder: Path, pairs: Iterable[tuple[Example, int]], is_log_specular: bool
) -> list[Score]:
    """Scores `denoise`, which makes radiance `[1, 3, height, width]` of a batch of one."""
    scores = []
    for example, image in pairs:
        batch = collate([as_rendered(read_pair(folder, example, image))], is_log_specular)
        with torch.no_grad():
            radiance = denoise(batch)
        reference, noisy = batch.target.radiance, batch.target.noisy
        shown = metrics.srgb(reference)
        scores.append(
            Score(
                example.id,
                example.noisy[image].spp,
                metrics.relative_l2(noisy, reference).item(),
                metrics.relative_l2(radiance, reference).item(),
                metrics.dissimilarity(metrics.srgb(noisy), shown).item(),
                metrics.dissimilarity(metrics.srgb(radiance), shown).item(),
            )
        )
    return scores


def summarise(scores: list[Score]) -> list[Summary]:
    """One summary a group of sample counts that has any, and one of all."""
    groups = []
    for low, high in zip(BUCKETS, (*BUCKETS[1:], None), strict=True):
        name = f"{low}-{high - 1} spp" if high else f"{low}+ spp"
        groups.append((name, [s for s in scores if s.spp >= low and (high is None or s.spp < high)]))
    groups.append(("all", scores))
    return [_summary(name, group) for name, group in groups if group]


def table(summaries: list[Summary]) -> str:
    """The summaries as text."""
    lines = [f"{'':>10} {'images':>6} {'rel. L2':>9} {'ratio':>6} {'1-SSIM':>7} {'ratio':>6} {'worse':>5}"]
    lines += [
        f"{s.name:>10} {s.count:6d} {s.relative_l2:9.2e} {s.relative_l2_ratio:6.3f} "
        f"{s.dissimilarity:7.4f} {s.dissimilarity_ratio:6.3f} {s.worse:5d}"
        for s in summaries
    ]
    return "\n".join(lines)


def _summary(name: str, scores: list[Score]) -> Summary:
    def geometric(values: list[float]) -> float:
        # A perfect image (a scene without light) has an error of 0, of which there is no logarithm.
        return float(np.exp(np.mean(np.log(np.maximum(values, 1e-12)))))

    def pick(name: str) -> list[float]:
        return [getattr(score, name) for score in scores]

    relative_l2, dissimilarity = geometric(pick("relative_l2")), geometric(pick("dissimilarity"))
    return Summary(
        name,
        len(scores),
        relative_l2,
        relative_l2 / geometric(pick("noisy_relative_l2")),
        dissimilarity,
        dissimilarity / geometric(pick("noisy_dissimilarity")),
        sum(score.relative_l2 > score.noisy_relative_l2 for score in scores),
    )
