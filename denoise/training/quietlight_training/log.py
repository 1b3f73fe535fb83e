"""A run's log: rows of a CSV file, one appended at a time."""

import csv
from pathlib import Path


def append(path: Path, row: dict[str, object]) -> None:
    """Appends a row; the first one brings the header, later ones must have its keys."""
    is_new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, row.keys())
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def read(path: Path) -> list[dict[str, float]]:
    """All rows; empty where there is no log."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def truncate(path: Path, step: int) -> None:
    """Drops the rows after a step, which a run that resumes from there will write anew."""
    rows = [row for row in read(path) if row["step"] <= step]
    path.unlink(missing_ok=True)
    for row in rows:
        append(path, row | {"step": int(row["step"])})
