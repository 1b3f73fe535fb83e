"""`evaluate.py kpcn`: scores of a checkpoint or of weight files on held-out views, by sample count."""

import argparse
import dataclasses
import json
from pathlib import Path

import torch

from quietlight_training import onnx_model, scores
from quietlight_training.checkpoint import Checkpoint
from quietlight_training.denoiser import BRANCHES
from quietlight_training.examples import read_index, write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `evaluate.py kpcn`."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--checkpoint", type=Path, help="checkpoint, or the folder of a run")
    source.add_argument("--models", type=Path, help="folder of weight files, such as models/, with --tier")
    parser.add_argument("--tier", default="balanced", help="tier of the weight files")
    parser.add_argument("--data", type=Path, required=True, help="folder written by preprocess.py")
    parser.add_argument("--split", default="validation", choices=("validation", "train"), help="which views")
    parser.add_argument("--limit", type=int, help="noisy images at most, spread over the sample counts")
    parser.add_argument("--threads", type=int, default=2, help="threads")
    parser.add_argument("--json", type=Path, help="file for the score of every image")


def run(args: argparse.Namespace) -> None:
    """Prints a table and writes the scores."""
    torch.set_num_threads(args.threads)
    if args.checkpoint:
        denoiser = Checkpoint.load(args.checkpoint).denoiser()
    else:
        paths = {branch: args.models / f"kpcn-{args.tier}-{branch}.onnx" for branch in BRANCHES}
        denoiser = onnx_model.load_denoiser(paths, args.threads)
    pairs = scores.choose(read_index(args.data, args.split), args.limit)
    if not pairs:
        raise ValueError(f"{args.data}: no examples of the split {args.split}")
    results = scores.score(
        lambda batch: denoiser(batch.buffers, batch.scale).radiance, args.data, pairs, denoiser.config.kind == "kernel"
    )
    print(scores.table(scores.summarise(results)))
    if args.json:
        write_text(args.json, json.dumps([dataclasses.asdict(result) for result in results], indent=1) + "\n")
