"""The units of a log's signals, from what its numbers can be on this robot.

    mapping, notes = with_units(log, model, mapping, given)

Positions are radians where they fit the joints' ranges as radians. Those of LeRobot may be degrees
or per cent of a calibrated range; which of the two often cannot be told from numbers, and is then
refused with the lines of a map that tell it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from walkerkit.gap.errors import InputError, refusal
from walkerkit.gap.ingest.column_map import OF_RANGE, UNITS, ColumnMap, JointMap, SignalMap
from walkerkit.gap.ingest.log import FloatArray, Log
from walkerkit.gap.ingest.model import Model, ModelJoint
from walkerkit.gap.ingest.rows import recording_of
from walkerkit.gap.units import velocity_likeness

_ROOM = 0.1  # of a range, that a joint may be beyond it
_LEAST_ROOM = 0.1  # rad
_FARTHEST = 50.0  # rad, that a joint without a range may be
_PERCENT = 100.0 + 1e-3
_NEAR = 1.2  # times a unit's factor
_UNIT_OF_VELOCITY = ("rad/s", "deg/s", "rev/s", "rpm")


def with_units(
    log: Log, model: Model, mapping: ColumnMap, given: ColumnMap
) -> tuple[ColumnMap, tuple[str, ...]]:
    """A map with the units of its signals.

    Args:
        log: what was read.
        model: the joints' ranges.
        mapping: all but units.
        given: units that it has stay.

    Returns:
        The map, and what was assumed that may be wrong.

    Raises:
        InputError: it is in doubt.
    """
    return _Units(log, model, mapping, given).found()


class _Units:
    def __init__(self, log: Log, model: Model, mapping: ColumnMap, given: ColumnMap):
        self._log, self._model, self._map, self._given = log, model, mapping, given
        self._joints = dict(mapping.joints or {})
        self._notes: list[str] = []

    def found(self) -> tuple[ColumnMap, tuple[str, ...]]:
        signals = {
            kind: signal if signal.unit != "" else replace(signal, unit=self._plain(kind))
            for kind, signal in self._map.signals.items()
        }
        angles = [k for k in ("position", "position_target") if k in signals]
        unsaid = [k for k in angles if self._map.signals[k].unit == ""]
        if unsaid and any(not self._model.joints[j].slide for j in self._joints):
            unit = self._of_positions(unsaid)
            signals |= {kind: replace(signals[kind], unit=unit) for kind in unsaid}
        if self._log.convention == "lerobot" and self._given.joints is None:
            self._with_grippers(signals)
        self._with_ranges(signals)
        mapping = replace(self._map, signals=signals, joints=self._joints)
        if "velocity" in signals and self._map.signals["velocity"].unit == "":
            mapping = self._with_velocity(mapping)
        return mapping, tuple(self._notes)

    def _plain(self, kind: str) -> str:
        """The SI unit of a signal."""
        slides = all(self._model.joints[joint].slide for joint in self._joints)
        return {
            "position": "m" if slides else "rad",
            "velocity": "m/s" if slides else "rad/s",
            "effort": "N" if slides else "N·m",
        }[kind.removesuffix("_target")]

    def _of_positions(self, kinds: Sequence[str]) -> str:
        """The unit of positions and their targets, which are in one unit if neither is known."""
        values = {
            joint: np.concatenate([self._values(kind, joint) for kind in kinds])
            for joint in self._joints
            if not self._model.joints[joint].slide
        }
        known = self._known_beside(kinds)
        if known is not None:
            return known
        if all(self._fits(joint, v) for joint, v in values.items()):
            return "rad"
        lerobot = self._log.convention == "lerobot"
        degrees = {joint: UNITS["position"]["deg"] * v for joint, v in values.items()}
        arm = [joint for joint in values if not (lerobot and _is_gripper(self._joints[joint]))]
        absolute = all(self._fits(joint, degrees[joint]) for joint in arm)
        centred = all(self._fits(j, degrees[j] + self._middle(j)) for j in arm)
        peak = max((float(np.abs(values[j]).max(initial=0.0)) for j in arm), default=0.0)
        share = lerobot and peak <= _PERCENT
        if lerobot and share == (absolute or centred):
            raise self._doubt(kinds, peak)
        if share:
            return "m100"
        if absolute or (lerobot and centred):
            if not absolute:
                self._center(arm)
            self._notes.append(
                "positions were taken for degrees: they are beyond the joints' ranges in radians"
            )
            return "deg"
        return "rad"  # the checks of a recording say what is wrong with them

    def _known_beside(self, kinds: Sequence[str]) -> str | None:
        """The unit that the given map has for the other of position and target."""
        for kind in ("position", "position_target"):
            signal = self._map.signals.get(kind)
            if kind not in kinds and signal is not None and isinstance(signal.unit, str):
                return signal.unit or None
        return None

    def _center(self, joints: Sequence[str]) -> None:
        """Has degrees count from the middle of the joints' ranges."""
        for joint in joints:
            if self._given.joints is None:
                self._joints[joint] = replace(self._joints[joint], offset=self._middle(joint))
        self._notes.append(
            "degrees were taken to count from the middle of each joint's range, as LeRobot "
            "calibrates them"
        )

    def _with_grippers(self, signals: Mapping[str, SignalMap]) -> None:
        """Has grippers count from 0 to 100, as LeRobot has them beside degrees and per cent."""
        if any(signals[k].unit in ("deg", "m100") for k in signals if k.startswith("position")):
            for name, joint in self._joints.items():
                if _is_gripper(joint):
                    self._joints[name] = replace(joint, unit="percent")

    def _with_ranges(self, signals: Mapping[str, SignalMap]) -> None:
        """Fills in the ranges that positions are parts of."""
        shared = {signals[k].unit for k in signals if k.startswith("position")}
        for name, joint in self._joints.items():
            if joint.range is None and ({joint.unit} | shared) & set(OF_RANGE):
                self._joints[name] = replace(joint, range=self._range(name, joint))

    def _range(self, name: str, joint: JointMap) -> tuple[float, float]:
        model = self._model.joints[name]
        label = joint.log.removesuffix(".pos")
        width = self._log.calibrated.get(label)
        if width is not None:
            middle = self._middle(name)
            return middle - width / 2, middle + width / 2
        if not np.isfinite(model.upper):
            raise refusal(
                f"{self._log.path}: joint {name!r} is logged in parts of a range, and neither the "
                "model nor a calibration has its range. Write it into the map, [joints] with "
                f'{name} = {{log = "{joint.log}", range = [-1.5, 1.5]}} for example.'
            )
        self._notes.append(
            f"{name}: parts of a range were taken of the model's, {model.lower:.4g} to "
            f"{model.upper:.4g} rad"
        )
        return model.lower, model.upper

    def _with_velocity(self, mapping: ColumnMap) -> ColumnMap:
        """The map with the unit of velocities that the slopes of the positions show."""
        try:
            recording = recording_of(self._log, mapping)
            ratios = [
                abs(likeness.ratio)
                for joint in recording.joints
                if not self._model.joints[joint].slide
                and (likeness := velocity_likeness(recording, joint)) is not None
                and abs(likeness.alike) > 0.9
            ]
        except InputError:
            return mapping  # whoever makes the recording says what is wrong
        if not ratios:
            return mapping
        ratio = float(np.median(ratios))
        for unit in _UNIT_OF_VELOCITY:
            factor = 1 / UNITS["velocity"][unit]
            if factor / _NEAR < ratio < factor * _NEAR and unit != "rad/s":
                self._notes.append(
                    f"velocities are {ratio:.3g} times the slopes of the positions, and were "
                    f"taken for {unit}"
                )
                changed = replace(mapping.signals["velocity"], unit=unit)
                return replace(mapping, signals={**mapping.signals, "velocity": changed})
        return mapping

    def _values(self, kind: str, joint: str) -> FloatArray:
        """What the log has of a joint, in its own unit."""
        name = self._map.signals[kind].column(joint, self._joints[joint])
        column = self._log.columns.get(name or "")
        if column is None:
            return np.zeros(0)
        values = column.values[np.isfinite(column.values)]
        return self._joints[joint].sign * values[np.abs(values) < 1e9]

    def _fits(self, joint: str, values: FloatArray) -> bool:
        """Whether a joint may be at all of some positions [rad]."""
        model = self._model.joints[joint]
        if not values.size:
            return True
        if not np.isfinite(model.upper):
            return float(np.abs(values).max()) <= _FARTHEST
        offset = self._joints[joint].offset
        room = max(_ROOM * (model.upper - model.lower), _LEAST_ROOM)
        # A target may be well beyond a stop; the quantiles leave a few samples that are wrong.
        low, high = np.quantile(values + offset, (0.02, 0.98))
        return bool(low >= model.lower - room and high <= model.upper + room)

    def _middle(self, joint: str) -> float:
        model: ModelJoint = self._model.joints[joint]
        return 0.5 * (model.lower + model.upper) if np.isfinite(model.upper) else 0.0

    def _doubt(self, kinds: Sequence[str], peak: float) -> InputError:
        return refusal(
            f"{self._log.path}: positions of up to {peak:.4g} may be degrees, or per cent of each "
            "joint's calibrated range, as LeRobot records them unless use_degrees is set. Write "
            f'which into a map, below a line [signals.{kinds[0]}], unit = "deg" or unit = "m100", '
            "and give it with --map."
        )


def _is_gripper(joint: JointMap) -> bool:
    return "gripper" in joint.log.lower()
