"""The judge's command line: what takes part, which program it runs and what it refuses."""

import importlib.util
import json
from pathlib import Path

import pytest

import judge


@pytest.fixture
def judged(tmp_path, monkeypatch):
    """Judges one scene, with nothing rendered; returns the row of the scores and the program that was called."""
    (tmp_path / "scenes" / "box").mkdir(parents=True)
    (tmp_path / "scenes" / "box" / "scene.xml").touch()
    programs = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(judge, "render", lambda binary, *_: programs.append(binary))
    monkeypatch.setattr(judge, "run", lambda _: json.dumps({"denoise_seconds": 1.0}))
    monkeypatch.setattr(judge, "score", lambda *_: {"relative_l2": 0.5, "one_minus_ssim": 0.5})
    monkeypatch.setattr(judge, "open_image_denoise", lambda *_: 1.0)

    def run(*options: str) -> tuple[dict, Path]:
        monkeypatch.setattr("sys.argv", ["judge.py", "scenes", "work", "--spp", "4", *options])
        judge.main()
        (row,) = json.loads((tmp_path / "work" / "scores.json").read_text())
        return row, programs[-1]

    return run


@pytest.mark.parametrize("installed", [False, True])
def test_open_image_denoise_takes_part_where_it_is_installed(judged, installed, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object() if installed else None)
    row, _ = judged()
    assert ("oidn" in row) == installed
    assert set(judge.OURS) < set(row)


def test_the_program_is_found_from_any_folder(judged):
    _, program = judged("--methods", "fast")
    assert program == Path(__file__).resolve().parents[3] / "target/release/quietlight"


def test_an_unknown_method_is_refused_before_anything_is_rendered(judged, capsys):
    with pytest.raises(SystemExit, match="2"):
        judged("--methods", "fats")
    assert "invalid choice: 'fats'" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["empty", "work"], ["scenes", "work", "--only", "ball"]])
def test_a_folder_without_scenes_is_refused(judged, arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["judge.py", *arguments])
    with pytest.raises(SystemExit, match="2"):
        judge.main()
    assert f"error: {arguments[0]}: no folder with a scene.xml" in capsys.readouterr().err
    assert not (tmp_path / "work").exists()
