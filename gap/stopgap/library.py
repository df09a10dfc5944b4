"""Terms that a formula for an effort is made of.

They are position, velocity and effort, with their signs, powers, products and harmonics, and bumps
of the position:

    for term in library(missing, joint):
        term.text, term.columns            # "q² sgn(q̇)", (n, 1)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.residual_effort import ResidualEffort

FloatArray = NDArray[np.float64]

_PER_PERIOD = 12  # windows that a wave needs in each of its periods
_MOST_WAVES = 60
_BUMPS = 25  # places in the range
_WIDTHS = (0.03, 0.06, 0.12)  # of the range


@dataclass(frozen=True, kw_only=True)
class Term:
    """One building block, linear in its coefficients.

    Attributes:
        text: how it reads, with `{}` for the coefficients; empty places where it has two.
        columns: (n, 1) values, or (n, 2) for a sine and a cosine.
        wave: periods per 2π rad of a harmonic, 0 for everything else.
        rank: how elaborate it is; of terms that explain the same the lowest is taken.
    """

    text: str
    columns: FloatArray
    wave: float = 0.0
    rank: int


def library(missing: ResidualEffort, joint: int) -> Iterator[Term]:
    """Every term, the plainest first.

    Args:
        missing: the windows.
        joint: which of its joints.
    """
    q, qd, qdd = missing.q[:, joint], missing.qd[:, joint], missing.qdd[:, joint]
    effort, time = missing.effort[:, joint], missing.time - missing.time.min()
    sign, one = np.sign(qd), np.ones(len(q))
    poses = {"": one, "q": q, "q²": q**2, "q³": q**3, "|q|": np.abs(q)}
    paces = {
        "": one,
        "sgn(q̇)": sign,
        "q̇": qd,
        "|q̇|": np.abs(qd),
        "√|q̇| sgn(q̇)": np.sqrt(np.abs(qd)) * sign,
        "q̇|q̇|": qd * np.abs(qd),
        "q̇³": qd**3,
    }
    loads = {
        "": one,
        "τ": effort,
        "|τ|": np.abs(effort),
        "τ|τ|": effort * np.abs(effort),
        "τ²": effort**2,
    }
    for i, (pose, of_pose) in enumerate(poses.items()):
        for k, (pace, of_pace) in enumerate(paces.items()):
            for m, (load, of_load) in enumerate(loads.items()):
                if (i > 0) + (k > 0) + (m > 0) <= 2:
                    text = " ".join(part for part in (load, pose, pace) if part) or "1"
                    values = of_pose * of_pace * of_load
                    yield Term(text=text, columns=values[:, None], rank=i + k + m)
    for text, values in (("q̈", qdd), ("t", time), ("t τ", time * effort)):
        yield Term(text=text, columns=values[:, None], rank=4)
    yield from _local(q, paces)
    yield from _waves(q, {name: paces[name] for name in ("", "sgn(q̇)")} | {"τ": effort})


def _local(q: FloatArray, paces: dict[str, FloatArray]) -> Iterator[Term]:
    low, high = np.percentile(q, [1, 99])
    for width in (part * (high - low) for part in _WIDTHS):
        for centre in np.linspace(low, high, _BUMPS):
            bump = np.exp(-(((q - centre) / width) ** 2)) if width > 0 else np.zeros(len(q))
            for pace in ("", "sgn(q̇)"):
                text = f"exp(−((q − {centre:.3g})/{width:.2g})²) {pace}".strip()
                yield Term(text=text, columns=(bump * paces[pace])[:, None], rank=8)


def _waves(q: FloatArray, factors: dict[str, FloatArray]) -> Iterator[Term]:
    spread = float(np.ptp(np.percentile(q, [1, 99])))
    if not spread:
        return
    lowest = 2 * np.pi / spread
    count = min(_MOST_WAVES, 4 * len(q) // (2 * _PER_PERIOD))
    for wave in lowest * (1 + 0.25 * np.arange(count)):
        both = np.stack([np.sin(wave * q), np.cos(wave * q)], axis=1)
        for name, factor in factors.items():
            text = f"{name} sin({wave:.3g} q)".strip()
            yield Term(text=text, columns=both * factor[:, None], wave=float(wave), rank=9)
