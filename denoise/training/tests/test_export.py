"""Weight files: what onnxruntime makes of them is what torch made, and they say what they are."""

import json

import numpy as np
import onnx
import pytest
import torch

import evaluate
import export
from quietlight_training import examples, onnx_model, quantise
from quietlight_training.channels import KERNEL_CHANNELS, PYRAMID_CHANNELS
from quietlight_training.checkpoint import FILE, Checkpoint
from quietlight_training.config import Config, NetworkConfig
from quietlight_training.denoiser import BRANCHES, Denoiser
from quietlight_training.transforms import exposure
from quietlight_training.verbs import run_verb
from quietlight_training.views import read_views
from tests.conftest import random_buffers

PYRAMID = NetworkConfig("kernel_pyramid", widths=(8, 8, 16, 16))
KERNEL = NetworkConfig("kernel", depth=3, width=8, filter_size=3, taps=5)
KINDS = pytest.mark.parametrize("network", [PYRAMID, KERNEL], ids=["pyramid", "kernel"])


def save_checkpoint(network: NetworkConfig, folder, bias: float = 0.0) -> Denoiser:
    """Of random weights. Equal biases, as those of 0, are written once for all layers."""
    denoiser = Denoiser(network)
    with torch.no_grad():
        for name, weight in denoiser.named_parameters():
            if name.endswith(".bias"):
                weight.add_(bias * torch.rand_like(weight))
    weights = denoiser.state_dict()
    folder.mkdir(exist_ok=True)
    Checkpoint(Config("unit", network), 7, 3600.0, weights, weights, {}, {"data": "/of/a/machine/set"}).save(
        folder / FILE
    )
    return denoiser


def export_kpcn(*options) -> int:
    return run_verb("export", export.SUBCOMMANDS, ["kpcn", *map(str, options)])


@KINDS
def test_the_files_denoise_as_the_checkpoint_does(network, tmp_path):
    denoiser = save_checkpoint(network, tmp_path / "run")
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, "--full-precision") == 0
    loaded = onnx_model.load_denoiser({branch: tmp_path / f"kpcn-unit-{branch}.onnx" for branch in BRANCHES})
    for height, width in ((32, 48), (19, 21), (1, 1)):
        buffers = random_buffers(height, width)
        scale = exposure(buffers.beauty)
        with torch.no_grad():
            expected, found = (one(buffers, scale).radiance for one in (denoiser, loaded))
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6)


@KINDS
def test_the_files_say_what_they_are(network, tmp_path):
    save_checkpoint(network, tmp_path / "run")
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, "--tier", "fast") == 0
    models = json.loads((tmp_path / "models.json").read_text())
    is_pyramid = network.kind == "kernel_pyramid"
    names = PYRAMID_CHANNELS if is_pyramid else KERNEL_CHANNELS
    assert set(models) == {"kpcn-fast-diffuse", "kpcn-fast-specular"}
    for branch in BRANCHES:
        entry = models[f"kpcn-fast-{branch}"]
        path = tmp_path / entry["file"]
        assert entry["sha256"] == onnx_model.sha256(path)
        assert (entry["tier"], entry["branch"], entry["steps"]) == ("fast", branch, 7)
        session = onnx_model.session(path)
        assert session.get_modelmeta().custom_metadata_map == {
            "kind": network.kind,
            "branch": branch,
            "tier": "fast",
            "channels": ",".join(names),
            "epsilon": "0.00316",
            "version": "3",
        }
        outputs = {output.name: output.shape for output in session.get_outputs()}
        if is_pyramid:
            assert list(outputs) == ["half", "level1", "level2", "level3", "level4", "level0.weight", "level0.bias"]
            assert (outputs["half"][:2], outputs["level0.weight"], outputs["level0.bias"]) == ([1, 8], [140, 8], [140])
        else:
            assert list(outputs) == ["logits"]
        assert [value.name for value in session.get_inputs()] == ["input"]
        assert onnx.load(path).opset_import[0].version == 18


def test_half_precision_weights_halve_the_file_and_are_what_is_checked(tmp_path):
    denoiser = save_checkpoint(NetworkConfig("kernel_pyramid", widths=(16, 32, 48, 64)), tmp_path / "run")
    sizes = []
    for options in (("--full-precision",), ()):
        assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, *options) == 0
        sizes.append((tmp_path / "kpcn-unit-diffuse.onnx").stat().st_size)
    assert sizes[1] < 0.55 * sizes[0]
    onnx_model.round_weights(denoiser)
    model = onnx.load(tmp_path / "kpcn-unit-diffuse.onnx")
    assert onnx_model.largest_difference(model, denoiser.diffuse, torch.randn(1, 88, 16, 32)) < 1e-5


def test_a_model_that_differs_from_torch_is_refused(tmp_path):
    from quietlight_training.kpcn_export import check

    network = Denoiser(PYRAMID).diffuse
    model = onnx_model.to_onnx(network, PYRAMID, "unit", "diffuse")
    assert check(model, network, 88) < 1e-5
    for head in (network.heads[0], network.heads[3]):
        with torch.no_grad():
            head.bias[0] += 1e-2
        with pytest.raises(ValueError, match="differs from torch"):
            check(model, network, 88)
        with torch.no_grad():
            head.bias[0] -= 1e-2


def test_swapped_branches_are_refused(tmp_path):
    save_checkpoint(PYRAMID, tmp_path / "run")
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path) == 0
    with pytest.raises(ValueError, match="branch is 'specular', expected 'diffuse'"):
        onnx_model.load_denoiser({"diffuse": tmp_path / "kpcn-unit-specular.onnx"})


def test_exporting_another_tier_keeps_the_entries_that_are_there(tmp_path):
    save_checkpoint(PYRAMID, tmp_path / "run")
    for tier in ("fast", "high"):
        assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, "--tier", tier) == 0
    models = json.loads((tmp_path / "models.json").read_text())
    assert sorted(models) == [f"kpcn-{tier}-{branch}" for tier in ("fast", "high") for branch in BRANCHES]
    assert all(model["data"] == "set" for model in models.values())


@pytest.fixture(scope="module")
def data(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("examples")
    for view in read_views(dataset):
        examples.write_example(view, folder, patch_size=32, candidates=6)
    examples.write_index(folder)
    return folder


def test_int8_changes_the_logits_little_and_keeps_the_description(data, tmp_path):
    denoiser = save_checkpoint(PYRAMID, tmp_path / "run")
    options = ("--int8", "--data", data, "--calibration-images", 3)
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, *options) == 0
    model = onnx.load(tmp_path / "kpcn-unit-diffuse.onnx")
    assert any(node.op_type == "QuantizeLinear" for node in model.graph.node)
    assert all(output.type.tensor_type.elem_type == onnx.TensorProto.FLOAT for output in model.graph.output)
    # The first layer sees what it is given, not steps of it.
    assert [node.op_type for node in model.graph.node if "input" in node.input] == ["Conv"]
    head = onnx_model.session(model).run(
        ["level0.weight", "level0.bias"], {"input": torch.zeros(1, 88, 16, 16).numpy()}
    )
    onnx_model.round_weights(denoiser)
    expected = (denoiser.diffuse.heads[0].weight.flatten(1), denoiser.diffuse.heads[0].bias)
    assert all(np.array_equal(found, weights.detach()) for found, weights in zip(head, expected, strict=True))
    assert {prop.key: prop.value for prop in model.metadata_props}["kind"] == "kernel_pyramid"
    inputs = quantise.calibration_inputs(denoiser, data, examples.read_index(data, "train"), 3)["diffuse"]
    with torch.no_grad():
        logits = torch.cat([level.flatten() for level in denoiser.diffuse(torch.from_numpy(inputs[0]))])
    # 8 bits of the range of each of the nine layers in a row: some percent of the logits' own spread.
    assert 0 < quantise.error(model, denoiser.diffuse, inputs) < 0.1 * logits.std()


@KINDS
@pytest.mark.parametrize("options", [("--full-precision",), (), ("--int8",)], ids=["f32", "f16", "int8"])
def test_training_starts_from_weight_files_of_every_precision(network, options, data, tmp_path):
    denoiser = save_checkpoint(network, tmp_path / "run", bias=0.1)
    options = (*options, "--data", data, "--calibration-images", 2) if "--int8" in options else options
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, *options) == 0
    started = onnx_model.read_denoiser(tmp_path / "kpcn-unit-specular.onnx")
    assert started.config == network
    # Half a step: of float16, to which all are rounded, and of int8.
    error = (0.0 if "--full-precision" in options else 2**-11) + (1 / 254 if "--int8" in options else 0.0)
    for name, weight in denoiser.state_dict().items():
        difference = (started.state_dict()[name] - weight).abs().max()
        assert difference <= error * weight.abs().max() * 1.001 + 1e-7, name


def test_what_is_no_weight_file_is_not_started_from(tmp_path):
    for branch in BRANCHES:
        (tmp_path / f"kpcn-x-{branch}.onnx").write_text("no network")
    with pytest.raises(ValueError, match=r"kpcn-x-diffuse\.onnx: not an ONNX file"):
        onnx_model.read_denoiser(tmp_path / "kpcn-x-diffuse.onnx")
    with pytest.raises(ValueError, match=r"kpcn-x-diffuse\.onnx: not an ONNX file"):
        onnx_model.load_denoiser({"diffuse": tmp_path / "kpcn-x-diffuse.onnx"})
    with pytest.raises(FileNotFoundError, match=r"kpcn-y-diffuse\.onnx"):
        onnx_model.read_denoiser(tmp_path / "kpcn-y-specular.onnx")
    with pytest.raises(ValueError, match=r"-diffuse\.onnx or -specular\.onnx"):
        onnx_model.read_denoiser(tmp_path / "weights.onnx")


@pytest.mark.parametrize("names", [(), ("encoder.0.0.weight",), ("other.weight",), ("other.bias", "a.weight")])
def test_an_onnx_file_of_another_network_is_not_started_from(names, tmp_path):
    weights = [onnx.numpy_helper.from_array(np.zeros((4, 4, 1, 1), np.float32), name) for name in names]
    model = onnx.helper.make_model(onnx.helper.make_graph([], "other", [], [], weights))
    for branch in BRANCHES:
        onnx.save(model, tmp_path / f"other-{branch}.onnx")
    with pytest.raises(ValueError, match=r"other-diffuse\.onnx: no weights of a network of ours"):
        onnx_model.read_denoiser(tmp_path / "other-diffuse.onnx")


@pytest.mark.parametrize("content", [b"", b"no checkpoint", b"hello world\n" * 9, b"PK\x03\x04", {"step": 1}, [1]])
def test_what_is_no_checkpoint_is_named(content, tmp_path):
    path = tmp_path / "x.pt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(ValueError, match=r"x\.pt: not a checkpoint"):
        Checkpoint.load(path)


def test_int8_without_data_says_what_it_needs(tmp_path, capsys):
    save_checkpoint(PYRAMID, tmp_path / "run")
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, "--int8") == 2
    assert "--data" in capsys.readouterr().err


def test_what_cannot_be_evaluated_is_named_in_one_line(data, tmp_path, capsys):
    (tmp_path / "x.pt").write_text("no checkpoint")
    for source in (["--checkpoint", tmp_path / "x.pt"], ["--models", tmp_path, "--tier", "x"]):
        arguments = ["kpcn", *source, "--data", data]
        assert run_verb("evaluate", evaluate.SUBCOMMANDS, list(map(str, arguments))) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert f"error: {tmp_path}" in said


def test_evaluation_scores_checkpoints_and_files_alike(data, tmp_path, capsys):
    save_checkpoint(PYRAMID, tmp_path / "run")
    assert export_kpcn("--checkpoint", tmp_path / "run", "--output", tmp_path, "--full-precision") == 0
    results = []
    for source in (["--checkpoint", tmp_path / "run"], ["--models", tmp_path, "--tier", "unit"]):
        arguments = ["kpcn", *source, "--data", data, "--json", tmp_path / "scores.json"]
        assert run_verb("evaluate", evaluate.SUBCOMMANDS, list(map(str, arguments))) == 0
        results.append(json.loads((tmp_path / "scores.json").read_text()))
    assert [(score["id"], score["spp"]) for score in results[0]] == [("d", 1), ("d", 16)]
    for one, other in zip(*results, strict=True):
        assert one["relative_l2"] == pytest.approx(other["relative_l2"], rel=1e-4)
    assert "1-3 spp" in capsys.readouterr().out
