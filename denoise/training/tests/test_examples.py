"""From views to training pairs: nothing is lost that training needs."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import preprocess
from quietlight_training import examples, exr
from quietlight_training.transforms import spatial_variance
from quietlight_training.views import read_view, read_views
from tests.conftest import write_exr, write_view


def test_views_are_read_and_split(dataset):
    views = read_views(dataset)
    assert [view.id for view in views] == ["a", "b", "c", "d"]
    assert [view.id for view in read_views(dataset, "validation")] == ["d"]
    assert [image.spp for image in views[0].noisy] == [1, 16]
    assert views[0].reference.exists()


def test_a_broken_view_is_named(tmp_path):
    write_view(tmp_path, "x", "train", size=8)
    path = tmp_path / "views" / "x" / "view.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {"split": "tset"}))
    with pytest.raises(ValueError, match=r"view.json: split is 'tset'"):
        read_view(path)
    del record["reference"]
    path.write_text(json.dumps(record))
    with pytest.raises(ValueError, match=r"view.json: not a view: KeyError\('reference'\)"):
        read_view(path)
    with pytest.raises(ValueError, match="found none"):
        read_views(tmp_path / "views")


def test_an_image_without_one_of_its_components_is_refused(tmp_path):
    path = tmp_path / "x.exr"
    channels = {name: np.zeros((4, 4), np.float32) for name in ("albedo.R", "albedo.B")}
    exr.OpenEXR.File({"type": exr.OpenEXR.scanlineimage}, channels).write(str(path))
    with pytest.raises(ValueError, match=r"x.exr: expected .*, found no \['albedo.G'\]"):
        exr.read_layers(path)
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"x.exr"):
        exr.read_layers(path)


def test_a_pair_is_what_the_files_hold(dataset, tmp_path):
    view = read_views(dataset)[0]
    example = examples.write_example(view, tmp_path, patch_size=32, candidates=4)
    pair = examples.read_pair(tmp_path, example, 1)
    layers = exr.read_layers(view.noisy[1].path).layers
    for name in ("diffuse", "specular", "depth"):
        assert torch.equal(getattr(pair, name), torch.from_numpy(layers[name].mean)), name
    # Half floats keep 11 bits; a variance is the square of a deviation and so has twice the error.
    for name in ("albedo", "normal"):
        torch.testing.assert_close(getattr(pair, name), torch.from_numpy(layers[name].mean), rtol=2**-11, atol=1e-7)
    for name in ("diffuse", "specular", "depth"):
        expected = torch.from_numpy(layers[name].variance)
        torch.testing.assert_close(getattr(pair, f"{name}_variance"), expected, rtol=2**-9, atol=1e-9)
    expected = torch.from_numpy(layers["noisy"].variance)
    torch.testing.assert_close(pair.beauty_variance, expected, rtol=2**-9, atol=1e-9)
    reference = exr.read_layers(view.reference).layers
    assert torch.equal(pair.reference_diffuse, torch.from_numpy(reference["diffuse"].mean))
    assert torch.equal(pair.reference_specular, torch.from_numpy(reference["specular"].mean))


def test_a_cut_is_a_part_of_the_whole(dataset, tmp_path):
    example = examples.write_example(read_views(dataset)[0], tmp_path, patch_size=32, candidates=4)
    whole = examples.read_pair(tmp_path, example, 0)
    cut = examples.read_pair(tmp_path, example, 0, (3, 5), 32)
    for name, tensor in vars(cut).items():
        assert torch.equal(tensor, getattr(whole, name)[:, 3:35, 5:37]), name


def test_a_single_sample_gets_the_spatial_variance(dataset, tmp_path):
    view = read_views(dataset)[0]
    example = examples.write_example(view, tmp_path, patch_size=32, candidates=4)
    pair = examples.read_pair(tmp_path, example, 0)
    expected = spatial_variance(pair.diffuse[None])[0]
    torch.testing.assert_close(pair.diffuse_variance, expected, rtol=2**-9, atol=1e-6)


def test_a_scene_without_specular_light_has_zeros(dataset, tmp_path):
    view = next(view for view in read_views(dataset) if view.id == "c")
    example = examples.write_example(view, tmp_path, patch_size=32, candidates=4)
    pair = examples.read_pair(tmp_path, example, 0)
    assert (pair.specular == 0).all()
    assert (pair.specular_variance == 0).all()
    assert (pair.reference_specular == 0).all()


def test_preprocessing_takes_up_what_is_new_and_leaves_out_what_is_broken(tmp_path, capsys):
    data, more, output = tmp_path / "data", tmp_path / "more", tmp_path / "out"
    write_view(data, "a", "train", size=40)

    def run(*datasets: Path) -> str:
        folders = [str(folder) for folder in (data, *datasets)]
        assert preprocess.main([*folders, str(output), "--patch-size", "32", "--processes", "1"]) == 0
        captured = capsys.readouterr()
        return captured.out + captured.err

    assert "1 examples, 0 of them for validation; 0 views left out" in run()
    before = (output / "data-a.radiance.npy").stat().st_mtime_ns
    write_view(data, "b", "validation", size=40)
    write_view(data, "x", "train", size=40)
    broken = np.full((3, 40, 40), np.nan)
    write_exr(data / "views" / "x" / "noisy-0.exr", {"noisy": broken})
    text = run()
    assert "2 examples, 1 of them for validation; 1 views left out" in text
    assert "noisy-0.exr: noisy has values that are not finite" in text
    assert (output / "data-a.radiance.npy").stat().st_mtime_ns == before
    assert [example.id for example in examples.read_index(output, "validation")] == ["data-b"]
    # Another data set may have views of the same names.
    write_view(more, "a", "validation", size=40)
    assert "3 examples, 2 of them for validation; 1 views left out" in run(more)
    assert [example.id for example in examples.read_index(output, "validation")] == ["data-b", "more-a"]
    assert not list(output.glob("*.tmp"))


def test_an_index_of_another_version_is_refused(tmp_path):
    record = {"version": 1, "examples": [{"version": 0, "id": "x"}]}
    (tmp_path / "index.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match="version 0, expected 1"):
        examples.read_index(Path(tmp_path))


def test_data_sets_of_one_name_are_refused(tmp_path, capsys):
    folders = [tmp_path / part / "data" for part in ("first", "second")]
    for folder in folders:
        write_view(folder, "x", "train", size=40)
    assert preprocess.main([*map(str, folders), str(tmp_path / "examples")]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("error: data sets of one name")
    assert all(str(folder) in said for folder in folders)
    assert not (tmp_path / "examples").exists()


def test_a_later_data_set_of_the_same_name_is_refused(tmp_path, capsys, monkeypatch):
    folders = [tmp_path / part / "data" for part in ("first", "second")]
    for folder, view in zip(folders, ("x", "y"), strict=True):
        write_view(folder, view, "train", size=40)
    output = tmp_path / "examples"

    def run(folder: Path) -> int:
        return preprocess.main([str(folder), str(output), "--patch-size", "32", "--processes", "1"])

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(preprocess, "write_example", interrupt)
        run(folders[0])
    for _ in range(2):
        capsys.readouterr()
        assert run(folders[1]) == 2
        said = capsys.readouterr().err
        assert all(str(folder) in said for folder in folders)
        # The first is taken up again, whichever way its folder is written.
        assert run(folders[0] / ".." / "data") == 0
        assert [example.id for example in examples.read_index(output)] == ["data-x"]


def test_examples_from_before_their_data_sets_were_written_down_are_taken_up(tmp_path):
    write_view(tmp_path / "data", "x", "train", size=40)
    arguments = [str(tmp_path / "data"), str(tmp_path / "out"), "--patch-size", "32", "--processes", "1"]
    assert preprocess.main(arguments) == 0
    index = tmp_path / "out" / "index.json"
    record = json.loads(index.read_text())
    assert record.pop("sources") == {"data": str(tmp_path / "data")}
    index.write_text(json.dumps(record))
    assert [example.id for example in examples.read_index(tmp_path / "out")] == ["data-x"]
    assert preprocess.main(arguments) == 0
    assert examples.read_sources(tmp_path / "out") == {"data": str(tmp_path / "data")}
