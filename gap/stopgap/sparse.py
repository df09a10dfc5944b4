"""A sparse formula for the effort that a simulation lacks: a hint at what might be missing.

    found = formula(missing, joint=0)
    found.text                            # "−1.2 q² sgn(q̇)"
    found.before, found.after             # effort that is missing on held-out recordings [N·m]

Terms of the library are chosen one by one, as long as stretches of the fitted recordings that took
no part in the choice are explained better; what is then left on the held-out recordings, which took
part in nothing, says what the formula is worth. It is no diagnosis: a formula fits what it sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.residual_effort import ResidualEffort
from walkerkit.gap.stopgap.library import Term, library

FloatArray = NDArray[np.float64]

_MOST_TERMS = 3
_FOLDS = 5
_WORTH = 0.05  # of the squared effort in other stretches that another term has to explain
_AS_GOOD = 0.03  # of the squared effort: terms that explain so much less are as good
_SHRINKS = 0.15  # of the missing effort on held-out recordings that a formula has to explain
_SURE, _RESAMPLES, _SEED = 0.99, 1000, 20260101
_SAME = 1e-3  # of a term that the known ones do not have
_FEWEST = 40  # windows of either kind
_OUTLIER = 6.0  # times the usual effort; impacts leave what no formula explains


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A formula for the effort that is missing at a joint.

    Attributes:
        text: how it reads; SI units.
        before: root-mean-square effort that is missing on held-out recordings [N·m; N].
        after: what is left of it once the formula is added.
    """

    text: str
    before: float
    after: float


def formula(missing: ResidualEffort, joint: int) -> Formula | None:
    """The sparse formula of one joint, or None where none is worth it.

    Args:
        missing: the windows.
        joint: which of its joints.
    """
    missing = missing.at(np.isfinite(missing.residual[:, joint]))
    held = missing.held_out
    if min(held.sum(), (~held).sum()) < _FEWEST:
        return None
    target = missing.residual[:, joint]
    usual = float(np.sqrt(np.mean(target**2)))
    target = np.clip(target, -_OUTLIER * usual, _OUTLIER * usual)
    terms = list(library(missing, joint))
    chosen = _chosen(terms, target, missing, ~held)
    if not chosen:
        return None
    design = np.concatenate([term.columns for term in chosen], axis=1)
    factors = _solved(design[~held], target[~held])
    left = target - design @ factors
    before, after = (float(np.sqrt(np.mean(one[held] ** 2))) for one in (target, left))
    squares = [_by_block(one**2, missing.block, held) for one in (target, left)]
    if after > (1 - _SHRINKS) * before or not _surely_less(*squares):
        return None
    return Formula(text=_text(chosen, factors), before=before, after=after)


def _chosen(
    terms: Sequence[Term], target: FloatArray, missing: ResidualEffort, fitted: NDArray[np.bool_]
) -> list[Term]:
    """The terms that explain stretches of the fitted recordings from the others."""
    fold = np.where(fitted, missing.block % _FOLDS, -1)
    total = float(np.sum(target[fitted] ** 2))
    chosen: list[Term] = []
    unexplained = total
    while len(chosen) < _MOST_TERMS:
        left = _left(chosen, terms, target, fitted)
        best = left.min()
        near = [k for k, size in enumerate(left) if size <= best + _AS_GOOD * total]
        # Of terms that are as good the plainest; of those, the one that explains most.
        k = min(near, key=lambda one: (terms[one].rank, left[one]))
        columns = np.concatenate([term.columns for term in (*chosen, terms[k])], axis=1)
        across = _across(columns, target, fold)
        if across > unexplained - _WORTH * total:
            break
        chosen.append(terms[k])
        unexplained = across
    return chosen


def _left(
    known: Sequence[Term], terms: Sequence[Term], target: FloatArray, rows: NDArray[np.bool_]
) -> FloatArray:
    """(n_terms,) squares that are left in some rows when a term joins those that are known."""
    target = target[rows]
    basis = np.zeros((len(target), 0))
    if known:
        basis, _ = np.linalg.qr(np.concatenate([term.columns[rows] for term in known], axis=1))
    free = target - basis @ (basis.T @ target)
    total = float(free @ free)
    left = np.empty(len(terms))
    for k, term in enumerate(terms):
        columns = term.columns[rows] - basis @ (basis.T @ term.columns[rows])
        # What is all but a combination of the known ones adds nothing.
        size = np.linalg.norm(columns, axis=0)
        keep = size > _SAME * np.maximum(np.linalg.norm(term.columns[rows], axis=0), 1e-12)
        gained = 0.0
        if keep.any():
            directions, _ = np.linalg.qr(columns[:, keep] / size[keep])
            gained = float(np.sum((directions.T @ free) ** 2))
        left[k] = total - gained
    return left


def _across(columns: FloatArray, target: FloatArray, fold: NDArray[np.int64]) -> float:
    """Squares that are left in each fold by what the others say."""
    left = 0.0
    for one in range(_FOLDS):
        mine, others = fold == one, (fold >= 0) & (fold != one)
        if mine.any() and others.any():
            factors = _solved(columns[others], target[others])
            left += float(np.sum((target[mine] - columns[mine] @ factors) ** 2))
    return left


def _solved(columns: FloatArray, target: FloatArray) -> FloatArray:
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    factors: FloatArray = np.linalg.lstsq(columns / scale, target, rcond=1e-8)[0] / scale
    return factors


def _by_block(values: FloatArray, block: NDArray[np.int64], rows: NDArray[np.bool_]) -> FloatArray:
    """Sums over the stretches of some rows."""
    _, label = np.unique(block[rows], return_inverse=True)
    sums: FloatArray = np.bincount(label, weights=values[rows]).astype(np.float64)
    return sums


def _surely_less(before: FloatArray, after: FloatArray) -> bool:
    """Whether the squares of resampled stretches almost always fall by what is worth it."""
    rng = np.random.default_rng(_SEED)
    count = len(before)
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=_RESAMPLES)
    falls = drawn @ after < (1 - _SHRINKS) * (drawn @ before)
    return bool(np.mean(falls) > _SURE)


def _text(terms: Sequence[Term], factors: FloatArray) -> str:
    parts: list[str] = []
    at = 0
    for term in terms:
        width = term.columns.shape[1]
        mine = factors[at : at + width]
        at += width
        size, text = float(mine[0]), term.text
        if width > 1:
            size = float(np.hypot(*mine))
            phase = float(np.arctan2(mine[1], mine[0]))
            sign = "+" if phase >= 0 else "−"
            text = text.replace(" q)", f" q {sign} {abs(phase):.2g})")
        sign = "−" if size < 0 else "+" if parts else ""
        number = f"{abs(size):.2g}"
        joined = number if text == "1" else f"{number} {text}"
        parts.append(f"{sign} {joined}" if parts else f"{sign}{joined}")
    return " ".join(parts)
