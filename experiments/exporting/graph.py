"""The deployed actor as an ONNX graph, written down node by node: neither torch nor an exporter."""

from collections.abc import Mapping

import numpy as np

from orchid_uav.agents.deployed_actor import LocalActor
from orchid_uav.extras import import_extra

OPSET, IR_VERSION = 11, 6
"""Those of ONNX 1.6 (2019), which runtimes of old companion computers read as well."""
INPUT, OUTPUT, BATCH = "observation", "action", "batch"
"""Names of what goes in, what comes out, and of the first dimension of both."""


def actor_graph(actor: LocalActor, name: str, version: str, metadata: Mapping[str, str]) -> bytes:
    """A checked ONNX file: (batch, O) float32 to (batch, A) float32 in [-1, 1].

    Args:
        actor: a multilayer perceptron with ReLU between its layers and tanh behind the last.
        name: name of the graph.
        version: version of the program that wrote it.
        metadata: what is written beside the graph, by key.

    Raises:
        ImportError: onnx, of the extra ``onnx``, is not installed.
    """
    onnx = import_extra("onnx")
    make = onnx.helper
    nodes, weights, last = [], [], INPUT
    for index, (weight, bias) in enumerate(actor.layers):
        layer = f"layer_{index}"
        names = (f"{layer}.weight", f"{layer}.bias")
        for key, tensor in zip(names, (weight, bias), strict=True):
            weights.append(onnx.numpy_helper.from_array(tensor, key))
        # Row-major weights (out, in) as they lie in the file of the policy, hence transB.
        nodes.append(make.make_node("Gemm", [last, *names], [layer], layer, transB=1))
        last = layer
        if index < len(actor.layers) - 1:
            last = f"{layer}.relu"
            nodes.append(make.make_node("Relu", [layer], [last], last))
    nodes.append(make.make_node("Tanh", [last], ["tanh"], "tanh"))
    # A runtime may approximate tanh, and then leave [-1, 1] by a rounding error.
    bounds = ("lowest", "highest")
    for key, end in zip(bounds, (-1.0, 1.0), strict=True):
        weights.append(onnx.numpy_helper.from_array(np.array(end, np.float32), key))
    nodes.append(make.make_node("Clip", ["tanh", *bounds], [OUTPUT], "clip"))
    ends = [
        make.make_tensor_value_info(key, onnx.TensorProto.FLOAT, [BATCH, size])
        for key, size in ((INPUT, actor.observation_size), (OUTPUT, actor.action_size))
    ]
    model = make.make_model(
        make.make_graph(nodes, name, ends[:1], ends[1:], weights),
        opset_imports=[make.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="orchid-uav",
        producer_version=version,
    )
    make.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())
