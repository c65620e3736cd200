"""What a learner has learned, as arrays by name, and back: weights, and the averages of Adam."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from orchid_uav.storage.tensors import Tensors, TensorSpec

WEIGHTS, OPTIMIZER = "weights", "optimizer"
"""Files of a state."""
MOMENTS = ["exp_avg", "exp_avg_sq", "step"]
"""What Adam keeps of a parameter, sorted."""


class DivergedError(ArithmeticError):
    """Learning led to numbers that are not finite."""


def weights_of(module: torch.nn.Module, when: str) -> Tensors:
    """Copies of the weights of a module.

    Args:
        module: whose weights.
        when: for the message, such as "after update 3".

    Raises:
        DivergedError: a weight is not a finite number.
    """
    weights = {name: _copied(tensor) for name, tensor in module.state_dict().items()}
    for name, array in weights.items():
        if not np.isfinite(array).all():
            raise DivergedError(f"{when} {name} is not finite")
    return weights


def moments_of(
    optimizer: torch.optim.Optimizer, parameters: Sequence[torch.nn.Parameter]
) -> Tensors:
    """Copies of Adam's averages of the parameters that it has changed, as "3.exp_avg"."""
    return {
        f"{index}.{name}": _copied(optimizer.state[parameter][name])
        for index, parameter in enumerate(parameters)
        if parameter in optimizer.state
        for name in sorted(optimizer.state[parameter])
    }


def specs_of(
    module: torch.nn.Module, parameters: Sequence[torch.nn.Parameter], changed: Iterable[int]
) -> dict[str, dict[str, TensorSpec]]:
    """Shapes and types of the weights, and of Adam's averages of the changed parameters."""
    weights = {name: TensorSpec.of(_copied(one)) for name, one in module.state_dict().items()}
    moments = {}
    for index in changed:
        average = TensorSpec.of(_copied(parameters[index]))
        for name in MOMENTS:
            is_scalar = name == "step"
            moments[f"{index}.{name}"] = TensorSpec((), average.dtype) if is_scalar else average
    return {WEIGHTS: weights, OPTIMIZER: moments}


def restore(
    module: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    parameters: Sequence[torch.nn.Parameter],
    tensors: Mapping[str, Tensors],
) -> None:
    """Take over weights and averages that fit :func:`specs_of`; other averages are forgotten."""
    module.load_state_dict(
        {name: torch.from_numpy(array) for name, array in tensors[WEIGHTS].items()}
    )
    optimizer.state.clear()
    for key, array in tensors[OPTIMIZER].items():
        index, _, name = key.partition(".")
        parameter = parameters[int(index)]
        optimizer.state[parameter][name] = torch.from_numpy(array).to(parameter.device)


def _copied(tensor: torch.Tensor) -> NDArray[Any]:
    return tensor.detach().cpu().numpy().copy()
