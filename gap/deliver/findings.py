"""What a saved diagnosis says, read again from its folder."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from walkerkit.gap.errors import InputError, one_line
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, with_sidecar

DIAGNOSIS = "diagnosis.json"


@dataclass(frozen=True, kw_only=True)
class Findings:
    """A diagnosis as its folder has it.

    Attributes:
        folder: the folder.
        content: diagnosis.json.
        models: names of the mended models.
        robot: the first of them, with what lies beside it.
    """

    folder: Path
    content: Mapping[str, Any]
    models: tuple[str, ...]
    robot: Robot

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The named effects, as in diagnosis.json."""
        effects: list[dict[str, Any]] = self.content["effects"]
        return effects

    def without(self, names: Collection[str]) -> Findings:
        """The diagnosis without some effects, their numbers and the correlations of these.

        Args:
            names: of the effects.
        """
        if not names:
            return self
        numbers = [effect["effect"] for effect in self.effects for _ in effect["parameters"]]
        kept = [number for number, name in enumerate(numbers) if name not in names]
        effects = [effect for effect in self.effects if effect["effect"] not in names]
        content = {**self.content, "effects": effects}
        if content.get("correlation"):
            rows = content["correlation"]
            content["correlation"] = [[rows[i][j] for j in kept] for i in kept]
        return replace(self, content=content)


def read_findings(folder: Path, *, given: Robot | None = None) -> Findings:
    """Reads the folder of a diagnosis.

    Args:
        folder: what `diagnose` has saved.
        given: the robot as it was, for laws in Python, which no folder holds; without it, a
            diagnosis that has some is refused.

    Raises:
        InputError: it is none.
    """
    if folder.is_file():
        raise InputError(
            f"{folder}: is a file. Name the folder that `walkerkit diagnose --out` has written; it "
            "comes before the model."
        )
    try:
        content = json.loads((folder / DIAGNOSIS).read_text(encoding="utf-8"))
        beside = json.loads((folder / FILE).read_text(encoding="utf-8"))
        models = tuple(name for name in beside["models"] if not name.startswith("next_experiment"))
        for effect in content["effects"]:
            for parameter in effect["parameters"]:
                parameter["was"], parameter["is"], parameter["field"]
    except FileNotFoundError as error:
        raise InputError(
            f"{folder}: is no folder of a diagnosis, as {Path(error.filename).name} is missing. "
            "Name what `walkerkit diagnose --out` has written."
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{folder}: its {DIAGNOSIS} or {FILE} is none of this version's "
            f"({type(error).__name__}: {one_line(error)}). Diagnose once more."
        ) from None
    if not models:
        raise InputError(f"{folder / FILE}: names no model. Diagnose once more.")
    path = folder / models[0]
    robot = with_sidecar(load_robot(path, allow_outside=True), path, given=given)
    return Findings(folder=folder, content=content, models=models, robot=robot)
