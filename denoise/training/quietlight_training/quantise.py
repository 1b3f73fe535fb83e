"""int8 weight files: u8 activations, s8 weights per channel, the signs that run fastest (EVIDENCE 5)."""

import tempfile
from pathlib import Path

import numpy as np
import onnx
import torch
from onnxruntime import quantization
from torch import Tensor, nn

from quietlight_training.augment import as_rendered
from quietlight_training.batches import collate
from quietlight_training.denoiser import BRANCHES, Denoiser
from quietlight_training.examples import Example, read_pair
from quietlight_training.onnx_model import logits, session
from quietlight_training.scores import choose


class _Reader(quantization.CalibrationDataReader):
    """Hands out the calibration inputs one by one."""

    def __init__(self, inputs: list[np.ndarray]):
        self.rest = iter(inputs)

    def get_next(self) -> dict[str, np.ndarray] | None:
        values = next(self.rest, None)
        return None if values is None else {"input": values}


def calibration_inputs(
    denoiser: Denoiser, folder: Path, examples: list[Example], count: int
) -> dict[str, list[np.ndarray]]:
    """What each network is given for `count` noisy images of the examples, spread over the sample counts."""
    inputs: dict[str, list[np.ndarray]] = {branch: [] for branch in BRANCHES}
    hooks = [
        getattr(denoiser, branch).register_forward_pre_hook(
            lambda _, arguments, branch=branch: inputs[branch].append(arguments[0].contiguous().numpy())
        )
        for branch in BRANCHES
    ]
    with torch.no_grad():
        for example, image in choose(examples, count):
            batch = collate([as_rendered(read_pair(folder, example, image))], denoiser.config.kind == "kernel")
            denoiser(batch.buffers, batch.scale)
    for hook in hooks:
        hook.remove()
    return inputs


def quantise(model: onnx.ModelProto, inputs: list[np.ndarray]) -> onnx.ModelProto:
    """The model with its convolutions in int8, their ranges taken from what the inputs make of them.

    The heads stay in float32: a logit's error is a factor on a weight. So does the first layer: noise of a hundredth is
    less than one of 256 steps of a range that also holds fireflies, and yet all there is to see after many samples.
    """
    convolutions = [node.name for node in model.graph.node if node.op_type == "Conv"]
    exact = [convolutions[0], *(name for name in convolutions if "heads" in name)]
    with tempfile.TemporaryDirectory() as folder:
        source, prepared, result = (str(Path(folder) / name) for name in ("a.onnx", "b.onnx", "c.onnx"))
        onnx.save(model, source)
        quantization.quant_pre_process(source, prepared, skip_symbolic_shape=True)
        quantization.quantize_static(
            prepared,
            result,
            _Reader(inputs),
            quant_format=quantization.QuantFormat.QDQ,
            per_channel=True,
            activation_type=quantization.QuantType.QUInt8,
            weight_type=quantization.QuantType.QInt8,
            nodes_to_exclude=exact,
            op_types_to_quantize=["Conv", "MaxPool", "Concat", "Resize"],
        )
        return onnx.load(result)


def error(model: onnx.ModelProto, network: nn.Module, inputs: list[np.ndarray]) -> float:
    """Root mean square difference of the logits from the network's, over all outputs and inputs."""
    squares = count = 0.0
    runner = session(model)
    with torch.no_grad():
        for values in inputs:
            outputs: Tensor | tuple[Tensor, ...] = network(torch.from_numpy(values))
            expected = outputs if isinstance(outputs, tuple) else (outputs,)
            for there, here in zip(logits(runner, values), expected, strict=True):
                squares += (there - here).double().square().sum().item()
                count += there.numel()
    return (squares / count) ** 0.5
