"""The loss plot of a run."""

from pathlib import Path

from matplotlib.figure import Figure


def plot_run(training: list[dict[str, float]], validation: list[dict[str, float]], path: Path) -> None:
    """Draws the terms of the loss and the validation ratios over the steps, logarithmically, into a PNG."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    panels = ((training, "training loss", "loss"), (validation, "validation: denoised over noisy", "ratio"))
    for axes, (rows, title, wanted) in zip(figure.subplots(1, 2), panels, strict=True):
        names = [name for name in (rows[0] if rows else ()) if wanted in name]
        for name in names:
            axes.plot([row["step"] for row in rows], [row[name] for row in rows], label=name.replace("_", " "), lw=1)
        axes.set(title=title, xlabel="step", yscale="log")
        axes.grid(alpha=0.3, which="both")
        if names:
            axes.legend(fontsize="small")
    figure.savefig(path, dpi=100)
