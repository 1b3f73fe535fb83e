"""`train.py kpcn`: trains a pair of kernel-predicting networks."""

import argparse
import dataclasses
import json
import math
import os
import platform
import subprocess
import time
from pathlib import Path

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from quietlight_training import examples, log, losses, plots, scores
from quietlight_training.batches import PatchSampler
from quietlight_training.checkpoint import FILE, Checkpoint
from quietlight_training.config import Config, OptimiserConfig, read_config
from quietlight_training.denoiser import Denoiser
from quietlight_training.onnx_model import read_denoiser

# Rows of the log, in steps: frequent enough for a plot, seldom enough for means that say something.
LOG_STEPS = 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `train.py kpcn`."""
    parser.add_argument("--config", type=Path, required=True, help="TOML file of the run, as in configs/")
    parser.add_argument("--data", type=Path, required=True, help="folder written by preprocess.py")
    parser.add_argument("--output", type=Path, required=True, help="folder of the run; one with a checkpoint goes on")
    parser.add_argument(
        "--initial",
        type=Path,
        help="checkpoint, or ONNX file of either branch, to start from: of this network or a narrower one",
    )
    parser.add_argument("--minutes", type=float, help="time to train in all, instead of the configured steps")
    parser.add_argument("--steps", type=int, help="steps in all, instead of the configured ones")
    parser.add_argument("--threads", type=int, help="threads (torch's choice if not given)")
    parser.add_argument("--save-minutes", type=float, default=5.0, help="time between checkpoints")
    parser.add_argument("--validate-minutes", type=float, default=5.0, help="time between validations")
    parser.add_argument("--validation-images", type=int, default=32, help="held-out images in a validation")


def run(args: argparse.Namespace) -> None:
    """Trains until the steps or minutes are used up."""
    if args.threads:
        torch.set_num_threads(args.threads)
    config = read_config(args.config)
    if args.steps is not None:
        config = dataclasses.replace(config, optimiser=dataclasses.replace(config.optimiser, steps=args.steps))
    is_distributed = "WORLD_SIZE" in os.environ
    if is_distributed:
        distributed.init_process_group("nccl" if torch.cuda.is_available() else "gloo")
    try:
        Training(config, args).run()
    finally:
        if is_distributed:
            distributed.destroy_process_group()


class Training:
    """One run: its data, networks and optimiser, and the folder it writes to."""

    def __init__(self, config: Config, args: argparse.Namespace):
        self.config = config
        self.args = args
        self.rank = distributed.get_rank() if distributed.is_initialized() else 0
        self.device = torch.device("cuda", self.rank) if torch.cuda.is_available() else torch.device("cpu")
        self.read_data()

        torch.manual_seed(config.seed)
        self.denoiser = Denoiser(config.network, bf16=config.optimiser.bf16)
        self.denoiser.to(self.device, memory_format=torch.channels_last)
        self.average = Denoiser(config.network).to(self.device, memory_format=torch.channels_last).eval()
        self.average.load_state_dict(self.denoiser.state_dict())
        options = config.optimiser
        self.optimiser = torch.optim.AdamW(
            self.denoiser.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay
        )
        self.step = 0
        self.seconds = 0.0
        args.output.mkdir(parents=True, exist_ok=True)
        self.restore()
        self.module: nn.Module = self.denoiser
        if distributed.is_initialized():
            self.module = DistributedDataParallel(self.denoiser)

    def read_data(self) -> None:
        """Reads the index of the examples, which may grow while the run lasts."""
        every = examples.read_index(self.args.data)
        training = [example for example in every if example.split == "train"]
        held_out = [example for example in every if example.split == "validation"]
        is_log_specular = self.config.network.kind == "kernel"
        self.sampler = PatchSampler(self.args.data, training, self.config.augmentation, is_log_specular)
        self.validation = scores.choose(held_out, self.args.validation_images)
        self.provenance = provenance(self.args.data, every)

    def restore(self) -> None:
        """Goes on from the run's checkpoint, or starts from the weights of `--initial`."""
        path = self.args.output / FILE
        if path.exists():
            checkpoint = Checkpoint.load(path)
            if checkpoint.config.network != self.config.network:
                raise ValueError(f"{path}: another network than the configuration's: {checkpoint.config.network}")
            self.denoiser.load_state_dict(checkpoint.weights)
            self.average.load_state_dict(checkpoint.average)
            self.optimiser.load_state_dict(checkpoint.optimiser)
            self.step, self.seconds = checkpoint.step, checkpoint.seconds
        elif self.args.initial:
            is_file = self.args.initial.suffix == ".onnx"
            self.denoiser.start_from(
                read_denoiser(self.args.initial) if is_file else Checkpoint.load(self.args.initial).denoiser()
            )
            self.average.load_state_dict(self.denoiser.state_dict())
        if self.rank == 0:
            for name in ("training.csv", "validation.csv"):
                log.truncate(self.args.output / name, self.step)
            text = json.dumps(dataclasses.asdict(self.config), indent=2)
            examples.write_text(self.args.output / "config.json", text + "\n")

    def progress(self) -> float:
        """How much of the run is done, in [0, 1]: of its minutes if it has any, else of its steps."""
        if self.args.minutes is not None:
            return min(1.0, self.seconds / (60 * self.args.minutes))
        return min(1.0, self.step / self.config.optimiser.steps)

    def run(self) -> None:
        """Steps, logs, validates and saves until the end."""
        started, already = time.monotonic(), self.seconds
        saved = validated = self.seconds
        rows: list[dict[str, float]] = []
        if self.is_done():
            return
        while True:
            terms = self.train_step()
            self.seconds = already + time.monotonic() - started
            rows.append(terms)
            if self.step % LOG_STEPS == 0:
                self.log_training({name: sum(row[name] for row in rows) / len(rows) for name in terms})
                rows = []
            if self.is_done():
                break
            if self.seconds - validated > 60 * self.args.validate_minutes:
                self.validate()
                validated = self.seconds
            if self.seconds - saved > 60 * self.args.save_minutes:
                self.save()
                self.read_data()
                saved = self.seconds
        self.validate()
        self.save()

    def is_done(self) -> bool:
        """Whether to stop. All processes must agree, so the first one's clock decides."""
        done = torch.tensor(self.progress() >= 1.0, dtype=torch.uint8)
        if distributed.is_initialized():
            done = done.to(self.device)
            distributed.broadcast(done, 0)
        return bool(done)

    def train_step(self) -> dict[str, float]:
        """One step of the optimiser; returns the loss and its terms."""
        options = self.config.optimiser
        learning_rate = scheduled(options, self.step, self.progress())
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate
        batch = self.sampler.batch(options.batch, self.config.seed, self.rank, self.step)
        buffers = batch.buffers.map(lambda tensor: tensor.to(self.device))
        denoised = self.module(buffers, batch.scale.to(self.device))
        total, terms = losses.loss(denoised, batch.target.to(self.device), self.config.loss)
        self.optimiser.zero_grad()
        total.backward()
        norm = nn.utils.clip_grad_norm_(self.denoiser.parameters(), options.largest_gradient).item()
        # One broken batch must not cost the run.
        if math.isfinite(norm):
            self.optimiser.step()
            self.update_average()
        self.step += 1
        prefixed = {f"{name}_loss": value for name, value in terms.items()}
        return {"loss": total.item(), **prefixed, "gradient": norm, "learning_rate": learning_rate}

    def update_average(self) -> None:
        """Moves the averaged weights; faster in the beginning, when the average is mostly the random start."""
        decay = min(self.config.optimiser.average_decay, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for average, weight in zip(self.average.parameters(), self.denoiser.parameters(), strict=True):
                average.lerp_(weight, 1 - decay)

    def log_training(self, means: dict[str, float]) -> None:
        """Appends to `training.csv` and says how it goes."""
        if self.rank != 0:
            return
        log.append(self.args.output / "training.csv", {"step": self.step, "seconds": round(self.seconds, 1), **means})
        print(
            f"step {self.step} {self.seconds / 60:.1f} min {100 * self.progress():.1f} % "
            + " ".join(f"{name} {value:.4g}" for name, value in means.items()),
            flush=True,
        )

    def validate(self) -> None:
        """Scores the averaged weights on held-out images, appends to `validation.csv` and redraws the plot."""
        if self.rank != 0 or not self.validation:
            return
        summaries = scores.summarise(
            scores.score(
                lambda batch: self.average(
                    batch.buffers.map(lambda tensor: tensor.to(self.device)), batch.scale.to(self.device)
                ).radiance.cpu(),
                self.args.data,
                self.validation,
                self.sampler.is_log_specular,
            )
        )
        row: dict[str, object] = {"step": self.step, "seconds": round(self.seconds, 1)}
        for summary in summaries:
            row[f"relative L2 ratio {summary.name}"] = summary.relative_l2_ratio
            row[f"1-SSIM ratio {summary.name}"] = summary.dissimilarity_ratio
        log.append(self.args.output / "validation.csv", row)
        print(f"step {self.step}: held-out images\n{scores.table(summaries)}", flush=True)
        plots.plot_run(
            log.read(self.args.output / "training.csv"),
            log.read(self.args.output / "validation.csv"),
            self.args.output / "loss.png",
        )

    def save(self) -> None:
        """Writes the checkpoint."""
        if self.rank != 0:
            return
        Checkpoint(
            config=self.config,
            step=self.step,
            seconds=self.seconds,
            weights=self.denoiser.state_dict(),
            average=self.average.state_dict(),
            optimiser=self.optimiser.state_dict(),
            provenance=self.provenance,
        ).save(self.args.output / FILE)


def scheduled(options: OptimiserConfig, step: int, progress: float) -> float:
    """Learning rate: a linear warm-up over steps, then half a cosine over the run's progress."""
    cosine = 0.5 * (1 + math.cos(math.pi * progress))
    rate = options.final_learning_rate + (options.learning_rate - options.final_learning_rate) * cosine
    return rate * min(1.0, (step + 1) / max(options.warm_up, 1))


def provenance(data: Path, every: list[examples.Example]) -> dict[str, object]:
    """Where the weights come from, for the model's card."""
    commit = subprocess.run(
        ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return {
        "data": str(data),
        "examples": len(every),
        "scenes": len({example.scene_key for example in every}),
        "held_out_examples": sum(example.split == "validation" for example in every),
        "commit": commit.stdout.strip() or "unknown",
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "torch": str(torch.__version__),
    }
