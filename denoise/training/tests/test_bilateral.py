"""The bilateral filter, its gradients and the training of its network (METHODS 13.7)."""

import json

import pytest
import torch

import make_bilateral_fixture
from quietlight_training.bilateral_data import Pool
from quietlight_training.bilateral_filter import GROUPS, Filter, relative_error, windows
from quietlight_training.bilateral_network import ARGUMENT, START, Constant, Network, inverse_softplus, softplus
from quietlight_training.bilateral_train import error, robust, train_pool

RADIUS = 3


def random_planes(height: int, width: int, seed: int = 1) -> torch.Tensor:
    """Colour, features and their variances, in float64; variances below the floor among them."""
    generator = torch.Generator().manual_seed(seed)
    planes = torch.rand(32, height, width, generator=generator, dtype=torch.float64)
    first = 6
    planes[3:6] *= 0.1
    for count in GROUPS:
        planes[first + count : first + 2 * count] *= 3e-2
        first += 2 * count
    planes[7 + 2, 0, 0] = 0
    return planes


def pool_of(planes: torch.Tensor, reference: torch.Tensor, features: torch.Tensor, spp: float = 4.0) -> Pool:
    """Every pixel of an image."""
    height, width = planes.shape[1:]
    rows, columns = (
        grid.reshape(-1) for grid in torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    )
    distances, colours = windows(planes, rows, columns, RADIUS)
    weight = torch.full((height * width,), spp, dtype=planes.dtype)
    return Pool(distances, colours, features.reshape(36, -1).t(), reference.reshape(3, -1).t(), weight)


def random_network(seed: int = 3, dtype: torch.dtype = torch.float64) -> Network:
    torch.manual_seed(seed)
    network = Network(torch.rand(36), 0.3 + torch.rand(36))
    torch.nn.init.normal_(network.output.weight)
    return network.to(dtype)


def test_the_filter_equals_the_loops():
    height, width = 6, 8
    planes = random_planes(height, width)
    multipliers = torch.rand(height * width, 7, dtype=torch.float64) * torch.tensor([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.4])
    pool = pool_of(planes, planes[:3], torch.zeros(36, height, width, dtype=torch.float64))
    found = Filter.apply(multipliers, pool.distances, pool.colours)
    for y in range(height):
        for x in range(width):
            lam = multipliers[y * width + x]
            total, summed = 0.0, torch.zeros(3, dtype=torch.float64)
            for v in range(max(0, y - RADIUS), min(height, y + RADIUS + 1)):
                for u in range(max(0, x - RADIUS), min(width, x + RADIUS + 1)):
                    i, j = planes[:, y, x], planes[:, v, u]
                    distance = lam[0] * ((v - y) ** 2 + (u - x) ** 2)
                    distance += lam[6] * ((j[:3] - i[:3]) ** 2 / (1e-10 + i[3:6] + j[3:6])).sum()
                    first = 6
                    for k, n in enumerate(GROUPS):
                        spread = torch.maximum(i[first + n : first + 2 * n], torch.tensor(1e-4, dtype=torch.float64))
                        distance += lam[k + 1] * ((j[first : first + n] - i[first : first + n]) ** 2 / spread).sum()
                        first += 2 * n
                    total += torch.exp(-distance)
                    summed += torch.exp(-distance) * j[:3]
            torch.testing.assert_close(found[y * width + x], summed / total, rtol=1e-12, atol=1e-12)


def test_two_pixels_of_the_worked_example():
    # METHODS N.11: one pixel away, λ₀ = ln 2, c = (0, 1): 1/3, −0.2222; E = 5.5556 and its derivative −7.407.
    multipliers = torch.zeros(1, 7, dtype=torch.float64)
    multipliers[0, 0] = torch.log(torch.tensor(2.0))
    multipliers.requires_grad_()
    distances = torch.zeros(1, 7, 2, dtype=torch.float64)
    distances[0, 0, 1] = 1
    colours = torch.tensor([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]], dtype=torch.float64)
    filtered = Filter.apply(multipliers, distances, colours)
    loss = relative_error(filtered, torch.zeros(1, 3), torch.ones(1)).sum()
    loss.backward()
    assert filtered[0, 0].item() == pytest.approx(1 / 3)
    assert loss.item() == pytest.approx(5.5556, abs=1e-4)
    assert multipliers.grad[0, 0].item() == pytest.approx(-7.407, abs=1e-3)


@pytest.mark.parametrize("multiplier", range(7))
def test_the_gradient_of_each_multiplier(multiplier):
    planes = random_planes(5, 6)
    pool = pool_of(planes, planes[:3], torch.zeros(36, 5, 6, dtype=torch.float64))
    values = (0.02 + 0.1 * torch.rand(30, 7, dtype=torch.float64)).requires_grad_()
    upstream = torch.randn(30, 3, dtype=torch.float64)
    Filter.apply(values, pool.distances, pool.colours).backward(upstream)
    shift = torch.zeros(7, dtype=torch.float64)
    shift[multiplier] = 1e-5
    with torch.no_grad():
        above, below = (Filter.apply(values + sign * shift, pool.distances, pool.colours) for sign in (1, -1))
    expected = ((above - below) * upstream).sum(1) / 2e-5
    torch.testing.assert_close(values.grad[:, multiplier], expected, rtol=1e-6, atol=1e-9)


def test_the_gradient_through_network_filter_and_error():
    planes = random_planes(5, 6)
    features = torch.rand(36, 5, 6, dtype=torch.float64)
    pool = pool_of(planes, random_planes(5, 6, 2)[:3], features)
    network = random_network()
    loss = lambda: error(network, pool, slice(None)).mean()  # noqa: E731
    loss().backward()
    direction = [torch.randn_like(parameter) for parameter in network.parameters()]
    expected = sum((parameter.grad * d).sum() for parameter, d in zip(network.parameters(), direction, strict=True))

    def moved(step: float) -> torch.Tensor:
        with torch.no_grad():
            for parameter, d in zip(network.parameters(), direction, strict=True):
                parameter += step * d
            value = loss()
            for parameter, d in zip(network.parameters(), direction, strict=True):
                parameter -= step * d
        return value

    found = (moved(1e-5) - moved(-1e-5)) / 2e-5
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-9)


def test_softplus_and_sigmoid():
    x = torch.linspace(-30, 30, 121, dtype=torch.float64, requires_grad=True)
    softplus(x).sum().backward()
    torch.testing.assert_close(softplus(x), torch.log1p(torch.exp(x)))
    torch.testing.assert_close(x.grad, torch.sigmoid(x.detach()))
    assert softplus(torch.tensor([-1e4, 1e4])).tolist() == [0.0, 1e4]
    for value in (1e-9, 0.01, 0.7, 5.0):
        found = softplus(torch.tensor(inverse_softplus(value), dtype=torch.float64)).item()
        assert found == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("bias", [ARGUMENT[0] - 1, ARGUMENT[1] + 1])
def test_no_gradient_where_the_argument_is_clamped(bias):
    network = random_network()
    with torch.no_grad():
        network.output.weight.zero_()
        network.output.bias.fill_(bias)
    features = torch.rand(4, 36, dtype=torch.float64)
    network(features)[:, :6].sum().backward()
    assert all(parameter.grad.abs().max() == 0 for parameter in (network.output.bias, network.hidden.weight))
    with torch.no_grad():
        network.output.bias.fill_(ARGUMENT[1] - 1)
    network(features)[:, :6].sum().backward()
    assert network.output.bias.grad.min() > 0.9


def test_the_network_beats_the_best_constants_on_one_image() -> None:
    """One image: half of it flat with noisy albedo, half of it a texture that the albedo shows."""
    overfit(20)


def overfit(epochs: int) -> tuple[Network, float]:
    torch.manual_seed(5)
    size = 24
    half = (torch.arange(size) < size // 2).expand(size, size)
    texture = 0.2 + 0.6 * ((torch.arange(size) + torch.arange(size).unsqueeze(1)) % 2)
    clean = torch.where(half, torch.tensor(0.5), texture)
    reference = clean.expand(3, size, size).contiguous()
    planes = torch.zeros(32, size, size)
    planes[:3] = reference + 0.3 * torch.randn(3, size, size)
    planes[3:6] = 0.09
    planes[18:21] = torch.where(half, 0.5 + 0.3 * torch.randn(size, size), texture)
    planes[21:24] = 1e-4
    features = torch.zeros(36, size, size)
    features[7], features[12] = planes[18], half.float()
    pool = pool_of(planes, reference, features)
    before = robust(relative_error(pool.noisy, pool.reference, pool.weight)).item()
    mean, deviation = pool.features.mean(0), pool.features.std(0)
    losses = {}
    models = {"network": Network(mean, deviation), "constant": Constant()}
    for name, model in models.items():
        optimiser = torch.optim.Adam(model.parameters(), 0.05)
        for _ in range(epochs):
            train_pool(model, optimiser, pool, 144)
        with torch.no_grad():
            losses[name] = robust(error(model, pool, slice(None))).item()
    assert losses["network"] < 0.5 * before
    assert losses["network"] < 0.9 * losses["constant"], losses
    return models["network"], losses["network"]


def test_training_is_deterministic():
    one, other = overfit(12), overfit(12)
    assert one[1] == other[1]
    for a, b in zip(one[0].parameters(), other[0].parameters(), strict=True):
        assert torch.equal(a, b)


def test_weights_survive_their_file(tmp_path):
    network = random_network(dtype=torch.float32)
    network.write(tmp_path / "weights.json", [str(index) for index in range(36)], {})
    features = torch.rand(9, 36)
    torch.testing.assert_close(
        Network.read(tmp_path / "weights.json")(features), network(features), rtol=1e-5, atol=1e-6
    )
    record = json.loads((tmp_path / "weights.json").read_text()) | {"version": 9}
    (tmp_path / "weights.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=r"weights\.json: version 9"):
        Network.read(tmp_path / "weights.json")


def test_a_network_starts_at_its_start_where_all_is_average():
    torch.manual_seed(1)
    network = Network(torch.rand(36), torch.rand(36))
    found = network(network.mean.expand(1, 36))[0]
    torch.testing.assert_close(found, torch.tensor(START), rtol=1e-4, atol=1e-6)


def test_the_fixture_for_rust_is_what_python_computes():
    # Rust compares itself with the file in `denoise/src/bilateral/tests/fixture.rs`.
    found = json.loads(make_bilateral_fixture.FIXTURE.read_text())
    expected = make_bilateral_fixture.fixture()
    assert found["weights"] == expected["weights"] and found["size"] == expected["size"]
    for name in ("planes", "features", "multipliers", "filtered"):
        torch.testing.assert_close(torch.tensor(found[name]), torch.tensor(expected[name]), rtol=1e-5, atol=1e-6)
