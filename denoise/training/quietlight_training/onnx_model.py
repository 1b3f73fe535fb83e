"""The ONNX file of a network: logits only, with the metadata by which the renderer knows it.

Input `input`, float32: `[1, 88, height/2, width/2]` for a kernel pyramid, `[1, 27, height, width]` for a single kernel,
whose output is `logits`; see `network`. Height and width are free (multiples of 16 for the pyramid).

A pyramid's outputs are `half`, the features `[1, w0, height/2, width/2]` of which `level0` is a 1×1 convolution,
`level1` … `level4`, and that convolution's `level0.weight` `[140, w0]` and `level0.bias` `[140]`, constants. Who runs
the file computes `level0` itself: the renderer a row at a time, so that its 140 channels are never in memory, and
[`logits`] here.
"""

import hashlib
import io
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from google.protobuf.message import DecodeError
from onnxruntime.capi.onnxruntime_pybind11_state import Fail, InvalidProtobuf
from torch import Tensor, nn
from torch.nn import functional

from quietlight_training.channels import KERNEL_CHANNELS, PYRAMID_CHANNELS
from quietlight_training.config import NetworkConfig
from quietlight_training.denoiser import BRANCHES, Denoiser
from quietlight_training.network import PyramidNetwork
from quietlight_training.transforms import EPSILON

OPSET = 18
VERSION = "3"

# Outputs of a pyramid that are images, then those that are constants.
PYRAMID_IMAGES = ("half", "level1", "level2", "level3", "level4")
FINEST_HEAD = ("level0.weight", "level0.bias")


class _AllButFinest(nn.Module):
    """A pyramid network as its file has it."""

    def __init__(self, network: PyramidNetwork):
        super().__init__()
        self.network = network

    def forward(self, channels: Tensor) -> tuple[Tensor, ...]:
        head = self.network.heads[0]
        return *self.network.all_but_finest(channels), head.weight.flatten(1), head.bias


def channel_names(config: NetworkConfig) -> tuple[str, ...]:
    """Names of the input channels."""
    return PYRAMID_CHANNELS if config.kind == "kernel_pyramid" else KERNEL_CHANNELS


def input_channels(config: NetworkConfig) -> int:
    """Channels of the input tensor: four a name where space-to-depth went before."""
    return len(channel_names(config)) * (4 if config.kind == "kernel_pyramid" else 1)


def output_names(config: NetworkConfig) -> tuple[str, ...]:
    """Names of the outputs."""
    return (*PYRAMID_IMAGES, *FINEST_HEAD) if config.kind == "kernel_pyramid" else ("logits",)


def to_onnx(network: nn.Module, config: NetworkConfig, tier: str, branch: str) -> onnx.ModelProto:
    """The network as an ONNX model, with its metadata."""
    names = output_names(config)
    axes = {name: {2: f"{name}_height", 3: f"{name}_width"} for name in names if name not in FINEST_HEAD}
    file = io.BytesIO()
    network = network.eval().to(memory_format=torch.contiguous_format)
    torch.onnx.export(
        _AllButFinest(network) if isinstance(network, PyramidNetwork) else network,
        (torch.zeros(1, input_channels(config), 32, 32),),
        file,
        input_names=["input"],
        output_names=list(names),
        dynamic_axes={"input": {2: "height", 3: "width"}, **axes},
        opset_version=OPSET,
        dynamo=False,
    )
    model = onnx.load_from_string(file.getvalue())
    describe(model, config, tier, branch)
    onnx.checker.check_model(model)
    return model


def describe(model: onnx.ModelProto, config: NetworkConfig, tier: str, branch: str) -> None:
    """Writes the metadata into the model."""
    metadata = {
        "kind": config.kind,
        "branch": branch,
        "tier": tier,
        "channels": ",".join(channel_names(config)),
        "epsilon": str(EPSILON),
        "version": VERSION,
    }
    onnx.helper.set_model_props(model, metadata)


def round_weights(denoiser: Denoiser) -> None:
    """Rounds all weights to float16, which is what their file will hold."""
    with torch.no_grad():
        for weight in denoiser.parameters():
            weight.copy_(weight.half().float())


def halve_weights(model: onnx.ModelProto) -> None:
    """Stores the weights as float16, converted back by a Cast that onnxruntime folds away on loading: half the file."""
    graph = model.graph
    casts = []
    for tensor in graph.initializer:
        if tensor.data_type != onnx.TensorProto.FLOAT or not tensor.dims:
            continue
        name = tensor.name
        half = onnx.numpy_helper.to_array(tensor).astype(np.float16)
        tensor.CopyFrom(onnx.numpy_helper.from_array(half, f"{name}.half"))
        casts.append(onnx.helper.make_node("Cast", [tensor.name], [name], to=onnx.TensorProto.FLOAT))
    for cast in reversed(casts):
        graph.node.insert(0, cast)


def session(model: onnx.ModelProto | Path, threads: int = 0) -> onnxruntime.InferenceSession:
    """The model loaded for the CPU; 0 threads are onnxruntime's choice."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    source = str(model) if isinstance(model, Path) else model.SerializeToString()
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


def logits(runner: onnxruntime.InferenceSession, inputs: np.ndarray) -> tuple[Tensor, ...]:
    """What the network gives in torch: the file's outputs, `level0` computed from its features."""
    names = [output.name for output in runner.get_outputs()]
    outputs = dict(zip(names, map(torch.from_numpy, runner.run(None, {"input": inputs})), strict=True))
    if "half" not in outputs:
        return tuple(outputs.values())
    half, *others = (outputs[name] for name in PYRAMID_IMAGES)
    weight, bias = (outputs[name] for name in FINEST_HEAD)
    return functional.conv2d(half, weight[:, :, None, None], bias), *others


def largest_difference(model: onnx.ModelProto, network: nn.Module, inputs: Tensor) -> float:
    """Largest difference of any logit between onnxruntime and torch, over the largest logit or 1."""
    with torch.no_grad():
        outputs = network.eval()(inputs)
    expected = outputs if isinstance(outputs, tuple) else (outputs,)
    found = logits(session(model), inputs.numpy())
    return max(
        (there - here).abs().max().item() / max(1.0, here.abs().max().item())
        for there, here in zip(found, expected, strict=True)
    )


class OnnxNetwork(nn.Module):
    """An ONNX model in the place of a network of [`Denoiser`]."""

    def __init__(self, model: onnx.ModelProto | Path, threads: int = 0):
        super().__init__()
        self.session = session(model, threads)

    def forward(self, channels: Tensor) -> Tensor | tuple[Tensor, ...]:
        """Logits; one image at a time, as the renderer does."""
        outputs = logits(self.session, channels.contiguous().numpy())
        return outputs if len(outputs) > 1 else outputs[0]


def load_denoiser(paths: dict[str, Path], threads: int = 0) -> Denoiser:
    """A denoiser of the weight files of both branches. Raises `ValueError` where a file is not what its name says."""
    denoiser = None
    for branch, path in paths.items():
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            metadata = session(path).get_modelmeta().custom_metadata_map
        except (Fail, InvalidProtobuf) as error:
            raise ValueError(f"{path}: not an ONNX file") from error
        if metadata.get("branch") != branch:
            raise ValueError(f"{path}: branch is {metadata.get('branch')!r}, expected {branch!r}")
        if denoiser is None:
            denoiser = _empty_denoiser(metadata, path)
        setattr(denoiser, branch, OnnxNetwork(path, threads))
    if denoiser is None:
        raise ValueError(f"expected the files of {BRANCHES}, found none")
    return denoiser


def read_denoiser(path: Path) -> Denoiser:
    """A trained denoiser of two weight files, of which `path` is either, to go on training. Raises `ValueError` where
    that is no weight file of ours.
    """
    branch = next((branch for branch in BRANCHES if path.stem.endswith(f"-{branch}")), None)
    if branch is None:
        raise ValueError(f"{path}: expected a name that ends in -diffuse.onnx or -specular.onnx")
    tier = path.stem.removesuffix(f"-{branch}")
    weights = {branch: read_weights(path.with_name(f"{tier}-{branch}.onnx")) for branch in BRANCHES}
    try:
        denoiser = Denoiser(_config_of(weights[branch], path))
        for branch, values in weights.items():
            getattr(denoiser, branch).load_state_dict(values)
    except (KeyError, RuntimeError, ValueError) as error:
        raise ValueError(f"{path}: no weights of a network of ours") from error
    return denoiser


def read_weights(path: Path) -> dict[str, Tensor]:
    """The weights in a file, by their names in the network; those in int8 as the numbers that they stand for."""
    try:
        graph = onnx.load(path).graph
    except DecodeError as error:
        raise ValueError(f"{path}: not an ONNX file ({error})") from error
    tensors = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    weights = {}
    for name, values in tensors.items():
        stem = name.removesuffix("_quantized").removesuffix(".half")
        if not stem.endswith((".weight", ".bias")):
            continue
        if name.endswith("_quantized"):
            # Of each channel, and with a zero point of 0.
            scale = tensors.get(f"{stem}_scale", tensors.get(f"{name}_scale"))
            values = values * scale.reshape(-1, *[1] * (values.ndim - 1))
        weights[stem.removeprefix("network.")] = torch.tensor(values, dtype=torch.float32)
    return weights


def _config_of(weights: dict[str, Tensor], path: Path) -> NetworkConfig:
    """The network that has weights of these shapes."""
    if "encoder.0.0.weight" in weights:
        widths = (weights[f"encoder.{level}.2.weight"].shape[0] for level in range(4))
        return NetworkConfig("kernel_pyramid", widths=tuple(widths))
    layers = [weight for name, weight in weights.items() if name.endswith(".weight")]
    if not layers:
        raise ValueError(f"{path}: no weights of a network of ours")
    (width, _, filter_size, _), taps = layers[0].shape, round(layers[-1].shape[0] ** 0.5)
    return NetworkConfig("kernel", depth=len(layers), width=width, filter_size=filter_size, taps=taps)


def sha256(path: Path) -> str:
    """Hash of a file, as the renderer checks it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _empty_denoiser(metadata: dict[str, str], path: Path) -> Denoiser:
    kind = metadata.get("kind")
    if kind == "kernel_pyramid":
        return Denoiser(NetworkConfig(kind, widths=(1, 1, 1, 1)))
    if kind == "kernel":
        outputs = session(path).get_outputs()
        return Denoiser(NetworkConfig(kind, depth=1, width=1, filter_size=1, taps=round(outputs[0].shape[1] ** 0.5)))
    raise ValueError(f"{path}: kind is {kind!r}, expected kernel_pyramid or kernel")
