"""The training loop: it learns, it resumes to the bit, it saves what it wrote."""

import argparse
import csv
import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch

import train
from quietlight_training import examples, losses
from quietlight_training.augment import Augmentation
from quietlight_training.batches import PatchSampler
from quietlight_training.checkpoint import FILE, Checkpoint
from quietlight_training.config import Config, LossConfig, NetworkConfig, OptimiserConfig, config_of, read_config
from quietlight_training.denoiser import Denoiser
from quietlight_training.kpcn_train import Training, scheduled
from quietlight_training.verbs import run_verb
from quietlight_training.views import read_views
from tests.conftest import random_buffers

CONFIGS = Path(train.__file__).parent / "configs"
PYRAMID = NetworkConfig("kernel_pyramid", widths=(4, 4, 4, 4))
KERNEL = NetworkConfig("kernel", depth=3, width=8, filter_size=3, taps=5)
UNCHANGED = Augmentation(other_renderer=0.0, input_exposure_stops=0.0, loss_exposure_stops=0.0)


@pytest.fixture(scope="session")
def data(dataset, tmp_path_factory) -> Path:
    """The data set, preprocessed into patches of 32² pixels."""
    folder = tmp_path_factory.mktemp("examples")
    for view in read_views(dataset):
        examples.write_example(view, folder, patch_size=32, candidates=6)
    examples.write_index(folder)
    return folder


def train_kpcn(config: Path, data: Path, output: Path, *options: str) -> int:
    arguments = ["kpcn", "--config", str(config), "--data", str(data), "--output", str(output), *options]
    return run_verb("train", train.SUBCOMMANDS, arguments)


def write_config(path: Path, network: NetworkConfig, **optimiser) -> Path:
    values = ", ".join(
        f"{name} = {list(value) if isinstance(value, tuple) else repr(value).replace(chr(39), chr(34))}"
        for name, value in asdict(network).items()
    )
    lines = [f"{name} = {str(value).lower()}" for name, value in optimiser.items()]
    path.write_text(f'name = "unit"\nnetwork = {{{values}}}\n[optimiser]\n' + "\n".join(lines) + "\n")
    return path


def test_every_configuration_is_read_and_builds_its_network():
    for path in sorted(CONFIGS.glob("*.toml")):
        config = read_config(path)
        if config.network.kind == "kernel" or sum(config.network.widths) < 300:
            Denoiser(config.network)
    assert {path.stem for path in CONFIGS.glob("*.toml")} >= {"fast", "balanced", "paper", "unit"}


def test_the_network_of_the_paper_has_its_parameters():
    # METHODS 10.3: 2 921 241 per branch at 27 channels.
    denoiser = Denoiser(read_config(CONFIGS / "paper.toml").network)
    assert sum(weight.numel() for weight in denoiser.diffuse.parameters()) == 2_921_241


@pytest.mark.parametrize("bf16", [False, True])
def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(data, tmp_path, monkeypatch, bf16):
    config = write_config(tmp_path / "unit.toml", PYRAMID, steps=6, batch=2, warm_up=2, bf16=bf16)
    assert train_kpcn(config, data, tmp_path / "whole") == 0
    # The schedule looks at the total, which the interrupted run must know too.
    whole_step = Training.train_step

    def interrupted(self):
        if self.step == 3:
            self.save()
            raise KeyboardInterrupt
        return whole_step(self)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Training, "train_step", interrupted)
        train_kpcn(config, data, tmp_path / "halves")
    assert Checkpoint.load(tmp_path / "halves").step == 3
    assert train_kpcn(config, data, tmp_path / "halves") == 0
    whole, halves = (Checkpoint.load(tmp_path / name) for name in ("whole", "halves"))
    assert whole.step == halves.step == 6
    for name, weight in whole.weights.items():
        assert torch.equal(weight, halves.weights[name]), name
        assert torch.equal(whole.average[name], halves.average[name]), name


def test_a_checkpoint_comes_back_bit_for_bit(tmp_path):
    denoiser = Denoiser(PYRAMID)
    optimiser = torch.optim.AdamW(denoiser.parameters())
    sum(weight.square().sum() for weight in denoiser.parameters()).backward()
    optimiser.step()
    config = Config("unit", PYRAMID, seed=3)
    weights = denoiser.state_dict()
    saved = Checkpoint(config, 5, 1.5, weights, weights, optimiser.state_dict(), {"data": "x"})
    saved.save(tmp_path / FILE)
    loaded = Checkpoint.load(tmp_path)
    assert (loaded.config, loaded.step, loaded.seconds, loaded.provenance) == (config, 5, 1.5, {"data": "x"})
    assert all(torch.equal(loaded.weights[name], weights[name]) for name in weights)
    for index, state in saved.optimiser["state"].items():
        assert all(torch.equal(value, loaded.optimiser["state"][index][name]) for name, value in state.items())
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


def fit(denoiser: Denoiser, batch, config: LossConfig, steps: int, rate: float) -> list[float]:
    """Losses of training on one batch over and over."""
    optimiser = torch.optim.AdamW(denoiser.parameters(), lr=rate, weight_decay=0)
    values = []
    for _ in range(steps):
        total, _ = losses.loss(denoiser(batch.buffers, batch.scale), batch.target, config)
        values.append(total.item())
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
    return values


@pytest.mark.parametrize("network", [PYRAMID, KERNEL], ids=["pyramid", "kernel"])
def test_one_patch_is_overfitted_and_fine_tuning_does_not_undo_it(data, network):
    sampler = PatchSampler(data, examples.read_index(data, "train"), UNCHANGED, network.kind == "kernel")
    batch = sampler.batch(1, seed=2, rank=0, step=0)
    denoiser = Denoiser(network)
    # Radiance is judged where noise weighs most, in the L2 that the goal is set in.
    joint = LossConfig(branches=0, relative_l2=1, dissimilarity=0, shown=0)
    values = fit(denoiser, batch, joint, 150, 2e-2)
    assert min(values[-10:]) < 0.25 * values[0], values[::10]
    start, *_, end = fit(denoiser, batch, joint, 10, 1e-5)
    assert end <= start


def test_a_widened_network_starts_as_the_narrow_one_and_learns_with_all_channels():
    narrow = Denoiser(replace(PYRAMID, widths=(4, 5, 6, 7)))
    wide = Denoiser(replace(PYRAMID, widths=(6, 9, 7, 12)))
    wide.start_from(narrow)
    buffers, scale = random_buffers(40, 24), torch.ones(1, 1, 1, 1)
    expected = narrow(buffers, scale).radiance.detach()
    assert torch.allclose(wide(buffers, scale).radiance, expected, atol=1e-6)
    before = {name: weight.detach().clone() for name, weight in wide.named_parameters()}
    optimiser = torch.optim.SGD(wide.parameters(), lr=0.1)
    for _ in range(2):
        optimiser.zero_grad()
        wide(buffers, scale).radiance.square().mean().backward()
        optimiser.step()
    assert all(not torch.equal(weight, before[name]) for name, weight in wide.named_parameters())
    with pytest.raises(ValueError, match="cannot be widened"):
        narrow.start_from(wide)
    with pytest.raises(ValueError, match="cannot become"):
        narrow.start_from(Denoiser(KERNEL))


def test_adam_takes_the_steps_computed_by_hand():
    # METHODS appendix G: m = .9 m + .1 g, v = .999 v + .001 g², step lr m̂/(√v̂ + 1e-8), decay of AdamW off.
    weight = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64))
    options = OptimiserConfig(learning_rate=0.1, weight_decay=0.0)
    optimiser = torch.optim.AdamW([weight], lr=options.learning_rate, weight_decay=options.weight_decay)
    x, m, v = 1.0, 0.0, 0.0
    for t in (1, 2, 3):
        gradient = 3 * x * x
        optimiser.zero_grad()
        (weight**3).sum().backward()
        optimiser.step()
        m, v = 0.9 * m + 0.1 * gradient, 0.999 * v + 0.001 * gradient**2
        x -= 0.1 * (m / (1 - 0.9**t)) / (math.sqrt(v / (1 - 0.999**t)) + 1e-8)
        assert weight.item() == pytest.approx(x, rel=1e-12)


def test_the_learning_rate_warms_up_and_ends_low():
    options = OptimiserConfig(learning_rate=1.0, final_learning_rate=0.01, warm_up=10)
    assert scheduled(options, 0, 0.0) == pytest.approx(0.1)
    assert scheduled(options, 9, 0.0) == pytest.approx(1.0)
    assert scheduled(options, 500, 0.5) == pytest.approx(0.505)
    assert scheduled(options, 500, 1.0) == pytest.approx(0.01)


def test_a_run_leaves_its_configuration_logs_and_plot(data, tmp_path):
    config = write_config(tmp_path / "unit.toml", PYRAMID, steps=50, batch=1, warm_up=2)
    assert train_kpcn(config, data, tmp_path / "run", "--validation-images", "2") == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"config.json", "training.csv", "validation.csv", "loss.png", FILE}
    rows = list(csv.DictReader((tmp_path / "run" / "training.csv").open()))
    assert [int(row["step"]) for row in rows] == [50]
    validation = list(csv.DictReader((tmp_path / "run" / "validation.csv").open()))
    assert len(validation) == 1
    # End to end (METHODS 13.8): the scene was never trained on, and its pictures improve.
    assert 0 < float(validation[0]["relative L2 ratio all"]) < 0.5
    assert 0 < float(validation[0]["1-SSIM ratio all"]) < 0.8


def test_a_run_of_another_network_is_not_continued(data, tmp_path, capsys):
    config = write_config(tmp_path / "unit.toml", PYRAMID, steps=1, batch=1)
    assert train_kpcn(config, data, tmp_path / "run") == 0
    other = write_config(tmp_path / "other.toml", replace(PYRAMID, widths=(4, 4, 4, 8)), steps=1, batch=1)
    assert train_kpcn(other, data, tmp_path / "run") == 2
    assert "another network" in capsys.readouterr().err


def test_wrong_keys_and_kinds_are_named():
    with pytest.raises(ValueError, match=r"here: optimiser: unknown key stps"):
        config_of({"name": "x", "network": {"kind": "kernel"}, "optimiser": {"stps": 3}}, "here")
    with pytest.raises(ValueError, match=r"expected a key name"):
        config_of({"network": {"kind": "kernel"}}, "here")
    with pytest.raises(ValueError, match=r"network.kind is 'cnn'"):
        config_of({"name": "x", "network": {"kind": "cnn"}}, "here")


def test_batches_depend_on_seed_rank_and_step_alone(data):
    sampler = PatchSampler(data, examples.read_index(data, "train"), Augmentation(), False)
    batch, again = (sampler.batch(2, 1, 0, 7).buffers.diffuse for _ in range(2))
    assert torch.equal(batch, again)
    for other in ((2, 0, 7), (1, 1, 7), (1, 0, 8)):
        assert not torch.equal(batch, sampler.batch(2, *other).buffers.diffuse)


def test_the_arguments_have_defaults_that_argparse_accepts():
    parser = argparse.ArgumentParser()
    train.SUBCOMMANDS["kpcn"].add_arguments(parser)
    args = parser.parse_args(["--config", "a", "--data", "b", "--output", "c"])
    assert args.minutes is None
    assert args.initial is None
