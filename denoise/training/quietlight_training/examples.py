"""Training examples: the layers of a view as two compact arrays, made once by `preprocess.py`.

    OUT/ID.radiance.npy   float32 `[7 n + 6, height, width]`: of each of the n noisy images the diffuse and specular
                          radiance and the depth, then the reference's diffuse and specular radiance
    OUT/ID.features.npy   float16 `[18 n + 3, height, width]`: of each noisy image the standard deviations of diffuse,
                          specular and beauty (each times the image's exposure, so that half floats neither overflow
                          nor vanish), albedo and its deviation, normal and its deviation, the relative deviation of the
                          depth; then the reference's albedo
    OUT/ID.json           what the view is; written last
    OUT/index.json        all of them, and the folders of the data sets by their names

A layer that a file lacks is zeros: a scene without specular light has no specular layer.
"""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from quietlight_training import exr, patches, transforms
from quietlight_training.views import View

VERSION = 1
NOISY_RADIANCE = 7
NOISY_FEATURES = 18
# Largest half float; a deviation beyond it, 65504 times the image's brightness, is as good as infinite.
LARGEST_HALF = 65504.0


@dataclass(frozen=True)
class ExampleImage:
    """A noisy image of an example: samples per pixel and the exposure its deviations are stored with."""

    spp: int
    exposure: float


@dataclass(frozen=True)
class Example:
    """A preprocessed view."""

    id: str
    scene_key: str
    split: str
    tags: tuple[str, ...]
    height: int
    width: int
    noisy: tuple[ExampleImage, ...]
    reference_relative_l2_noise: float
    patches: tuple[tuple[int, int], ...]
    """Top left corners `(y, x)` of the patches that importance sampling chose, for `patch_size`."""
    patch_size: int


@dataclass(frozen=True)
class Pair:
    """One noisy image and its reference, or a cut-out of them; float32 `[channels, height, width]`.

    Radiances have three channels. The variances of albedo and normal are one channel, the mean over their components,
    and the depth's is one channel, relative to its square.
    """

    diffuse: torch.Tensor
    diffuse_variance: torch.Tensor
    specular: torch.Tensor
    specular_variance: torch.Tensor
    beauty_variance: torch.Tensor
    albedo: torch.Tensor
    albedo_variance: torch.Tensor
    normal: torch.Tensor
    normal_variance: torch.Tensor
    depth: torch.Tensor
    depth_variance: torch.Tensor
    reference_diffuse: torch.Tensor
    reference_specular: torch.Tensor
    reference_albedo: torch.Tensor


def write_example(view: View, output: Path, patch_size: int, candidates: int) -> Example:
    """Reads a view's files, writes its arrays and record. Raises `ValueError` where they cannot be trained on."""
    reference = exr.read_layers(view.reference, ("noisy", "diffuse", "specular", "albedo"))
    shape = _mean(reference, "noisy", view.reference, 3).shape[1:]
    radiance, features, images = [], [], []
    importance = np.zeros(shape)
    for noisy in view.noisy:
        layers = exr.read_layers(noisy.path, ("noisy", "diffuse", "specular", "albedo", "normal", "depth"))
        means = {
            name: _mean(layers, name, noisy.path, 3 if name != "depth" else 1, shape)
            for name in ("noisy", "diffuse", "specular", "albedo", "normal", "depth")
        }
        variances = {name: _variance(layers, name, mean) for name, mean in means.items()}
        scale = float(transforms.exposure(torch.from_numpy(means["noisy"])[None]))
        depth = means["depth"]
        known = depth > 0
        relative_variance = np.where(known, variances["depth"] / np.where(known, depth, 1) ** 2, 0)
        radiance += [means["diffuse"], means["specular"], depth]
        features += [
            *(np.sqrt(variances[name]) * scale for name in ("diffuse", "specular", "noisy")),
            means["albedo"],
            np.sqrt(variances["albedo"].mean(0, keepdims=True)),
            means["normal"],
            np.sqrt(variances["normal"].mean(0, keepdims=True)),
            np.sqrt(relative_variance),
        ]
        images.append(ExampleImage(noisy.spp, scale))
        importance = np.maximum(importance, patches.importance_map(means["noisy"], means["normal"], patch_size))
    radiance += [_mean(reference, name, view.reference, 3, shape) for name in ("diffuse", "specular")]
    features.append(_mean(reference, "albedo", view.reference, 3, shape))

    generator = np.random.default_rng(patches.seed_of(view.id))
    example = Example(
        id=view.id,
        scene_key=view.scene_key,
        split=view.split,
        tags=view.tags,
        height=shape[0],
        width=shape[1],
        noisy=tuple(images),
        reference_relative_l2_noise=view.reference_relative_l2_noise,
        patches=tuple(patches.choose(importance, patch_size, candidates, generator)),
        patch_size=patch_size,
    )
    _write_array(output / f"{view.id}.radiance.npy", np.concatenate(radiance).astype(np.float32))
    halves = np.concatenate(features).clip(-LARGEST_HALF, LARGEST_HALF)
    _write_array(output / f"{view.id}.features.npy", halves.astype(np.float16))
    write_text(output / f"{view.id}.json", json.dumps({"version": VERSION, **asdict(example)}))
    return example


def read_example(path: Path) -> Example:
    """Reads an `ID.json`."""
    return _example(json.loads(path.read_text()), path)


def read_sources(output: Path) -> dict[str, str]:
    """The folders of the data sets that the examples are of, by name; none from before they were written down."""
    path = output / "index.json"
    return json.loads(path.read_text()).get("sources", {}) if path.exists() else {}


def write_index(output: Path, sources: dict[str, str] | None = None) -> list[Example]:
    """Gathers the examples of the folder in `index.json`, in the order of their ids; `sources` join those there."""
    sources = read_sources(output) | (sources or {})
    records = [json.loads(path.read_text()) for path in sorted(output.glob("*.json")) if path.name != "index.json"]
    write_text(output / "index.json", json.dumps({"version": VERSION, "sources": sources, "examples": records}))
    return [_example(record, output / "index.json") for record in records]


def read_index(folder: Path, split: str | None = None) -> list[Example]:
    """The examples of a preprocessed folder, or those of one split."""
    path = folder / "index.json"
    examples = [_example(record, path) for record in json.loads(path.read_text())["examples"]]
    return [example for example in examples if split in (None, example.split)]


def read_pair(
    folder: Path, example: Example, image: int, corner: tuple[int, int] = (0, 0), size: int | None = None
) -> Pair:
    """Reads noisy image number `image` of an example and its reference: the whole, or `size`² pixels from `corner`."""
    rows, columns = (slice(start, None if size is None else start + size) for start in corner)
    count = len(example.noisy)

    def planes(name: str, per_image: int) -> tuple[torch.Tensor, torch.Tensor]:
        array = np.load(folder / f"{example.id}.{name}.npy", mmap_mode="r")
        first = per_image * image
        chosen = (array[first : first + per_image, rows, columns], array[per_image * count :, rows, columns])
        noisy, reference = (torch.from_numpy(part.astype(np.float32)) for part in chosen)
        return noisy, reference

    radiance, reference_radiance = planes("radiance", NOISY_RADIANCE)
    features, reference_albedo = planes("features", NOISY_FEATURES)
    diffuse, specular, depth = radiance.split((3, 3, 1))
    deviations = features[:9] / example.noisy[image].exposure
    albedo, albedo_deviation, normal, normal_deviation, relative_depth = features[9:].split((3, 1, 3, 1, 1))
    diffuse_deviation, specular_deviation, beauty_deviation = deviations.split(3)
    return Pair(
        diffuse=diffuse,
        diffuse_variance=diffuse_deviation.square(),
        specular=specular,
        specular_variance=specular_deviation.square(),
        beauty_variance=beauty_deviation.square(),
        albedo=albedo,
        albedo_variance=albedo_deviation.square(),
        normal=normal,
        normal_variance=normal_deviation.square(),
        depth=depth,
        depth_variance=(relative_depth * depth).square(),
        reference_diffuse=reference_radiance[:3],
        reference_specular=reference_radiance[3:],
        reference_albedo=reference_albedo,
    )


def write_text(path: Path, text: str) -> None:
    """Writes the file whole or not at all."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text)
    os.replace(temporary, path)


def _example(record: dict, path: Path) -> Example:
    if record.get("version") != VERSION:
        raise ValueError(f"{path}: version {record.get('version')}, expected {VERSION}: run preprocess.py anew")
    fields = {name: value for name, value in record.items() if name != "version"}
    fields["noisy"] = tuple(ExampleImage(**image) for image in fields["noisy"])
    fields["tags"] = tuple(fields["tags"])
    fields["patches"] = tuple((y, x) for y, x in fields["patches"])
    return Example(**fields)


def _write_array(path: Path, array: np.ndarray) -> None:
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("wb") as file:
        np.save(file, array)
    os.replace(temporary, path)


def _mean(layers: exr.Layers, name: str, path: Path, channels: int, shape: tuple[int, int] | None = None) -> np.ndarray:
    layer = layers.layers.get(name)
    if layer is None:
        if name == "noisy" or shape is None:
            raise ValueError(f"{path}: expected a layer {name}, found {sorted(layers.layers)}")
        return np.zeros((channels, *shape), np.float32)
    if shape is not None and layer.mean.shape[1:] != shape:
        raise ValueError(f"{path}: {name} is {layer.mean.shape[1:]} pixels, the reference {shape}")
    if not np.isfinite(layer.mean).all():
        raise ValueError(f"{path}: {name} has values that are not finite")
    return layer.mean


def _variance(layers: exr.Layers, name: str, mean: np.ndarray) -> np.ndarray:
    """Variance of the mean; the spatial one for pixels of fewer than two samples, as `variance::complete` does."""
    layer = layers.layers.get(name)
    if layer is None:
        return np.zeros_like(mean)
    spatial = transforms.spatial_variance(torch.from_numpy(mean)[None]).numpy()[0]
    if layer.variance is None:
        return spatial
    variance = np.nan_to_num(layer.variance, nan=0.0, posinf=LARGEST_HALF**2).clip(0)
    if layers.samples is not None:
        variance = np.where(layers.samples < 2, spatial, variance)
    return variance
