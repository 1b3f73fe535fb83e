"""The fixtures that Rust reproduces are what this side computes today."""

import json

import numpy as np
import pytest

import make_fixture


def numbers(value) -> list[float]:
    """All numbers in a fixture, in order."""
    if isinstance(value, dict):
        return [number for key in sorted(value) for number in numbers(value[key])]
    if isinstance(value, list):
        return [number for entry in value for number in numbers(entry)]
    return [value] if isinstance(value, int | float) else []


def test_the_fixtures_are_up_to_date(tmp_path):
    make_fixture.write(tmp_path)
    names = {path.name for path in make_fixture.FIXTURES.glob("*.json")} & {path.name for path in tmp_path.glob("*")}
    assert names == {"layers.json", "pyramid.json", "kernel.json", "networks.json"}
    for name in sorted(names):
        stored, made = (json.loads((folder / name).read_text()) for folder in (make_fixture.FIXTURES, tmp_path))
        # Float32 convolutions differ between machines by their order of addition.
        np.testing.assert_allclose(numbers(made), numbers(stored), rtol=1e-5, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", make_fixture.NETWORKS)
def test_the_fixture_networks_are_no_identity(name):
    layers = json.loads((make_fixture.FIXTURES / "layers.json").read_text())["layers"]
    noisy = np.add(layers["diffuse"]["mean"], layers["specular"]["mean"])
    radiance = json.loads((make_fixture.FIXTURES / "networks.json").read_text())[name]
    assert np.median(np.abs(radiance - noisy)) > 0.1
