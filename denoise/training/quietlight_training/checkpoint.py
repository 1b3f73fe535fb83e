"""What a run leaves: `checkpoint.pt`, replaced as a whole, from which training goes on and networks are exported."""

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from quietlight_training.config import Config, config_of
from quietlight_training.denoiser import Denoiser

FILE = "checkpoint.pt"


@dataclass
class Checkpoint:
    """The state of a run after `step` steps and `seconds` of training."""

    config: Config
    step: int
    seconds: float
    weights: dict[str, torch.Tensor]
    average: dict[str, torch.Tensor]
    """Exponential moving average of the weights."""
    optimiser: dict[str, Any]
    provenance: dict[str, Any]
    """What the card of the model will say: data, code, machine, versions."""

    def save(self, path: Path) -> None:
        """Writes the checkpoint whole or not at all."""
        record = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        record["config"] = dataclasses.asdict(self.config)
        temporary = path.with_name(path.name + ".tmp")
        torch.save(record, temporary)
        os.replace(temporary, path)

    @classmethod
    def load(cls, path: Path) -> "Checkpoint":
        """Reads a checkpoint, or that of a run's folder. Raises `ValueError`, naming the file, where it is none."""
        path = path / FILE if path.is_dir() else path
        try:
            record = torch.load(path, map_location="cpu", weights_only=True)
        except OSError:
            raise
        except Exception as error:  # The unpickler fails in many ways on what is no pickle.
            raise ValueError(f"{path}: not a checkpoint") from error
        if not isinstance(record, dict) or set(record) != {field.name for field in dataclasses.fields(cls)}:
            raise ValueError(f"{path}: not a checkpoint")
        record["config"] = config_of(record["config"], str(path))
        return cls(**record)

    def denoiser(self) -> Denoiser:
        """The denoiser with the averaged weights, for use."""
        denoiser = Denoiser(self.config.network)
        denoiser.load_state_dict(self.average)
        return denoiser.eval()
