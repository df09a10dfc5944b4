"""The state that a simulated segment starts from.

The measured joints start as measured. Everything else is at rest as in the model's first keyframe;
what drives remember of earlier commands (delays, filters) comes from the commands before the start.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from walkerkit.gap.simulation.interpolate import made_delay

FloatArray = NDArray[np.float64]

_EXACT = int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), _EXACT)
_SETTLED, _LONGEST = 10, 1.0  # time constants; s
ROUNDED = 1e-6  # steps
HELD = 0  # interpolation of a delay
_HISTORY_HEAD = 2  # numbers before the times and values of a history
# Models are never written to, so that they rest where they did.
_RESTING: weakref.WeakKeyDictionary[mujoco.MjModel, FloatArray] = weakref.WeakKeyDictionary()


def rest(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> mujoco.MjData:
    """The model at rest in its first keyframe, or in its reference pose where it has none.

    Args:
        model: the model.
        data: of the model, or of another of the same sizes, to be used again; new by default.
    """
    if data is None:
        data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    else:
        mujoco.mj_resetData(model, data)
    data.qvel[:] = 0
    data.time = 0
    return data


def memory(model: mujoco.MjModel) -> int:
    """How many steps of past commands its actuators remember."""
    delayed = int(model.actuator_history[:, 0].max(initial=0))
    filtered = np.isin(model.actuator_dyntype, _FILTERS)
    constant = float(model.actuator_dynprm[filtered, 0].max(initial=0.0))
    seconds = min(_SETTLED * constant, _LONGEST)
    return delayed + int(np.ceil(seconds / model.opt.timestep))


def start_state(
    model: mujoco.MjModel,
    past: FloatArray,
    qpos: FloatArray,
    qvel: FloatArray,
    addresses: tuple[Sequence[int], Sequence[int]],
) -> FloatArray:
    """The states of all simulations at time zero.

    Args:
        model: the model.
        past: (..., memory, nu) the commands of the steps before.
        qpos: (..., n_joints) measured positions [rad; m on slide joints].
        qvel: (..., n_joints) measured velocities [rad/s; m/s on slide joints].
        addresses: of these joints in qpos and in qvel.

    Returns:
        (..., nstate) rows of mjSTATE_INTEGRATION.
    """
    delayed = _delayed(model)
    if model not in _RESTING:
        _RESTING[model] = _resting(model)
    state = np.tile(_RESTING[model], (*past.shape[:-2], 1))
    state[..., state_offset(model, mujoco.mjtState.mjSTATE_QPOS) + np.asarray(addresses[0])] = qpos
    state[..., state_offset(model, mujoco.mjtState.mjSTATE_QVEL) + np.asarray(addresses[1])] = qvel
    for actuator in delayed:
        samples, width = model.actuator_history[actuator, 0], model.actuator_ctrlnum[actuator]
        values = past[..., -samples:, _inputs(model, actuator)]
        address = model.actuator_historyadr[actuator] + _HISTORY_HEAD + samples
        first = state_offset(model, mujoco.mjtState.mjSTATE_HISTORY) + int(address)
        state[..., first : first + samples * width] = values.reshape(*values.shape[:-2], -1)
    for filtering in np.flatnonzero(np.isin(model.actuator_dyntype, _FILTERS)):
        address = (
            state_offset(model, mujoco.mjtState.mjSTATE_ACT) + model.actuator_actadr[filtering]
        )
        state[..., address] = _filtered(model, int(filtering), past)
    return state


def _delayed(model: mujoco.MjModel) -> list[int]:
    return [int(actuator) for actuator in np.flatnonzero(model.actuator_history[:, 0])]


def _resting(model: mujoco.MjModel) -> FloatArray:
    """The state at rest, (nstate,), with histories that begin."""
    data = rest(model)
    for actuator in _delayed(model):
        samples, width = model.actuator_history[actuator, 0], model.actuator_ctrlnum[actuator]
        times = model.opt.timestep * np.arange(-samples, 0)
        mujoco.mj_initCtrlHistory(model, data, actuator, times, np.zeros((samples, width)))
    spec = mujoco.mjtState.mjSTATE_INTEGRATION
    row = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, row, spec)
    return row


def state_offset(model: mujoco.MjModel, component: mujoco.mjtState) -> int:
    """Numbers of a state row before a component: they are laid out in the order of their bits."""
    return int(mujoco.mj_stateSize(model, component.value - 1))


def _inputs(model: mujoco.MjModel, actuator: int) -> slice:
    first = int(model.actuator_ctrladr[actuator])
    return slice(first, first + int(model.actuator_ctrlnum[actuator]))


def _filtered(model: mujoco.MjModel, actuator: int, past: FloatArray) -> FloatArray:
    """Activation of a first-order filter after the past commands, (...)."""
    step, constant = float(model.opt.timestep), float(model.actuator_dynprm[actuator, 0])
    part = step / max(constant, step)
    if model.actuator_dyntype[actuator] == _EXACT and constant > 0:
        part = -float(np.expm1(-step / constant))
    control = _inputs(model, actuator).start
    late = float(made_delay(model.actuator_delay[actuator], step)) / step
    held = model.actuator_history[actuator, 1] == HELD
    commands = _arrived(past[..., control], late, held=bool(held))
    if model.actuator_ctrllimited[control]:
        commands = np.clip(commands, *model.actuator_ctrlrange[control])
    if model.actuator_actlimited[actuator]:
        low, high = model.actuator_actrange[actuator]
        clipped = np.clip(commands[..., 0], low, high)
        for k in range(commands.shape[-1]):
            clipped = np.clip(clipped + part * (commands[..., k] - clipped), low, high)
        return np.asarray(clipped, dtype=np.float64)
    settled = (1 - part) * commands[..., :1]
    activation, _ = lfilter([part], [1, part - 1], commands, zi=settled)
    return np.asarray(activation[..., -1], dtype=np.float64)


def _arrived(commands: FloatArray, late: float, *, held: bool) -> FloatArray:
    """Commands (..., n) as they arrive some steps after they were sent, whole ones or not.

    Args:
        commands: the commands of each step.
        late: by how many steps they are.
        held: whether the last one counts between two of them, and not the line between both.
    """
    steps = np.arange(commands.shape[-1]) - late
    before = np.floor(steps + ROUNDED).astype(np.intp)
    part = np.maximum(steps - before, 0.0)
    first, second = (np.maximum(index, 0) for index in (before, before + 1))
    older, newer = commands[..., first], commands[..., np.minimum(second, len(steps) - 1)]
    between = (part > ROUNDED) & (not held)
    arrived: FloatArray = np.where(between, (1 - part) * older + part * newer, older)
    return arrived
