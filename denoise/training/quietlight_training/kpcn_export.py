"""`export.py kpcn`: weight files of a checkpoint for the renderer, checked against torch, and their entries in
`models.json`."""

import argparse
import json
from pathlib import Path

import torch

from quietlight_training import onnx_model, quantise
from quietlight_training.checkpoint import Checkpoint
from quietlight_training.denoiser import BRANCHES
from quietlight_training.examples import read_index, write_text

# The exported graph computes the same sums in another order; more than this is another network (EVIDENCE 6: 1e-6).
LARGEST_DIFFERENCE = 1e-5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `export.py kpcn`."""
    parser.add_argument("--checkpoint", type=Path, required=True, help="checkpoint, or the folder of a run")
    parser.add_argument("--output", type=Path, required=True, help="folder of the weight files, such as models/")
    parser.add_argument("--tier", help="name of the tier (the configuration's if not given)")
    parser.add_argument("--full-precision", action="store_true", help="store float32 weights instead of float16")
    parser.add_argument("--int8", action="store_true", help="quantise to int8 (needs --data to calibrate)")
    parser.add_argument("--data", type=Path, help="folder written by preprocess.py, for --int8")
    parser.add_argument("--calibration-images", type=int, default=24, help="training images for --int8")


def run(args: argparse.Namespace) -> None:
    """Writes `kpcn-TIER-BRANCH.onnx` for both branches and their entries in `models.json`."""
    checkpoint = Checkpoint.load(args.checkpoint)
    config = checkpoint.config.network
    tier = args.tier or checkpoint.config.name
    denoiser = checkpoint.denoiser()
    if not args.full_precision:
        onnx_model.round_weights(denoiser)
    if args.int8:
        if args.data is None:
            raise ValueError("--int8 needs --data, training examples to calibrate with")
        calibration = quantise.calibration_inputs(
            denoiser, args.data, read_index(args.data, "train"), args.calibration_images
        )
    args.output.mkdir(parents=True, exist_ok=True)
    entries = {}
    for branch in BRANCHES:
        network = getattr(denoiser, branch)
        model = onnx_model.to_onnx(network, config, tier, branch)
        if not args.full_precision and not args.int8:
            onnx_model.halve_weights(model)
        difference = check(model, network, onnx_model.input_channels(config))
        if args.int8:
            model = quantise.quantise(model, calibration[branch])
            onnx_model.describe(model, config, tier, branch)
            error = quantise.error(model, network, calibration[branch])
            print(f"{branch}: int8 changes the logits by {error:.4f} (root mean square)")
        name = f"kpcn-{tier}-{branch}"
        path = args.output / f"{name}.onnx"
        path.write_bytes(model.SerializeToString())
        entries[name] = {
            "file": path.name,
            "tier": tier,
            "branch": branch,
            "kind": config.kind,
            "sha256": onnx_model.sha256(path),
            "bytes": path.stat().st_size,
            "steps": checkpoint.step,
            "hours": round(checkpoint.seconds / 3600, 2),
            **checkpoint.provenance,
            # The folders above it are the machine's.
            "data": Path(checkpoint.provenance["data"]).name,
        }
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, onnxruntime differs from torch by {difference:.1e}")
    update_models(args.output / "models.json", entries)


def check(model: onnx_model.onnx.ModelProto, network: torch.nn.Module, channels: int) -> float:
    """Compares the model with its network on random input of two sizes; raises `ValueError` where they differ."""
    generator = torch.Generator().manual_seed(1)
    sizes = ((32, 32), (16, 56))
    difference = max(
        onnx_model.largest_difference(model, network, torch.randn(1, channels, *size, generator=generator))
        for size in sizes
    )
    if not difference <= LARGEST_DIFFERENCE:
        raise ValueError(
            f"the exported network differs from torch by {difference}, at most {LARGEST_DIFFERENCE} expected"
        )
    return difference


def update_models(path: Path, entries: dict[str, dict]) -> None:
    """Puts the entries into `models.json`, which maps a weight file's name to what is known of it."""
    models = json.loads(path.read_text()) if path.exists() else {}
    write_text(path, json.dumps(models | entries, indent=2, sort_keys=True) + "\n")
