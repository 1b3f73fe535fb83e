"""The rendered views of a data set: a folder as `quietlight dataset` writes it.

    DIR/manifest.json            settings of the whole set
    DIR/views/ID/view.json       one view; written last, so that its presence means the view is complete
    DIR/views/ID/noisy-N.exr     noisy renders with variances and halves
    DIR/views/ID/reference.exr   the converged render, of an independent seed
"""

import json
from dataclasses import dataclass
from pathlib import Path

SPLITS = ("train", "validation")


@dataclass(frozen=True)
class NoisyImage:
    """A noisy render: its file, samples per pixel and seed."""

    path: Path
    spp: int
    seed: int


@dataclass(frozen=True)
class View:
    """One view of a scene with its noisy renders and its reference."""

    id: str
    scene_key: str
    """Identity of the whole scene; all views of a scene are on the same side of the split."""
    split: str
    tags: tuple[str, ...]
    noisy: tuple[NoisyImage, ...]
    reference: Path
    reference_spp: int
    reference_relative_l2_noise: float
    """Relative L2 of the noise that is left in the reference, estimated by the renderer."""


def read_view(path: Path) -> View:
    """Reads a `view.json`. Raises `ValueError`, naming the file, where something is missing or of the wrong kind."""
    try:
        record = json.loads(path.read_text())
        folder = path.parent
        noisy = tuple(
            NoisyImage(folder / image["file"], int(image["spp"]), int(image["seed"])) for image in record["noisy"]
        )
        reference = record["reference"]
        view = View(
            id=record["id"],
            scene_key=str(record["scene_key"]),
            split=record["split"],
            tags=tuple(record.get("tags", ())),
            noisy=noisy,
            reference=folder / reference["file"],
            reference_spp=int(reference["spp"]),
            reference_relative_l2_noise=float(reference["relative_l2_noise"]),
        )
    except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a view: {error!r}") from error
    if view.split not in SPLITS:
        raise ValueError(f"{path}: split is {view.split!r}, expected one of {SPLITS}")
    return view


def read_views(folder: Path, split: str | None = None) -> list[View]:
    """All complete views of the data set `folder` in the order of their ids, or those of one split."""
    paths = sorted(folder.glob("views/*/view.json"))
    if not paths:
        raise ValueError(f"{folder}: expected a data set with views/ID/view.json, found none")
    views = [read_view(path) for path in paths]
    return [view for view in views if split in (None, view.split)]
