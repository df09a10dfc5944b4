"""Pages that are made when the site is built: the effects with their signatures, and the reference.

A signature is what one effect changes in the log of a simulated leg: the same targets, replayed by
the leg as it is and with the effect at one of the sizes that a search tries. A hook of MkDocs.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "disable")

import mujoco
import numpy as np
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))
from _house import house
from _plot import Panel, drawing

from benchmarks.house import LAYERS, imports, modules
from walkerkit.gap.effects import CATALOGUE, Effect
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import cut
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.walkers import LEG_XML

FAMILIES = {
    "friction": ("Friction", ("friction", "law_friction")),
    "transmission": ("Transmission", ("transmission", "play", "periodic")),
    "inertia": ("Inertia", ("inertia",)),
    "drive": ("Drive", ("actuation", "laws_drive")),
    "controller": ("Controller", ("laws_controller",)),
    "measurement": ("Timing and measurement", ("timing", "measurement")),
    "surroundings": ("Surroundings", ("environment", "mount_compliance", "ground", "timestep")),
}
PACKAGES = ("gap", "actuators", "walkers", "tasks")
JOINT = "calf"
_SECONDS, _RATE, _MOST_SIZES = 3.0, 250.0, 3
_SAME_MOTION = 0.3  # of the motion, which an effect may change for its picture
_OF_THE_CONTACT = {"ground_friction", "ground_compliance", "foot_offset"}


def on_files(files: Files, config: Any) -> Files:
    """Adds the generated pages and pictures; called by MkDocs."""
    for path, content in pages():
        files.append(File.generated(config, path, content=content))
    return files


def pages() -> Iterator[tuple[str, str | bytes]]:
    """Every generated file: its path in the site's sources, and what is in it."""
    by_family = {family: list(_members(modules)) for family, (_, modules) in FAMILIES.items()}
    missing = set(CATALOGUE) - {effect.name for found in by_family.values() for effect in found}
    if missing:
        raise ValueError(f"FAMILIES lack the modules of {', '.join(sorted(missing))}")
    yield "effects/index.md", _index(by_family)
    signatures = Signatures()
    for family, effects in by_family.items():
        yield f"effects/{family}.md", _family(FAMILIES[family][0], effects, signatures)
        for effect in effects:
            yield f"effects/{effect.name}.svg", signatures.picture(effect)
    for package in PACKAGES:
        yield f"reference/{package}.md", _reference(package)
    yield "house.svg", house(LAYERS, imports(modules()))
    changes = Path(__file__).parents[1] / "CHANGELOG.md"
    yield "changes.md", changes.read_text(encoding="utf-8")


def _members(modules: tuple[str, ...]) -> Iterator[Effect]:
    for module in modules:
        for effect in CATALOGUE.values():
            if type(effect).__module__.rpartition(".")[2] == module:
                yield effect


def _index(by_family: dict[str, list[Effect]]) -> str:
    lines = [
        "# All effects",
        "",
        f"The catalogue has {len(CATALOGUE)} effects; `walkerkit effects` prints it. Each is what "
        "a diagnosis can name, and what `gap.fit` takes by name.",
    ]
    for family, effects in by_family.items():
        lines += ["", f"## {FAMILIES[family][0]}", "", "| effect | where it shows |", "|---|---|"]
        lines += [
            f"| [`{effect.name}`]({family}.md#{effect.name}) | {_cell(effect.symptom)} |"
            for effect in effects
        ]
    return "\n".join(lines) + "\n"


def _family(title: str, effects: list[Effect], signatures: Signatures) -> str:
    lines = [
        f"# {title}",
        "",
        f"Left: the log of the `{JOINT}` of a simulated leg, as it is and with the effect. Right: "
        "the difference, which is what a search has to explain. The size is one of those at which "
        "the search tries the effect.",
    ]
    for effect in effects:
        kind = {"joint": "a joint", "body": "a body", "robot": "the whole robot"}[effect.kind]
        doc = " ".join((type(effect).__doc__ or "").split())
        lines += [
            "",
            f"## {effect.name} {{ #{effect.name} }}",
            "",
            doc,
            "",
            f"`{effect.equation}`",
            "",
            f"![What {effect.name} changes]({effect.name}.svg)",
            "",
            f"Shows: {effect.symptom}. Of {kind}. Added as: {effect.added_as}. "
            f"Source: {effect.source}.",
            "",
        ]
        parameters = signatures.parameters(effect)
        if parameters:
            lines += ["| parameter | unit | without effect |", "|---|---|---|"]
            lines += [f"| `{p.name}` | {p.unit} | {p.zero:.3g} |" for p in parameters]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _reference(package: str) -> str:
    module = importlib.import_module(f"walkerkit.{package}")
    lines = [f"# walkerkit.{package}", "", f"What `from walkerkit.{package} import` has.", ""]
    for name in sorted(module.__all__):
        value = getattr(module, name)
        if type(value).__name__ == "module":
            lines += [f"::: {value.__name__}", "    options:", "      heading_level: 2", ""]
        else:
            lines += [f"::: walkerkit.{package}.{name}", ""]
    return "\n".join(lines)


class Signatures:
    """The leg and its targets, replayed with and without effects."""

    def __init__(self) -> None:
        robot = load_robot(str(LEG_XML))
        time = np.arange(0, _SECONDS, 1 / _RATE)
        recording = _recording(robot, time)
        joints = tuple(robot.joints)
        self.robot = _sized(robot, recording, joints)
        self.joints = joints
        self.channels = (
            Channel(joint=JOINT, signal="position"),
            Channel(joint=JOINT, signal="effort"),
        )
        self.recording = recording
        self.replay = Replay(self.robot, cut([recording], None), self.channels, n_threads=1)
        nothing = Structure((), (self.robot,))
        self.before = self.replay.predict(nothing.trials(self.robot, np.zeros((1, 0))))[0]

    def structure(self, effect: Effect) -> Structure | None:
        """The effect on the joint that is shown, or where else it can be; None on this robot."""
        terms = candidate_terms([effect], [self.robot], self.joints)
        if not terms:
            return None
        term = terms[0]
        site = JOINT if JOINT in term.sites else term.sites[-1]
        return Structure((type(term)(effect=effect, sites=(site,)),), (self.robot,))

    def parameters(self, effect: Effect) -> list[Any]:
        """The effect's parameters."""
        structure = self.structure(effect)
        return [] if structure is None else [slot.parameter for slot in structure.slots]

    def picture(self, effect: Effect) -> str:
        """An SVG of what the effect changes."""
        if effect.name in _OF_THE_CONTACT:
            return _contact(effect.name)
        structure = self.structure(effect)
        if structure is None:
            raise ValueError(f"the leg cannot have {effect.name}: draw it as a contact is drawn")
        starts = zip(*(slot.parameter.starts for slot in structure.slots), strict=True)
        values = np.array(list(starts))
        values = values[:: -(-len(values) // _MOST_SIZES)]
        tried = self.replay.predict(structure.trials(self.robot, values))
        changes = np.abs(tried - self.before).max(axis=1)
        scale = np.abs(self.before).max(axis=0)
        # The largest that still looks like the same motion.
        sizes = np.nan_to_num((changes / scale).max(axis=1), nan=np.inf)
        fits = np.flatnonzero(sizes < _SAME_MOTION)
        chosen = int(fits[np.argmax(sizes[fits])]) if len(fits) else int(np.argmin(sizes))
        numbers = ", ".join(
            f"{slot.parameter.name} {value:.3g} {slot.parameter.unit}"
            for slot, value in zip(structure.slots, values[chosen], strict=True)
        )
        time, rows = self.recording.time, []
        for row, (name, unit, factor, small) in enumerate(
            (("position", "rad", 1e3, "mrad"), ("effort", "N·m", 1.0, "N·m"))
        ):
            before, after = self.before[:, row], tried[chosen][:, row]
            lines = [("before", before), ("after", after)]
            difference = [("difference", factor * (after - before))]
            rows.append(
                [
                    Panel(label=f"{name} [{unit}]", x=time, lines=lines),
                    Panel(label=f"difference [{small}]", x=time, lines=difference),
                ]
            )
        return drawing(f"{effect.name}: {numbers}", rows)


def _recording(robot: Robot, time: np.ndarray) -> Recording:
    """Two seconds of slow triangles, which reverse; then steps and a fast wave."""
    home = {"hip": 0.0, "thigh": 0.9, "calf": -1.8}
    triangle = np.abs((time + 0.5) % 2 - 1) * 2 - 1
    wave = np.sin(2 * np.pi * 2 * time)
    shape = np.where(time < 2, 0.3 * triangle, np.where(time < 2.4, 0.25, 0.2 * wave))
    shape *= np.minimum(1, 4 * time)
    columns = {"voltage": 24.0 * (1 + 0.2 * np.sin(2 * np.pi * 0.7 * time))}
    for joint in robot.joints:
        target = home[joint] + shape * (0.4 if joint == "hip" else 1.0)
        columns |= {f"{joint}/{signal}": target for signal in ("position", "position_target")}
    return Recording(name="signature", time=time, columns=columns)


def _sized(robot: Robot, recording: Recording, joints: tuple[str, ...]) -> Robot:
    return replace(robot, excursions=excursions(robot, [recording], joints))


def _contact(name: str) -> str:
    """A foot on the ground: pushed ever harder, or put down."""
    cases = {  # friction, time constant [s], by how much the foot is further down [m]
        "ground_friction": ((0.4, 0.02, 0.0), (0.8, 0.02, 0.0)),
        "ground_compliance": ((0.8, 0.01, 0.0), (0.8, 0.04, 0.0)),
        "foot_offset": ((0.8, 0.01, 0.0), (0.8, 0.01, 0.005)),
    }[name]
    shown = []
    for friction, timeconst, lower in cases:
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="0.001" cone="elliptic"/><worldbody>
            <geom type="plane" size="1 1 1" solref="{timeconst} 1" friction="{friction}"/>
            <body pos="0 0 0.06"><freejoint/>
            <geom type="box" pos="0 0 {-lower}" size="0.05 0.05 0.05" mass="2"
            solref="{timeconst} 1" friction="{friction}"/></body></worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        rows = []
        while data.time < 1:
            push = 20 * max(0.0, data.time - 0.3)
            data.qfrc_applied[0] = push if name == "ground_friction" else 0.0
            mujoco.mj_step(model, data)
            rows.append((data.time, 1e3 * (data.qpos[2] - 0.05), data.qvel[0]))
        shown.append(np.array(rows).T)
    (time, *before), (_, *after) = shown
    labels = ("height [mm]", "speed along the ground [m/s]")
    panels = [
        Panel(label=label, x=time, lines=[("before", one), ("after", other)])
        for label, one, other in zip(labels, before, after, strict=True)
    ]
    return drawing(f"{name}: a foot of 2 kg", [panels])
