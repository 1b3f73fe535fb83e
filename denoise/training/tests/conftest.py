"""Small random buffers and data sets that several tests use."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from quietlight_training import exr
from quietlight_training.transforms import Buffers


@pytest.fixture(autouse=True)
def _two_threads_and_a_seed():
    torch.set_num_threads(2)
    torch.manual_seed(7)


def random_buffers(height: int = 32, width: int = 32, batch: int = 1, dtype=torch.float32) -> Buffers:
    """Positive radiances with variances of a plausible size, unit normals, depths from 1 to 2."""

    def uniform(channels: int) -> torch.Tensor:
        return torch.rand(batch, channels, height, width, dtype=dtype)

    normal = uniform(3) * 2 - 1
    albedo = uniform(3)
    return Buffers(
        diffuse=uniform(3) * albedo,
        diffuse_variance=0.01 * uniform(3),
        specular=0.3 * uniform(3) ** 4,
        specular_variance=0.01 * uniform(3),
        albedo=albedo,
        albedo_variance=0.001 * uniform(3),
        normal=normal / normal.norm(dim=1, keepdim=True),
        normal_variance=0.001 * uniform(3),
        depth=1 + uniform(1),
        depth_variance=0.001 * uniform(1),
        demodulation=albedo,
    )


def write_exr(path: Path, layers: dict[str, np.ndarray]) -> None:
    """Writes planar images by channel group, such as `albedo.variance`, under the components of their layer."""
    channels = {}
    for group, image in layers.items():
        components = exr.COMPONENTS.get(group.split(".")[0], "N")
        for component, plane in zip(components, image, strict=True):
            channels[f"{group}.{component}"] = plane.astype(np.float32)
    exr.OpenEXR.File({"type": exr.OpenEXR.scanlineimage}, channels).write(str(path))


def write_view(folder: Path, name: str, split: str, size: int = 48, seed: int = 0, specular: bool = True) -> None:
    """A view of a smooth picture with two noisy images, of 1 and 16 samples per pixel."""
    generator = np.random.default_rng(seed)
    view = folder / "views" / name
    view.mkdir(parents=True)
    y, x = np.mgrid[0:size, 0:size] / size
    albedo = np.stack([0.3 + 0.5 * (x > 0.5), 0.4 + 0.3 * y, 0.5 + 0 * x])
    light = 0.2 + np.stack([x, y, 1 - x])
    diffuse = albedo * light
    shine = 0.5 * np.exp(-20 * ((x - 0.3) ** 2 + (y - 0.6) ** 2))[None].repeat(3, 0) * specular
    features = {
        "albedo": albedo,
        "normal": np.stack([0 * x, 0 * x, 1 + 0 * x]),
        "depth": (1 + y)[None],
    }

    def noisy(spp: int) -> dict[str, np.ndarray]:
        deviation = 0.5 / np.sqrt(spp)
        images = {"diffuse": diffuse, "specular": shine} if specular else {"diffuse": diffuse}
        layers = {}
        for group, mean in images.items():
            layers[group] = (mean * (1 + deviation * generator.standard_normal(mean.shape))).astype(np.float32)
            layers[f"{group}.variance"] = (mean * deviation) ** 2
        layers["noisy"] = sum(layers[group] for group in images)
        layers["noisy.variance"] = sum(layers[f"{group}.variance"] for group in images)
        for group, mean in features.items():
            layers[group] = mean
            layers[f"{group}.variance"] = np.full_like(mean, 1e-6)
        layers["samples"] = np.full((1, size, size), spp)
        return layers

    for number, spp in enumerate((1, 16)):
        write_exr(view / f"noisy-{number}.exr", noisy(spp))
    reference = {"noisy": diffuse + shine, "diffuse": diffuse, "albedo": albedo}
    write_exr(view / "reference.exr", reference | ({"specular": shine} if specular else {}))
    record = {
        "id": name,
        "scene_key": name,
        "split": split,
        "tags": ["test"],
        "noisy": [{"file": f"noisy-{n}.exr", "spp": spp, "seed": n} for n, spp in enumerate((1, 16))],
        "reference": {"file": "reference.exr", "spp": 4096, "seed": 9, "relative_l2_noise": 1e-5},
    }
    (view / "view.json").write_text(json.dumps(record))


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Path:
    """A data set of three training views, one of them without specular light, and a held-out one."""
    folder = tmp_path_factory.mktemp("dataset")
    for seed, (name, split) in enumerate((("a", "train"), ("b", "train"), ("c", "train"), ("d", "validation"))):
        write_view(folder, name, split, seed=seed, specular=name != "c")
    return folder
