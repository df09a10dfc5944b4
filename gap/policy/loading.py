"""Policies: functions of Python, and networks in ONNX or TorchScript.

    policy = load_policy("walk.onnx")
    policy = load_policy("my_robot:walk")      # a function of a TimeStep, or what makes one
    action = policy(timestep)

A network that takes one array is given all observations behind each other, in the environment's
order, as single precision and as a batch of one. An ONNX network that takes several is given the
observation of each name, with or without what is before its last slash. Its first output is the
action.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, closest, one_line
from walkerkit.gap.recordings.given import is_callable
from walkerkit.gap.simulation.users_code import blamed_on, function_named

Policy = Callable[[Any], Any]
"""A function of dm_control's last TimeStep that returns an action, (n,)."""
Array = NDArray[Any]


def load_policy(policy: Policy | str | Path) -> Policy:
    """A policy, from whatever it is given as.

    Args:
        policy: a function of a TimeStep; or a file `.onnx` or `.pt` (TorchScript); or
            `package.module:callable`, a function of a TimeStep, or one without arguments, or a
            class, that makes one.

    Raises:
        InputError: it is none of these, or the file cannot be used.
    """
    if not isinstance(policy, str | Path):
        if callable(policy):
            return policy
        raise InputError(
            f"the policy is an object of type {type(policy).__name__}. Give a function of a "
            "TimeStep that returns an action, the file of a network, or package.module:callable."
        )
    if is_callable(str(policy)):
        return _function(str(policy))
    path = Path(policy)
    readers = {".onnx": _onnx, ".pt": _torchscript}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: is no policy that can be read. Give an .onnx file, a .pt file of "
            "TorchScript, or package.module:callable."
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file. Give the path of the policy's network.")
    return reader(path)


def _function(name: str) -> Policy:
    found = function_named(name, "an action for a TimeStep")
    try:
        needed = [
            one
            for one in inspect.signature(found).parameters.values()
            if one.default is one.empty and one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)
        ]
    except ValueError:  # some of C's do not say
        return found
    if needed:
        return found
    with blamed_on(name, "Mend it until it returns a policy without arguments."):
        made = found()
    if not callable(made):
        raise InputError(
            f"{name}: it returned an object of type {type(made).__name__}. Let it return a "
            "function of a TimeStep."
        )
    return made  # type: ignore[no-any-return]


class Network:
    """A network as a policy.

    Args:
        source: its file.
        inputs: names of what it takes.
        run: its outputs' first for arrays by these names.
    """

    def __init__(
        self, source: Path, inputs: tuple[str, ...], run: Callable[[Mapping[str, Array]], Array]
    ):
        self._source, self._inputs, self._run = source, inputs, run

    def __call__(self, timestep: Any) -> Array:
        """The action for the last TimeStep, (n,)."""
        observed = {name: _row(value) for name, value in _observations(timestep).items()}
        taken = self._taken(observed)
        try:
            made = self._run(taken)
        except Exception as error:  # a runtime's own
            sizes = ", ".join(f"{name} {value.size}" for name, value in observed.items())
            raise InputError(
                f"{self._source}: cannot be run on the environment's observation ({sizes}): "
                f"{one_line(error)[:300]}. Enable the observables with which it was trained, in "
                "their order."
            ) from error
        return np.asarray(made, dtype=np.float64).reshape(-1)

    def _taken(self, observed: Mapping[str, Array]) -> dict[str, Array]:
        if len(self._inputs) == 1 and self._inputs[0] not in observed:
            whole = [*observed.values()] or [np.zeros((1, 0), dtype=np.float32)]
            return {self._inputs[0]: np.concatenate(whole, axis=1)}
        short = {name.rpartition("/")[2]: name for name in observed}
        found = {}
        for name in self._inputs:
            known = name if name in observed else short.get(name)
            if known is None:
                raise InputError(
                    f"{self._source}: it takes {name!r}, which the environment does not observe"
                    f"{closest(name, [*observed, *short])}. Enable that observable, or export the "
                    "network with one input."
                )
            found[name] = observed[known]
        return found


def _onnx(path: Path) -> Policy:
    try:
        import onnxruntime
    except ImportError:
        return _onnx_reference(path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # the runtime's own
        raise _unreadable(path, "ONNX", error) from error
    inputs = tuple(one.name for one in session.get_inputs())
    return Network(path, inputs, lambda taken: session.run(None, dict(taken))[0])


def _onnx_reference(path: Path) -> Policy:
    """ONNX's own evaluator, which is slow and everywhere."""
    try:
        import onnx
        from onnx.reference import ReferenceEvaluator
    except ImportError as error:
        raise InputError(
            f"{path}: an ONNX policy needs the package onnxruntime, or onnx, and neither is "
            "installed: pip install onnxruntime"
        ) from error
    try:
        model = onnx.load(path)
        onnx.checker.check_model(model)
        evaluator = ReferenceEvaluator(model)
    except Exception as error:  # protobuf's and onnx's own
        raise _unreadable(path, "ONNX", error) from error
    weights = {one.name for one in model.graph.initializer}
    inputs = tuple(one.name for one in model.graph.input if one.name not in weights)
    return Network(path, inputs, lambda taken: evaluator.run(None, dict(taken))[0])


def _torchscript(path: Path) -> Policy:
    try:
        import torch
    except ImportError as error:
        raise InputError(
            f"{path}: a TorchScript policy needs the package torch, which is not installed: "
            "pip install 'walkerkit[torch]'"
        ) from error
    try:
        network = torch.jit.load(str(path), map_location="cpu").eval()
    except Exception as error:  # torch's own
        raise _unreadable(
            path, "TorchScript", error, "Save it with torch.jit.script(network).save(file)."
        ) from error

    def run(taken: Mapping[str, Array]) -> Array:
        (values,) = taken.values()
        with torch.no_grad():
            made = network(torch.from_numpy(np.ascontiguousarray(values)))
        first = made[0] if isinstance(made, tuple | list) else made
        return np.asarray(first.numpy())

    return Network(path, ("",), run)


def _unreadable(
    path: Path, kind: str, error: Exception, remedy: str = "Export the network again."
) -> InputError:
    reason = one_line(error)[:200]
    return InputError(
        f"{path}: cannot be read as {kind} ({type(error).__name__}: {reason}). {remedy}"
    )


def _observations(timestep: Any) -> Mapping[str, Any]:
    observation = timestep.observation
    return observation if isinstance(observation, Mapping) else {"observation": observation}


def _row(value: Any) -> Array:
    """An observation as a batch of one, (1, n)."""
    return np.asarray(value, dtype=np.float32).reshape(1, -1)
