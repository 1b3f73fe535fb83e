"""Reading the multi-layer EXR files that `quietlight render` and `quietlight dataset` write.

The channel names are the renderer's (`denoise/src/exr/channels.rs`): `layer.component` for a mean over the samples,
`layer.variance.component` for the variance of that mean, `layer.a.component` and `layer.b.component` for the means of
two independent halves of the samples. The layer `noisy` is the radiance as rendered; `R G B` is the picture shown.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenEXR

# Components of every layer, in the order of the first axis of its images.
COMPONENTS = {
    "noisy": "RGB",
    "diffuse": "RGB",
    "specular": "RGB",
    "albedo": "RGB",
    "normal": "XYZ",
    "position": "XYZ",
    "depth": "Z",
    "texture2": "RGB",
    "visibility": "V",
}


@dataclass
class Layer:
    """One layer: images `[components, height, width]`, float32; `None` where the file has none."""

    mean: np.ndarray
    variance: np.ndarray | None = None
    a: np.ndarray | None = None
    b: np.ndarray | None = None


@dataclass
class Layers:
    """All layers of a file by name, with the samples of each pixel `[1, height, width]` where it says."""

    layers: dict[str, Layer] = field(default_factory=dict)
    samples: np.ndarray | None = None


def read_layers(path: Path, names: tuple[str, ...] = tuple(COMPONENTS)) -> Layers:
    """Reads the layers `names` of the file, those of them that it has.

    Raises `ValueError`, naming the file, where it is no EXR or an image lacks one of its components.
    """
    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except RuntimeError as error:
        raise ValueError(f"{path}: not a readable EXR: {error}") from error

    def image(prefix: str, components: str) -> np.ndarray | None:
        wanted = [f"{prefix}.{component}" for component in components]
        missing = [name for name in wanted if name not in channels]
        if len(missing) == len(wanted):
            return None
        if missing:
            raise ValueError(f"{path}: expected the channels {wanted}, found no {missing}")
        return np.stack([channels[name].pixels for name in wanted]).astype(np.float32, copy=False)

    result = Layers(samples=image("samples", "N"))
    for name in names:
        components = COMPONENTS[name]
        mean = image(name, components)
        if mean is not None:
            images = (image(f"{name}.{role}", components) for role in ("variance", "a", "b"))
            result.layers[name] = Layer(mean, *images)
    return result
