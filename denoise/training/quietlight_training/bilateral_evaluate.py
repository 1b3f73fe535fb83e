"""Scores the bilateral filter on held-out views: `evaluate.py bilateral DATASET WEIGHTS`."""

import argparse
import json
from pathlib import Path

import numpy as np

from quietlight_training.bilateral_data import run_example
from quietlight_training.views import read_views

# Samples per pixel of the rows of the table, from and to.
BINS = ((1, 4), (5, 16), (17, 64), (65, 256))
METHODS = ("noisy", "gaussian", "constant", "shipped_constant", "learned")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `evaluate.py bilateral`."""
    parser.add_argument("dataset", type=Path, help="folder written by `quietlight dataset`")
    parser.add_argument("weights", type=Path, help="bilateral.json as training wrote it")
    parser.add_argument("--json", type=Path, help="write the scores of all images there")


def choose_gaussian(scores: list[dict]) -> None:
    """Replaces the errors of all widths by that of the one best over these images: more than a user could know."""
    widths = np.array([score["gaussian"] for score in scores])
    noisy = np.array([[score["noisy"]] for score in scores])
    best = int(np.log(widths / noisy).mean(0).argmin())
    for score in scores:
        score["width"], score["gaussian"] = score["widths"][best], score["gaussian"][best]


def table(scores: list[dict]) -> str:
    """For each range of samples per pixel the mean relative L2 of each method, its geometric mean over that of the
    noisy image, and the part of the images on which the learned filter beats the method."""
    lines = [f"{'spp':>8} {'images':>6} " + " ".join(f"{name:>26}" for name in METHODS)]
    for first, last in (*BINS, (BINS[0][0], BINS[-1][1])):
        rows = [dict(score) for score in scores if first <= score["spp"] <= last]
        if not rows:
            continue
        choose_gaussian(rows)
        values = {name: np.array([row[name] for row in rows]) for name in METHODS}
        cells = []
        for name in METHODS:
            ratio = np.exp(np.log(values[name] / values["noisy"]).mean())
            beaten = (values["learned"] < values[name]).mean()
            cells.append(f"{values[name].mean():>10.3e} {ratio:>7.3f} {100 * beaten:>5.0f} %")
        lines.append(f"{f'{first}-{last}':>8} {len(rows):>6} " + " ".join(f"{cell:>26}" for cell in cells))
    lines.append("mean relative L2, geometric mean over noisy, images on which learned is better")
    return "\n".join(lines)


def run(args: argparse.Namespace) -> None:
    """Prints the table of the validation views."""
    record = json.loads(args.weights.read_text())
    images = [(view, noisy) for view in read_views(args.dataset, "validation") for noisy in view.noisy]
    pairs = [str(path.resolve()) for view, noisy in images for path in (noisy.path, view.reference)]
    constants = ",".join(str(value) for value in record["provenance"]["constants"])
    output = run_example("bilateral_scores", [str(args.weights.resolve()), constants, *pairs])
    scores = [json.loads(line) for line in output.splitlines()]
    for score, (view, noisy) in zip(scores, images, strict=True):
        score |= {"view": view.id, "spp": noisy.spp}
    if args.json:
        args.json.write_text(json.dumps(scores, indent=1) + "\n")
    print(table(scores))
