"""Whether variants of a robot come through a motion: upright, on their feet, within their limits.

    fault_of(stand, path, time, ran, which)    # (3, "FL_foot slips 14 mm, 5 mm are allowed (…)")

Judged by simulation alone, for each variant of `Stand.variants`, from the end of the first still
second on. `BOUNDS` has what is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import MappingProxyType
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.gap.standing.motions import Path
from walkerkit.gap.standing.simulated import Simulated
from walkerkit.gap.standing.soles import Area, collided, touching
from walkerkit.gap.standing.standing_pose import Stand

FloatArray = NDArray[np.float64]

BOUNDS: Final = MappingProxyType(
    {
        "tilt": 0.25,  # rad, of the base from where it is sent
        "height": 0.25,  # of the base's height, that it may be lower than it is sent
        "slip": 0.005,  # m, that a foot which stands may move along the ground in half a second
        "slip of a hop": 0.04,  # m, from take-off to the end
        "pressure": 0.1,  # of the support polygon's depth, that its centre stays inside
        "range": 0.01,  # of a joint's range, that it stays inside
        "effort": 0.95,  # of a drive's limit
        "lifted": 0.005,  # m, that a foot which is to leave the ground does on the model itself
    }
)
"""What a motion must keep within."""

_LOOKED_AT = 0.02  # s between poses whose feet and collisions are looked at
_BEGUN = 0.5  # s, after which a variant has settled
_STANDS = 2e-3  # m; a sole that is sent no higher is to stand
_LOADED = 0.5  # of its share; a foot that carries less may slip as it is lifted
_SLIPS = 0.5  # s, since contacts of MuJoCo creep, by a millimetre a second, without slipping


def fault_of(
    stand: Stand,
    path: Path,
    time: FloatArray,
    ran: Simulated,
    which: Sequence[int],
) -> tuple[int, str] | None:
    """The first fault of a motion that was simulated, None where there is none.

    Args:
        stand: the robot as it stands.
        path: what it was to do.
        time: (T,) of that [s].
        ran: what some of its variants did.
        which: their numbers.

    Returns:
        The number of the variant, and what it does, in words.
    """
    for row, k in enumerate(which):
        words = next(_faults(stand, path, time, ran, row, first=k == 0), None)
        if words is not None:
            return k, f"{words} ({stand.variants.names[k]})"
    return None


def _faults(
    stand: Stand, path: Path, time: FloatArray, ran: Simulated, k: int, *, first: bool
) -> Iterator[str]:
    """What row k does that it must not, in words; whether it is the model itself; gravest first."""
    if not np.isfinite(ran.qpos[k]).all():
        yield "the simulation diverges"
        return
    at = ran.step * np.arange(1, ran.qpos.shape[1] + 1)
    begun = at >= _BEGUN
    wanted = path.at(time, at)
    yield from _fallen(stand, wanted, ran.qpos[k], begun)
    yield from _efforts(stand, ran.effort[k], begun)
    yield from _ranges(stand, ran.qpos[k], begun)
    stride = max(1, round(_LOOKED_AT / ran.step))
    rows = np.flatnonzero(begun)[::stride]
    feet, met = _looked_at(stand, ran.qpos[k, rows])
    if met:
        yield f"{met} meet" if " and " in met else f"{met} touches the ground"
    yield from _feet(stand, wanted, rows, feet, first=first)
    if not path.flies:
        yield from _pressure(stand, wanted.lifted[rows], feet, ran.pressure(stand.level)[k, rows])


def _fallen(
    stand: Stand, wanted: Path, qpos: FloatArray, begun: NDArray[np.bool_]
) -> Iterator[str]:
    place = stand.base.qpos
    home, quaternions = stand.qpos, np.roll(qpos[:, place + 3 : place + 7], -1, axis=1)
    upright = Rotation.from_quat(np.roll(home[place + 3 : place + 7], -1))
    error = Rotation.from_quat(quaternions) * (Rotation.from_rotvec(wanted.turn) * upright).inv()
    tilt = np.linalg.norm(error.as_rotvec()[:, :2], axis=1)[begun].max()
    if tilt > BOUNDS["tilt"]:
        yield f"the base tilts by {tilt:.2f} rad, {BOUNDS['tilt']:g} rad are allowed"
    low = (home[place + 2] + wanted.shift[:, 2] - qpos[:, place + 2])[begun].max()
    if low > BOUNDS["height"] * stand.height:
        yield f"the base sinks {1e3 * low:.0f} mm lower than it is sent"


def _efforts(stand: Stand, effort: FloatArray, begun: NDArray[np.bool_]) -> Iterator[str]:
    for joint in stand.joints:
        limit = effort_limit(stand.robot, joint)
        most = float(np.abs(effort[begun, joint.dof]).max())
        if most > BOUNDS["effort"] * limit:
            unit = "N" if joint.slide else "N·m"
            yield f"{joint.name} takes {most:.3g} {unit} of its {limit:.3g}"


def _ranges(stand: Stand, qpos: FloatArray, begun: NDArray[np.bool_]) -> Iterator[str]:
    model = stand.robot.model
    for joint in stand.joints:
        if not model.jnt_limited[joint.id]:
            continue
        low, high = model.jnt_range[joint.id]
        margin = BOUNDS["range"] * (high - low)
        series = qpos[begun, joint.qpos]
        if series.min() < low + margin or series.max() > high - margin:
            yield f"{joint.name} comes to the end of its range"


def _looked_at(stand: Stand, qpos: FloatArray) -> tuple[list[FloatArray], str]:
    """(T, n, 3) the points of each sole, and what touches that did not as it stood, in words."""
    model, ground = stand.robot.model, Ground(stand.robot.model)
    data = mujoco.MjData(model)
    data.qpos[:] = stand.qpos
    collided(model, data)
    known, met = _pairs(model, data, ground), ""
    soles = {sole.body for sole in stand.soles}
    feet = [np.empty((len(qpos), len(sole.points), 3)) for sole in stand.soles]
    for t, one in enumerate(qpos):
        data.qpos[:] = one
        collided(model, data)
        for f, sole in enumerate(stand.soles):
            feet[f][t] = sole.where(data)
        for pair in _pairs(model, data, ground) - known:
            others = [body for body in pair if body and body not in soles]
            if met or (0 in pair and not others):
                continue
            names = [model.body(body).name or f"body {body}" for body in sorted(pair) if body]
            met = " and ".join(names)
    return feet, met


def _pairs(model: mujoco.MjModel, data: mujoco.MjData, ground: Ground) -> set[tuple[int, int]]:
    """Rigid bodies that touch each other, or the ground, which is 0."""
    grounded = set(touching(model, data, ground))
    found = set()
    for k in range(data.ncon):
        if data.contact[k].dist > 0:
            continue
        bodies = sorted(
            int(model.body_weldid[model.geom_bodyid[geom]]) for geom in data.contact[k].geom
        )
        found.add((0, bodies[1]) if k in grounded else (bodies[0], bodies[1]))
    return found


def _feet(
    stand: Stand, wanted: Path, rows: NDArray[np.intp], feet: list[FloatArray], *, first: bool
) -> Iterator[str]:
    """Feet that slip, and, of the model itself, feet that stay where they should not."""
    lifted, carries = wanted.lifted[rows], wanted.carries[rows] >= _LOADED
    heights = np.stack([points[..., 2].min(axis=1) - points[0, :, 2].min() for points in feet], 1)
    for f, sole in enumerate(stand.soles):
        middle = feet[f].mean(axis=1)[:, :2]
        stands = carries[:, f] & (heights[:, f] < _STANDS)
        if wanted.flies:
            slip, most = np.linalg.norm(middle - middle[0], axis=1)[stands], "slip of a hop"
        else:
            lag = round(_SLIPS / _LOOKED_AT)
            stood = np.array([stands[t : t + lag + 1].all() for t in range(len(stands) - lag)])
            slip, most = np.linalg.norm(middle[lag:] - middle[:-lag], axis=1)[stood], "slip"
        if slip.max(initial=0.0) > BOUNDS[most]:
            yield (
                f"{sole.name} slips {1e3 * slip.max():.1f} mm, {1e3 * BOUNDS[most]:g} mm are "
                "allowed"
            )
    least = BOUNDS["lifted"]
    if first and wanted.flies and heights.min(axis=1).max() < least:
        yield f"its feet are less than {1e3 * least:.0f} mm off the ground at once"
    for sole, up, height in zip(stand.soles, lifted.T, heights.T, strict=True):
        if first and up.max() > 0 and height.max() < least:
            yield f"{sole.name} does not leave the ground by {1e3 * least:.0f} mm"


def _pressure(
    stand: Stand, lifted: FloatArray, feet: list[FloatArray], pressure: FloatArray
) -> Iterator[str]:
    """The centre of pressure too near the edge of what is to carry the robot."""
    for which in np.unique(lifted > _STANDS, axis=0):
        rows = np.flatnonzero(((lifted > _STANDS) == which).all(axis=1))
        down = [points for points, up in zip(feet, which, strict=True) if not up]
        area = Area(np.concatenate([points[rows[0]] for points in down])[:, :2])
        needed = BOUNDS["pressure"] * area.depth
        margin = float(np.nanmin(area.margin(pressure[rows]), initial=np.inf))
        if margin < needed:
            yield (
                f"the centre of pressure comes within {1e3 * margin:.0f} mm of the edge of the "
                f"support polygon, {1e3 * needed:.0f} mm are needed"
            )


def effort_limit(robot: Robot, joint: Joint) -> float:
    """What a joint's drive makes at most [N·m; N]; infinite where nothing says."""
    limits = [np.inf]
    own = robot.number(joint.name, "effort_limit")
    if own is not None:
        limits.append(own)
    model, drive = robot.model, joint.drive("position")
    if drive is not None and model.actuator_forcelimited[drive.actuator]:
        gear = float(np.abs(model.actuator_gear[drive.actuator, 0]))
        limits.append(gear * float(np.abs(model.actuator_forcerange[drive.actuator]).max()))
    if model.jnt_actfrclimited[joint.id]:
        limits.append(float(np.abs(model.jnt_actfrcrange[joint.id]).max()))
    return float(min(limits))
