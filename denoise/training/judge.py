#!/usr/bin/env python3
"""Judges denoisers on scenes none of them was trained on: relative L2 and 1 - SSIM against converged renders.

    python judge.py SCENES WORK [--binary target/release/quietlight] [--spp 4 16 64 256] [--reference-spp 2048]

SCENES is a folder with one folder a scene (`scene.xml`, and `reference.exr` for the size if there is one). Each scene
is rendered once converged and at each sample count with another seed into WORK (what is there is not rendered again),
denoised by every method, and scored by `quietlight compare`. Open Image Denoise takes part where `pyoidn` is installed:
colour, albedo and normal of the same noisy file, quality high. Writes WORK/scores.json and WORK/scores.md.
"""

import argparse
import importlib.util
import json
import math
import subprocess
import time
from pathlib import Path

import numpy as np
import OpenEXR

PROJECT = Path(__file__).resolve().parents[2]
REFERENCE_SEED = 777
NOISY_SEED = 11
OURS = {
    "constant": ["--denoiser", "bilateral-constant"],
    "learned": ["--denoiser", "bilateral"],
    "fast": ["--denoiser", "kpcn", "--quality", "fast"],
    "balanced": ["--denoiser", "kpcn", "--quality", "balanced"],
    "high": ["--denoiser", "kpcn", "--quality", "high"],
}


def run(command):
    """Runs a command; its standard output, or an error with what it printed."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}\n{done.stderr}")
    return done.stdout


def size_of(scene):
    """Width and height of the scene's reference image, or None."""
    path = scene / "reference.exr"
    if not path.exists():
        return None
    low, high = OpenEXR.File(str(path), header_only=True).header()["dataWindow"]
    return f"{high[0] - low[0] + 1}x{high[1] - low[1] + 1}"


def render(binary, scene, out, spp, seed):
    """Renders with all layers and halves, without denoising, unless the file is there."""
    if out.exists():
        return
    size = size_of(scene)
    run(
        [binary, "render", scene / "scene.xml", "--spp", spp, "--seed", seed, "--denoiser", "none"]
        + (["--size", size] if size else [])
        + ["--halves", "-o", out]
    )


def layer(channels, name, components):
    """A layer as [height, width, channel], or None."""
    names = [f"{name}.{component}" for component in components]
    if not all(name in channels for name in names):
        return None
    return np.ascontiguousarray(np.stack([channels[name].pixels for name in names], -1))


def open_image_denoise(noisy, out):
    """Denoises by Open Image Denoise from colour, albedo and normal; seconds of CPU of the call."""
    import pyoidn

    with OpenEXR.File(str(noisy), separate_channels=True) as file:
        channels = file.channels()
        colour = layer(channels, "noisy", "RGB")
        albedo = layer(channels, "albedo", "RGB")
        normal = layer(channels, "normal", "XYZ")
    start = time.process_time()
    picture = pyoidn.denoise(colour, albedo=albedo, normal=normal, hdr=True, quality="high")
    seconds = time.process_time() - start
    planes = {name: np.ascontiguousarray(picture[..., i]) for i, name in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(str(out))
    return seconds


def score(binary, image, reference, extra=()):
    """Relative L2 and 1 - SSIM by `quietlight compare`."""
    found = json.loads(run([binary, "compare", image, reference, "--json", *extra]))
    return {key: found[key] for key in ("relative_l2", "one_minus_ssim")}


def geometric_mean(values):
    """exp of the mean logarithm; values of zero count as 1e-12."""
    return math.exp(sum(math.log(max(value, 1e-12)) for value in values) / len(values))


def tables(scores, methods):
    """Markdown: per metric and sample count, one row a scene, and the geometric means as ratios to OIDN."""
    lines = []
    for metric in ("relative_l2", "one_minus_ssim"):
        for spp in sorted({row["spp"] for row in scores}):
            rows = [row for row in scores if row["spp"] == spp]
            lines += [f"\n### {metric}, {spp} samples per pixel\n", "| scene | " + " | ".join(methods) + " |"]
            lines.append("|---" * (len(methods) + 1) + "|")
            for row in rows:
                cells = [f"{row[method][metric]:.3g}" for method in methods]
                lines.append(f"| {row['scene']} | " + " | ".join(cells) + " |")
            for name, base in (("geometric mean / oidn", "oidn"), ("geometric mean / noisy", "noisy")):
                if base in methods:
                    means = [
                        geometric_mean([row[method][metric] / row[base][metric] for row in rows]) for method in methods
                    ]
                    lines.append(f"| {name} | " + " | ".join(f"{mean:.3f}" for mean in means) + " |")
            if "noisy" in methods:
                worse = [str(sum(row[method][metric] > row["noisy"][metric] for row in rows)) for method in methods]
                lines.append("| worse than noisy | " + " | ".join(worse) + " |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--binary", type=Path, default=PROJECT / "target/release/quietlight")
    parser.add_argument("--spp", type=int, nargs="+", default=[4, 16, 64, 256])
    parser.add_argument("--reference-spp", type=int, default=2048)
    parser.add_argument("--only", nargs="+", help="names of scenes [default: all]")
    others = ["oidn"] if importlib.util.find_spec("pyoidn") else []
    parser.add_argument("--methods", nargs="+", choices=["oidn", *OURS], default=[*others, *OURS])
    arguments = parser.parse_args()
    arguments.binary = arguments.binary.absolute()

    scenes = sorted(path.parent for path in arguments.scenes.glob("*/scene.xml"))
    scenes = [scene for scene in scenes if not arguments.only or scene.name in arguments.only]
    if not scenes:
        parser.error(f"{arguments.scenes}: no folder with a scene.xml")
    arguments.work.mkdir(parents=True, exist_ok=True)
    scores = []
    for scene in scenes:
        name = scene.name
        reference = arguments.work / f"{name}-ref.exr"
        render(arguments.binary, scene, reference, arguments.reference_spp, REFERENCE_SEED)
        for spp in arguments.spp:
            noisy = arguments.work / f"{name}-{spp}.exr"
            render(arguments.binary, scene, noisy, spp, NOISY_SEED)
            row = {"scene": name, "spp": spp, "noisy": score(arguments.binary, noisy, reference, ["--layer", "noisy"])}
            for method in arguments.methods:
                out = arguments.work / f"{name}-{spp}-{method}.exr"
                if method == "oidn":
                    seconds = open_image_denoise(noisy, out)
                else:
                    told = json.loads(
                        run([arguments.binary, "denoise", noisy, "-o", out, "--no-estimate", "--json", *OURS[method]])
                    )
                    seconds = told["denoise_seconds"]
                row[method] = score(arguments.binary, out, reference) | {"seconds": seconds}
            print(name, spp, *(f"{m} {row[m]['relative_l2']:.4g}" for m in ["noisy", *arguments.methods]), flush=True)
            scores.append(row)
    (arguments.work / "scores.json").write_text(json.dumps(scores, indent=1))
    (arguments.work / "scores.md").write_text(tables(scores, ["noisy", *arguments.methods]))


if __name__ == "__main__":
    main()
