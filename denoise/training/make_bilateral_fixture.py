"""Writes `denoise/tests/fixtures/bilateral.json`: what the bilateral filter of Rust must compute from the same numbers.

Random planes and secondary features of a small image, random weights of the network, and the multipliers and the
filtered image that these make, in float64. Arrays are flat, planar and row-major.
"""

import json
import tempfile
from pathlib import Path

import torch
from torch import Tensor

from quietlight_training.bilateral_filter import GROUPS, Filter, windows
from quietlight_training.bilateral_network import FEATURES, Network

FIXTURE = Path(__file__).resolve().parent.parent / "tests" / "fixtures" / "bilateral.json"
WIDTH, HEIGHT = 13, 11
SEED = 2015


def inputs() -> tuple[Tensor, Tensor, Network]:
    """Planes `[32, height, width]`, secondary features `[36, height, width]` and a network, exact in float32."""
    torch.manual_seed(SEED)
    planes = torch.rand(32, HEIGHT, WIDTH)
    planes[3:6] *= 0.2
    first = 6
    for count in GROUPS:
        planes[first + count : first + 2 * count] *= 0.05
        first += 2 * count
    # Variances below the floor, colours of no variance, and a feature far from all others.
    planes[9:12, 1, :] = 0
    planes[3:6, 3, 3:5] = 0
    features = torch.rand(FEATURES, HEIGHT, WIDTH)
    features[4, 2, 2] = 1e6
    network = Network(torch.rand(FEATURES), 0.1 + torch.rand(FEATURES))
    torch.nn.init.normal_(network.output.weight)
    return planes.round(decimals=4), features.round(decimals=4), network


def expected(planes: Tensor, features: Tensor, network: Network) -> tuple[Tensor, Tensor]:
    """Multipliers `[7, height, width]` and the filtered colour `[3, height, width]`, in float64."""
    grid = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    rows, columns = (index.reshape(-1) for index in grid)
    with torch.no_grad():
        multipliers = network.double()(features.double().reshape(FEATURES, -1).t())
        filtered = Filter.apply(multipliers, *windows(planes.double(), rows, columns))
    return multipliers.t().reshape(7, HEIGHT, WIDTH), filtered.t().reshape(3, HEIGHT, WIDTH)


def fixture() -> dict[str, object]:
    """The whole record."""
    planes, features, network = inputs()
    names = [str(index) for index in range(FEATURES)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "weights.json"
        network.write(path, names, {})
        weights, network = json.loads(path.read_text()), Network.read(path)
    multipliers, filtered = expected(planes, features, network)

    def numbers(image: Tensor) -> list[float]:
        return [float(f"{value:.7g}") for value in image.double().reshape(-1).tolist()]

    return {
        "size": [WIDTH, HEIGHT],
        "weights": weights,
        "planes": numbers(planes),
        "features": numbers(features),
        "multipliers": numbers(multipliers),
        "filtered": numbers(filtered),
    }


if __name__ == "__main__":
    FIXTURE.write_text(json.dumps(fixture()) + "\n")
