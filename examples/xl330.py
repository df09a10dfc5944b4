"""A hobby servo at four firmware gains in one manifest: one set of effects for all of them.

    python examples/xl330.py [OUT]

A Dynamixel XL330 that swings a weight (Rhoban/bam, Apache-2.0). Each P gain is a model of its own;
the named effects are shared. The `sin_sin` recordings are held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from _arguments import argument
from _data import folder

from walkerkit import gap

GAINS = (100, 200, 400, 800)
FITTED = ("sin_time_square", "up_and_down", "lift_and_drop")


def manifest(data: Path, path: Path) -> Path:
    """Writes experiments.toml for the data in `data`."""
    parts = []
    for gain in GAINS:
        stem = f"{data.as_posix()}/kp{gain}"
        recordings = ", ".join(f'"{stem}_{name}.csv"' for name in FITTED)
        parts.append(
            f'[[experiment]]\nmodel = "{stem}.xml"\n'
            f'recordings = [{recordings}]\nheld_out = ["{stem}_sin_sin.csv"]\n'
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def main(out: Path, effects: Sequence[str] | None = None) -> gap.Result:
    """Diagnoses the manifest, with the whole catalogue or some effects, and writes the result."""
    given = manifest(folder("xl330").resolve(), out / "as_given.toml")
    result = gap.diagnose(given, effects=effects)
    result.save(out)
    return result


if __name__ == "__main__":
    print(main(argument(__doc__, "OUT", Path("xl330-diagnosis"))))
