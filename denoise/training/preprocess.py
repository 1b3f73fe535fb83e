#!/usr/bin/env python3
"""Turn the views of data sets into training examples: `preprocess.py DATASET... OUT`.

Can be stopped and run again while a data set grows: views that are done are left as they are. An example has the name
of its data set's folder and of its view, so two data sets whose folders have one name are refused.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from tqdm import tqdm

from quietlight_training.examples import read_sources, write_example, write_index
from quietlight_training.views import View, read_views


def process(view: View, output: Path, patch_size: int, candidates: int) -> str | None:
    """Writes one example; what is wrong with the view, if it cannot be trained on."""
    try:
        write_example(view, output, patch_size, candidates)
    except ValueError as error:
        return str(error)
    return None


def named(folders: list[Path], output: Path) -> dict[str, str]:
    """The data sets' folders by the names that their examples get. Raises `ValueError` where another folder has one."""
    known, sources = read_sources(output), {}
    for folder in map(Path.resolve, folders):
        other = sources.get(folder.name, known.get(folder.name, str(folder)))
        if other != str(folder):
            raise ValueError(f"data sets of one name would replace each other's examples: {other} and {folder}")
        sources[folder.name] = str(folder)
    return sources


def main(arguments: list[str] | None = None) -> int:
    """Parses the command line, runs and returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", type=Path, nargs="+", help="folders written by `quietlight dataset`")
    parser.add_argument("output", type=Path, help="folder for the examples")
    parser.add_argument("--patch-size", type=int, default=112, help="pixels of a side (default 112)")
    parser.add_argument("--candidates", type=int, default=16, help="places tried in a view for a patch (default 16)")
    parser.add_argument("--processes", type=int, default=2, help="processes (default 2)")
    args = parser.parse_args(arguments)
    try:
        sources = named(args.datasets, args.output)
        views = [
            replace(view, id=f"{name}-{view.id}")
            for name, folder in sources.items()
            for view in read_views(Path(folder))
        ]
        args.output.mkdir(parents=True, exist_ok=True)
        # Before the examples, lest another data set takes the name when this is interrupted.
        write_index(args.output, sources)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    waiting = [view for view in views if not (args.output / f"{view.id}.json").exists()]
    work = partial(process, output=args.output, patch_size=args.patch_size, candidates=args.candidates)
    refused = 0
    with ProcessPoolExecutor(args.processes, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        results = pool.map(work, waiting) if args.processes > 1 else map(work, waiting)
        for fault in tqdm(results, total=len(waiting), unit="view", disable=None):
            if fault is not None:
                refused += 1
                print(f"left out: {fault}", file=sys.stderr)
    examples = write_index(args.output)
    held_out = sum(example.split == "validation" for example in examples)
    print(f"{args.output}: {len(examples)} examples, {held_out} of them for validation; {refused} views left out")
    return 0


if __name__ == "__main__":
    sys.exit(main())
