"""Trains the network of the bilateral filter: `train.py bilateral DATASET EXAMPLES RUN`."""

import argparse
import copy
import math
import os
import platform
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor, nn

from quietlight_training import log
from quietlight_training.bilateral_data import BALANCES, REPOSITORY, Pool, draw, feature_names, normalisation, prepare
from quietlight_training.bilateral_filter import Filter, relative_error
from quietlight_training.bilateral_network import Constant, Network
from quietlight_training.plots import plot_run
from quietlight_training.views import read_views

CHECKPOINT = "checkpoint.pt"
# A pixel's error counts up to this many times the mean of its batch: fireflies that no filter can mend would otherwise
# be all that the gradient knows.
ROBUST = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `train.py bilateral`."""
    parser.add_argument("dataset", type=Path, help="folder written by `quietlight dataset`")
    parser.add_argument("examples", type=Path, help="folder for the prepared images; what is there is used")
    parser.add_argument("run", type=Path, help="folder for checkpoint, log, plot and weights; a run there goes on")
    parser.add_argument("--rounds", type=int, default=4, help="times that pixels are drawn")
    parser.add_argument("--epochs", type=int, default=12, help="passes over the pixels of a round")
    parser.add_argument("--pixels", type=int, default=16, help="pixels drawn of each noisy image")
    parser.add_argument("--batch", type=int, default=512, help="pixels of a step")
    parser.add_argument("--rate", type=float, default=0.02, help="learning rate at the start; it falls to a tenth")
    parser.add_argument("--balance", choices=BALANCES, default="noise", help="what an image's error is measured by")
    parser.add_argument("--seed", type=int, default=0, help="of the weights and the pixels")
    parser.add_argument("--threads", type=int, default=1, help="threads of torch")


def error(model: nn.Module, pool: Pool, part: slice) -> Tensor:
    """The error of each pixel of a part of the pool, `[pixels]`."""
    filtered = Filter.apply(model(pool.features[part]), pool.distances[part], pool.colours[part])
    return relative_error(filtered, pool.reference[part], pool.weight[part])


def robust(errors: Tensor) -> Tensor:
    """Mean of the errors, none more than `ROBUST` times the mean."""
    return errors.clamp_max(ROBUST * errors.detach().mean()).mean()


def parts(pool: Pool, batch: int) -> Iterator[slice]:
    """Slices of at most `batch` pixels."""
    for start in range(0, len(pool.weight), batch):
        yield slice(start, start + batch)


@torch.no_grad()
def validate(model: nn.Module, pool: Pool, batch: int) -> float:
    """Error of the filter over that of the noisy images, on pixels held out."""
    filtered = torch.cat([error(model, pool, part) for part in parts(pool, batch)])
    return (robust(filtered) / robust(relative_error(pool.noisy, pool.reference, pool.weight))).item()


def train_pool(model: nn.Module, optimiser: torch.optim.Optimizer, pool: Pool, batch: int) -> float:
    """One pass over the pixels; the mean loss of its steps."""
    losses = []
    for part in parts(pool, batch):
        loss = robust(error(model, pool, part))
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        losses.append(loss.item())
    return sum(losses) / len(losses)


def rate_at(epoch: int, epochs: int) -> float:
    """The learning rate over that at the start: half a cosine from 1 to 0.1."""
    return 0.1 + 0.45 * (1 + math.cos(math.pi * epoch / epochs))


def commit() -> str:
    """The commit of the repository."""
    command = ["git", "rev-parse", "--short=12", "HEAD"]
    return subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False).stdout.strip()


def run(args: argparse.Namespace) -> None:
    """Trains the network and the constants it must beat, and writes the weights of the best epoch."""
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    args.run.mkdir(parents=True, exist_ok=True)
    training = prepare(read_views(args.dataset, "train"), args.examples)
    held_out = prepare(read_views(args.dataset, "validation"), args.examples)
    if not training or not held_out:
        raise ValueError(f"{args.dataset}: {len(training)} images to train and {len(held_out)} to validate on")
    checkpoint = args.run / CHECKPOINT
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        mean, deviation = state["mean"], state["deviation"]
    else:
        mean, deviation = normalisation(training)
        state = {"round": 0, "seconds": 0.0, "mean": mean, "deviation": deviation, "best": {}}
    models = {"network": Network(mean, deviation), "constant": Constant()}
    optimisers = {name: torch.optim.Adam(model.parameters(), args.rate) for name, model in models.items()}
    for name, model in models.items():
        if name in state:
            model.load_state_dict(state[name])
            optimisers[name].load_state_dict(state[f"{name}_optimiser"])
    best = state["best"]
    # Rows of a round that was not finished are written anew.
    log.truncate(args.run / "log.csv", state["round"] * args.epochs)

    validation = draw(held_out, 4 * args.pixels, args.seed + 1_000_000, args.balance)
    epochs = args.rounds * args.epochs
    for number in range(state["round"], args.rounds):
        start = time.process_time()
        pool = draw(training, args.pixels, args.seed + number, args.balance)
        for epoch in range(number * args.epochs, (number + 1) * args.epochs):
            row: dict[str, object] = {"step": epoch + 1}
            for name, model in models.items():
                for group in optimisers[name].param_groups:
                    group["lr"] = args.rate * rate_at(epoch, epochs)
                row[f"{name}_loss"] = train_pool(model, optimisers[name], pool, args.batch)
                ratio = row[f"{name}_ratio"] = validate(model, validation, args.batch)
                if name not in best or ratio < best[name]["ratio"]:
                    best[name] = {"ratio": ratio, "epoch": epoch + 1, "weights": copy.deepcopy(model.state_dict())}
            log.append(args.run / "log.csv", row)
            print(" ".join(f"{key} {value:.4g}" for key, value in row.items()), flush=True)
        state = {"round": number + 1, "mean": mean, "deviation": deviation, "best": best} | {
            "seconds": state["seconds"] + time.process_time() - start
        }
        for name, model in models.items():
            state |= {name: model.state_dict(), f"{name}_optimiser": optimisers[name].state_dict()}
        torch.save(state, args.run / "checkpoint.tmp")
        os.replace(args.run / "checkpoint.tmp", checkpoint)
    rows = log.read(args.run / "log.csv")
    plot_run(rows, rows, args.run / "loss.png")

    models["network"].load_state_dict(best["network"]["weights"])
    models["constant"].load_state_dict(best["constant"]["weights"])
    constants = [float(f"{value:.4g}") for value in models["constant"].logarithms.detach().exp()]
    provenance = {
        "data": f"{len(training)} noisy images to train on, {len(held_out)} held out, from {args.dataset}",
        "options": {name: str(value) for name, value in vars(args).items()},
        "best_epoch": best["network"]["epoch"],
        "cpu_seconds": round(state["seconds"], 1),
        "machine": f"{platform.processor() or platform.machine()}, {args.threads} thread",
        "torch": torch.__version__,
        "commit": commit(),
        "validation_ratio": round(best["network"]["ratio"], 5),
        "constants": constants,
        "constants_validation_ratio": round(best["constant"]["ratio"], 5),
    }
    models["network"].write(args.run / "bilateral.json", feature_names(args.examples), provenance)
    print(f"{args.run}/bilateral.json: validation ratio {best['network']['ratio']:.4f} at epoch ", end="")
    print(f"{best['network']['epoch']}; constants {constants}: {best['constant']['ratio']:.4f}")
