"""The settings of a training run, read from a TOML file and stored beside its result."""

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from quietlight_training.augment import Augmentation

KINDS = ("kernel_pyramid", "kernel")


@dataclass(frozen=True)
class NetworkConfig:
    """Which network, and its sizes."""

    kind: str
    """`kernel_pyramid` or `kernel` (Bako et al. 2017)."""
    widths: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Of a kernel pyramid: channels at 1/2, 1/4, 1/8 and 1/16 of the resolution."""
    depth: int = 0
    """Of a single kernel: convolutions."""
    width: int = 0
    """Of a single kernel: channels between them."""
    filter_size: int = 0
    """Of a single kernel: side of the convolutions."""
    taps: int = 0
    """Of a single kernel: side of the predicted kernel."""


@dataclass(frozen=True)
class OptimiserConfig:
    """How weights are learned: AdamW with a linear warm-up and a cosine to nearly zero."""

    steps: int = 20_000
    batch: int = 8
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-6
    warm_up: int = 200
    weight_decay: float = 1e-4
    largest_gradient: float = 1.0
    """Gradients of a larger norm are scaled down to it."""
    average_decay: float = 0.999
    """Of the exponential moving average of the weights, which is what gets exported."""
    bf16: bool = True
    """Convolutions in bfloat16; kernels and losses stay in float32."""


@dataclass(frozen=True)
class LossConfig:
    """Weights of the terms of the loss; see `losses`."""

    branches: float = 1.0
    relative_l2: float = 3.0
    dissimilarity: float = 1.0
    shown: float = 1.0
    radiance: float = 0.0


@dataclass(frozen=True)
class Config:
    """A training run."""

    name: str
    """The tier: `fast`, `balanced`, ..."""
    network: NetworkConfig
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    augmentation: Augmentation = field(default_factory=Augmentation)
    seed: int = 1


def read_config(path: Path) -> Config:
    """Reads a TOML file. Raises `ValueError`, naming the file and the key, where a key is unknown or missing."""
    try:
        table = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: {error}") from error
    return config_of(table, str(path))


def config_of(table: dict[str, Any], place: str) -> Config:
    """The configuration that a table describes; `place` is named in errors."""
    config = _build(Config, table, place)
    if config.network.kind not in KINDS:
        raise ValueError(f"{place}: network.kind is {config.network.kind!r}, expected one of {KINDS}")
    return config


def _build(kind: type, table: dict[str, Any], place: str) -> Any:
    known = {entry.name: entry for entry in dataclasses.fields(kind)}
    for key in table:
        if key not in known:
            raise ValueError(f"{place}: unknown key {key}, expected one of {sorted(known)}")
    values = {}
    for name, entry in known.items():
        if name in table:
            value = table[name]
            if dataclasses.is_dataclass(entry.type):
                value = _build(entry.type, value, f"{place}: {name}")
            elif isinstance(value, list):
                value = tuple(value)
            values[name] = value
        elif entry.default is dataclasses.MISSING and entry.default_factory is dataclasses.MISSING:
            raise ValueError(f"{place}: expected a key {name}")
    return kind(**values)
