"""The network that chooses the filter's multipliers from the secondary features of a pixel (METHODS 9.5).

36 inputs in units of their standard deviation in training, 10 hidden units (sigmoid), 6 outputs (softplus). The same
formulas as `denoise/src/bilateral/mlp.rs`, which reads the weights.
"""

import json
import math
from pathlib import Path

import torch
from torch import Tensor, nn

FEATURES, HIDDEN, OUTPUTS = 36, 10, 6
VERSION = 1
# Added to the standard deviations.
DEVIATION_EPSILON = 1e-6
# Features farther from their mean than this many standard deviations count as that far.
FARTHEST = 10.0
# Arguments of the softplus are clamped to this: λ stays below 10.00005.
ARGUMENT = (-80.0, 10.0)
# Multipliers where training starts: λ₀ to λ₅, λ_c.
START = (0.05, 0.01, 0.01, 0.03, 0.01, 0.03, 0.2)


def softplus(x: Tensor) -> Tensor:
    """`ln(1 + e^x)` without an exponential that overflows."""
    return torch.logaddexp(x, torch.zeros_like(x))


def inverse_softplus(value: float) -> float:
    """The argument whose softplus is `value`."""
    return value + math.log(-math.expm1(-value))


class Network(nn.Module):
    """Multipliers `[pixels, 7]` from secondary features `[pixels, 36]`; λ_c is one number for all pixels."""

    def __init__(self, mean: Tensor, deviation: Tensor, start: tuple[float, ...] = START) -> None:
        super().__init__()
        self.register_buffer("mean", mean.clone())
        self.register_buffer("deviation", deviation.clone())
        self.hidden = nn.Linear(FEATURES, HIDDEN)
        self.output = nn.Linear(HIDDEN, OUTPUTS)
        self.log_colour = nn.Parameter(torch.tensor(math.log(start[6])))
        for layer in (self.hidden, self.output):
            bound = math.sqrt(6 / (layer.in_features + layer.out_features))
            nn.init.uniform_(layer.weight, -bound, bound)
            nn.init.zeros_(layer.bias)
        with torch.no_grad():
            # At the mean of all features every hidden unit is 1/2.
            wanted = torch.tensor([inverse_softplus(value) for value in start[:6]])
            self.output.bias.copy_(wanted - 0.5 * self.output.weight.sum(1))

    def forward(self, features: Tensor) -> Tensor:
        normalised = ((features - self.mean) / (self.deviation + DEVIATION_EPSILON)).clamp(-FARTHEST, FARTHEST)
        argument = self.output(torch.sigmoid(self.hidden(normalised))).clamp(*ARGUMENT)
        colour = self.log_colour.exp().expand(len(features), 1)
        return torch.cat((softplus(argument), colour), 1)

    def write(self, path: Path, names: list[str], provenance: dict[str, object]) -> None:
        """Writes the weights as the program embeds them."""

        def numbers(tensor: Tensor) -> list:
            return json.loads(
                json.dumps(tensor.detach().double().tolist()), parse_float=lambda text: float(f"{float(text):.7g}")
            )

        record = {
            "version": VERSION,
            "features": names,
            "mean": numbers(self.mean),
            "std": numbers(self.deviation),
            "w1": numbers(self.hidden.weight),
            "b1": numbers(self.hidden.bias),
            "w2": numbers(self.output.weight),
            "b2": numbers(self.output.bias),
            "colour": float(f"{self.log_colour.exp().item():.7g}"),
            "provenance": provenance,
        }
        path.write_text(json.dumps(record, indent=1) + "\n")

    @classmethod
    def read(cls, path: Path) -> "Network":
        """Reads what `write` wrote. Raises `ValueError`, naming the file, where it is of another version."""
        record = json.loads(path.read_text())
        if record.get("version") != VERSION:
            raise ValueError(f"{path}: version {record.get('version')}, expected {VERSION}")
        network = cls(torch.tensor(record["mean"]), torch.tensor(record["std"]))
        with torch.no_grad():
            for target, name in (
                (network.hidden.weight, "w1"),
                (network.hidden.bias, "b1"),
                (network.output.weight, "w2"),
                (network.output.bias, "b2"),
            ):
                target.copy_(torch.tensor(record[name]))
            network.log_colour.fill_(math.log(record["colour"]))
        return network


class Constant(nn.Module):
    """The same seven multipliers everywhere: what the network must beat."""

    def __init__(self, start: tuple[float, ...] = START) -> None:
        super().__init__()
        self.logarithms = nn.Parameter(torch.tensor(start).log())

    def forward(self, features: Tensor) -> Tensor:
        return self.logarithms.exp().expand(len(features), len(self.logarithms))
