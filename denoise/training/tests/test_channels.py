"""The input channels: their order, and each against its formula."""

from dataclasses import replace

import numpy as np
import torch

from quietlight_training import channels, transforms
from quietlight_training.channels import KERNEL_CHANNELS, PYRAMID_CHANNELS
from tests.conftest import random_buffers


def test_the_channels_of_the_pyramid_are_22_in_this_order():
    assert PYRAMID_CHANNELS == (
        *("log.R", "log.G", "log.B"),
        *("log.dx.R", "log.dx.G", "log.dx.B", "log.dy.R", "log.dy.G", "log.dy.B"),
        *("log.deviation", "log.deviation.log"),
        *("normal.X", "normal.Y", "normal.Z", "normal.deviation"),
        *("albedo.R", "albedo.G", "albedo.B", "albedo.deviation"),
        *("depth.log.dx", "depth.log.dy", "depth.deviation"),
    )
    assert len(PYRAMID_CHANNELS) == 22


def test_the_channels_of_the_paper_are_27_in_this_order():
    groups = [("signal", "RGB"), ("normal", "XYZ"), ("albedo", "RGB")]
    expected = []
    for name, components in groups:
        expected += [f"signal.{c}" for c in components] if name == "signal" else []
        expected += [f"{name}.{axis}.{c}" for axis in ("dx", "dy") for c in components] + [f"{name}.variance"]
    expected += ["depth.dx", "depth.dy", "depth.variance"]
    assert KERNEL_CHANNELS == tuple(expected)
    assert len(KERNEL_CHANNELS) == 27


def test_every_channel_of_the_pyramid_is_its_formula():
    buffers = random_buffers(5, 6, dtype=torch.float64)
    signal, variance = transforms.demodulate(buffers, torch.tensor(2.0, dtype=torch.float64))
    inputs = channels.pyramid_channels(signal, variance, channels.pyramid_features(buffers))[0].numpy()
    assert inputs.shape == (22, 5, 6)
    array = {name: value[0].numpy() for name, value in vars(buffers).items()}
    s = 2 * array["diffuse"] / (array["albedo"] + 0.00316)
    v = 4 * array["diffuse_variance"] / (array["albedo"] + 0.00316) ** 2
    y, x = 3, 2
    log = np.log(1 + s)
    expected = [*log[:, y, x], *(log[:, y, x] - log[:, y, x - 1]), *(log[:, y, x] - log[:, y - 1, x])]
    noise = np.mean(v[:, y, x] / (1 + s[:, y, x]) ** 2)
    expected += [np.sqrt(noise), (np.log(noise + 1e-8) + 9) / 9]
    for feature in ("normal", "albedo"):
        expected += [*array[feature][:, y, x], np.sqrt(array[f"{feature}_variance"][:, y, x].mean())]
    depth, depth_variance = array["depth"][0], array["depth_variance"][0]
    expected += [np.log(depth[y, x] / depth[y, x - 1]), np.log(depth[y, x] / depth[y - 1, x])]
    expected += [np.sqrt(depth_variance[y, x]) / depth[y, x]]
    np.testing.assert_allclose(inputs[:, y, x], expected, rtol=1e-12)
    assert (inputs[3:6, :, 0] == 0).all()
    assert (inputs[6:9, 0, :] == 0).all()


def test_every_channel_of_the_paper_is_its_formula():
    buffers = random_buffers(5, 6, dtype=torch.float64)
    diffuse, specular = (inputs[0].numpy() for inputs in channels.kernel_channels(buffers))
    array = {name: value[0].numpy() for name, value in vars(buffers).items()}
    y, x = 3, 2
    farthest = array["depth"].max()
    shared = []
    for name, scale in (("normal", 1), ("albedo", 1), ("depth", farthest)):
        image = array[name] / scale
        shared += [*(image[:, y, x] - image[:, y, x - 1]), *(image[:, y, x] - image[:, y - 1, x])]
        shared += [array[f"{name}_variance"][:, y, x].mean() / scale**2]
    branches = {
        "diffuse": (diffuse, array["diffuse"] / (array["albedo"] + 0.00316), (array["albedo"] + 0.00316) ** 2),
        "specular": (specular, np.log1p(array["specular"]), (1 + array["specular"]) ** 2),
    }
    for name, (inputs, signal, divisor) in branches.items():
        expected = [*signal[:, y, x], *(signal[:, y, x] - signal[:, y, x - 1])]
        expected += [*(signal[:, y, x] - signal[:, y - 1, x])]
        expected += [(array[f"{name}_variance"] / divisor)[:, y, x].mean(), *shared]
        np.testing.assert_allclose(inputs[:, y, x], expected, rtol=1e-12, atol=1e-15, err_msg=name)


def test_unknown_depths_and_wild_values_stay_finite_and_bounded():
    buffers = random_buffers(6, 6)
    depth = buffers.depth.clone()
    depth[..., 2, 2] = 0
    depth[..., 4, 4] = torch.inf
    depth[..., 0, 0] = 1e-30
    buffers = replace(buffers, depth=depth, specular_variance=buffers.specular_variance * 1e30)
    features = channels.pyramid_features(buffers)
    inputs = channels.pyramid_channels(buffers.specular, buffers.specular_variance, features)
    assert torch.isfinite(inputs).all()
    by_name = dict(zip(PYRAMID_CHANNELS, inputs[0], strict=True))
    assert by_name["log.deviation"].max() == 10
    for name in ("depth.log.dx", "depth.log.dy"):
        step = by_name[name]
        assert step.abs().max() <= 2
        assert step[2, 2] == 0
        assert step[4, 4] == 0
    assert by_name["depth.log.dx"][2, 3] == 0
    assert by_name["depth.log.dy"][3, 2] == 0
    assert by_name["depth.log.dx"][0, 1] == 2
    assert by_name["depth.deviation"][2, 2] == 0
