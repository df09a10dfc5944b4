"""What a network with an LSTM does besides: its TorchScript graph, read operation by operation.

    reader = LstmGraphReader("ankle.pt", module)
    scale, shift = reader.before          # of the LSTM's inputs
    reader.behind.build()                 # an `Mlp` of what comes behind it

PyTorch's own LSTM has branches for inputs with and without a batch. Both are read, and have to come
to the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.networks.chain import Chain
from walkerkit.actuators.networks.torch_files import import_torch, torchscript_allowed
from walkerkit.actuators.networks.torch_graph import GraphReader

FloatArray = NDArray[np.float64]

_RESHAPING = {
    *("unsqueeze", "squeeze", "select", "slice", "view", "reshape", "transpose", "permute"),
    *("flatten", "contiguous", "to", "clone", "detach", "alias", "expand", "movedim", "swapaxes"),
}
_ASKING = {"dim", "size", "len", "dtype", "device", "numel", "is_cuda", "ne", "eq", "requires_grad"}
_BEFORE, _BEHIND = "before", "behind"


class LstmGraphReader(GraphReader):
    """Reads the graph of a module with an LSTM.

    Attributes:
        before: scale and shift of the inputs, (n_inputs,) each, or one number.
        behind: the chain that the LSTM's outputs go through.
        batch_first: whether inputs are (rows, steps, n) instead of (steps, rows, n).
    """

    def __init__(self, source: str, module: Any):
        """Reads it.

        Args:
            source: what is being read, for errors.
            module: the module, in evaluation mode.

        Raises:
            ValueError: It does something that is no part of such a network; names it.
        """
        torch = import_torch()
        with torchscript_allowed():
            scripted = module if isinstance(module, torch.jit.ScriptModule) else _script(module)
            if scripted is None:
                raise ValueError(
                    f"{source}: its forward cannot be read by torch.jit.script: give its state "
                    "dict, with what else the network does as the actuator's scales"
                )
            frozen = torch.jit.freeze(scripted.eval(), optimize_numerics=False)
        super().__init__(source, scripted, frozen)
        self.before: tuple[FloatArray, FloatArray] = (np.ones(1), np.zeros(1))
        self.behind = self._chain
        self.batch_first = False
        self._before = Chain(source)
        self._found = False
        self._side: dict[str, str] = {}  # value → on which side of the LSTM it is
        self._scale: dict[str, tuple[FloatArray, FloatArray]] = {}
        self._last: dict[str, int] = {}  # value → operations of the chain that made it
        self._operations = 0
        values = list(self._graph.inputs())[1:]
        self._side[values[0].debugName()] = _BEFORE
        self._scale[values[0].debugName()] = np.ones(1), np.zeros(1)
        self._read_block(self._graph)
        outputs = [value.debugName() for value in self._graph.outputs()]
        made = [name for name in outputs if name in self._side]
        if not self._found or not made or self._side[made[0]] != _BEHIND:
            raise self._refused("forward", "what it returns does not come from an LSTM")
        if self._last[made[0]] != self._operations:
            raise self._refused("forward", "it returns something else than its last layer")

    def _read_block(self, block: Any) -> None:
        for node in block.nodes():
            self._read(node)

    def _read(self, node: Any) -> None:
        kind = node.kind().removeprefix("aten::").removeprefix("prim::").rstrip("_")
        names = [value.debugName() for value in node.inputs()]
        mine = [name for name in names if name in self._side]
        outputs = [value.debugName() for value in node.outputs()]
        if kind == "If":
            self._read_branches(node, outputs)
        elif kind == "lstm":
            self._read_lstm(node, names, outputs)
        elif kind == "TupleUnpack" and names[0] in self._side:
            self._like(names[0], outputs[0])
        elif kind == "TupleConstruct" and mine:
            # (output, state): the state is nobody's input here.
            self._like(mine[0], outputs[0])
        elif not mine or kind in _ASKING or not outputs:
            return
        elif kind in _RESHAPING and names[0] == mine[0]:
            self._like(names[0], outputs[0])
        elif self._side[mine[0]] == _BEFORE:
            self._read_before(node, kind, names, outputs[0])
        else:
            self._read_behind(node, mine[0], outputs[0])

    def _like(self, source: str, output: str) -> None:
        self._side[output] = self._side[source]
        if source in self._scale:
            self._scale[output] = self._scale[source]
        if source in self._last:
            self._last[output] = self._last[source]

    def _read_branches(self, node: Any, outputs: list[str]) -> None:
        blocks = list(node.blocks())
        for block in blocks:
            self._read_block(block)
        for k, output in enumerate(outputs):
            made = [list(block.outputs())[k].debugName() for block in blocks]
            mine = [name for name in made if name in self._side]
            if not mine:
                continue
            first = mine[0]
            if any(
                self._side[name] != self._side[first]
                or self._last.get(name) != self._last.get(first)
                or not _same(self._scale.get(name), self._scale.get(first))
                for name in mine
            ):
                raise self._refused("prim::If", "its branches do different things")
            self._like(first, output)

    def _read_lstm(self, node: Any, names: list[str], outputs: list[str]) -> None:
        if self._side.get(names[0]) != _BEFORE:
            raise self._refused("aten::lstm", "it does not work on the network's inputs")
        if self._found and not _same(self._scale[names[0]], self.before):
            raise self._refused("aten::lstm", "there are two of it")
        self._found = True
        self.before = self._scale[names[0]]
        self.batch_first = bool(list(node.inputs())[-1].toIValue())
        self._side[outputs[0]], self._last[outputs[0]] = _BEHIND, 0

    def _read_before(self, node: Any, kind: str, names: list[str], output: str) -> None:
        where = self._where(node, kind)
        mine = next(name for name in names if name in self._side)
        constants = [value.toIValue() for value in node.inputs()]
        self._chain.current = mine
        if kind == "batch_norm":
            scale, shift = self._normalised(where, constants)
        elif kind in self.affine_kinds:
            scale, shift = self._affine(where, kind, names, constants)
        else:
            raise self._refused(where, "before the LSTM there may be scales and offsets alone")
        so_far = self._scale[mine]
        scale, shift = (np.asarray(one, dtype=np.float64).reshape(-1) for one in (scale, shift))
        self._side[output] = _BEFORE
        self._scale[output] = scale * so_far[0], scale * so_far[1] + shift

    def _read_behind(self, node: Any, mine: str, output: str) -> None:
        if self._last[mine] != self._operations:
            raise self._refused(
                self._where(node, node.kind()), "it does not work on the layer before it"
            )
        self._chain.current = mine
        self._read_node(node)
        self._operations += 1
        self._side[output], self._last[output] = _BEHIND, self._operations

    def _refused(self, where: str, why: str) -> ValueError:
        return ValueError(
            f"{self._chain.source}: {where} cannot be converted: {why}. A network should be fixed "
            "scales and offsets, one torch.nn.LSTM, one linear layer and again fixed scales and "
            "offsets; of a state dict only the weights are read"
        )


def _script(module: Any) -> Any:
    torch = import_torch()
    try:
        return torch.jit.script(module)
    except Exception:  # the module's own code is compiled here, and may be anything
        return None


def _same(one: Any, other: Any) -> bool:
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
