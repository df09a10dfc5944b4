"""Formulas for forces that are in no catalogue, and none where there is nothing to find."""

import re

import numpy as np
import pytest

from walkerkit.gap.search.residual_effort import ResidualEffort
from walkerkit.gap.stopgap.sparse import formula

NOISE = 0.02  # N·m
STEP = 0.05  # s between windows


def motion(seed, windows=400, recordings=3):
    """Swings of a joint, in recordings of which the last one is held out."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(recordings):
        time = STEP * np.arange(windows)
        pace, phase = rng.uniform(0.7, 4.0, 4), rng.uniform(0, 6, 4)
        size = rng.uniform(0.1, 0.35, 4)
        angle = pace * time[:, None] + phase
        q = (size * np.sin(angle)).sum(axis=1)
        qd = (size * pace * np.cos(angle)).sum(axis=1)
        qdd = (-size * pace**2 * np.sin(angle)).sum(axis=1)
        effort = 0.8 * np.sin(q) + 0.05 * qdd
        block = 1000 * number + (time // 0.5).astype(int)
        parts.append((time, q, qd, qdd, effort, block, np.full(windows, number + 1 == recordings)))
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


def windows_with(force, seed=0, noise=NOISE):
    time, q, qd, qdd, effort, block, held = motion(seed)
    rng = np.random.default_rng(100 + seed)
    missing = force(q, qd, effort) + noise * rng.standard_normal(len(q))
    return ResidualEffort(
        joints=("knee",),
        time=time,
        q=q[:, None],
        qd=qd[:, None],
        qdd=qdd[:, None],
        effort=effort[:, None],
        residual=missing[:, None],
        block=block,
        held_out=held,
    )


@pytest.mark.parametrize(
    ("force", "text"),
    [
        (lambda q, qd, tau: -1.2 * q**2 * np.sign(qd), r"−1\.2 q² sgn\(q̇\)"),
        (lambda q, qd, tau: -0.2 * np.sign(qd), r"−0\.2\d? sgn\(q̇\)"),
        (lambda q, qd, tau: -0.3 * np.abs(tau) * np.sign(qd), r"−0\.3\d? \|τ\| sgn\(q̇\)"),
        (
            lambda q, qd, tau: 0.15 * np.sin(14 * q + 0.7),
            r"0\.1[3-6] sin\((13|14)[.\d]* q \+ 0\.[67]",
        ),
        (lambda q, qd, tau: 0.2 + 0.4 * q, r"0\.4 q \+ 0\.2|0\.2 \+ 0\.4 q"),
    ],
    ids=["pose and direction", "dry", "load", "wave", "two terms"],
)
def test_finds_the_force_that_was_planted(force, text):
    missing = windows_with(force)
    found = formula(missing, 0)
    assert found is not None
    assert re.match(text, found.text), found.text
    size = np.sqrt(np.mean(force(missing.q, missing.qd, missing.effort)[missing.held_out] ** 2))
    assert found.before == pytest.approx(np.hypot(size, NOISE), rel=0.05)
    assert found.after < 2.0 * NOISE


def test_a_bump_is_found_where_it_is():
    missing = windows_with(lambda q, qd, tau: 0.4 * np.exp(-(((q - 0.25) / 0.08) ** 2)))
    found = formula(missing, 0)
    assert found is not None
    place = re.search(r"exp\(−\(\(q − ([\d.]+)\)", found.text)
    assert place is not None, found.text
    assert float(place[1]) == pytest.approx(0.25, abs=0.05)
    assert found.after < 0.5 * found.before


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_makes_no_formula(seed):
    assert formula(windows_with(lambda q, qd, tau: 0 * q, seed), 0) is None


@pytest.mark.parametrize("seed", range(4))
def test_pushes_at_random_make_no_formula(seed):
    rng = np.random.default_rng(seed)
    count = 1200
    pushed = np.repeat(rng.uniform(-0.8, 0.8, count // 8) * (rng.random(count // 8) < 0.2), 8)
    assert formula(windows_with(lambda q, qd, tau: pushed, seed), 0) is None


def test_a_law_that_held_out_recordings_do_not_keep_is_none():
    missing = windows_with(lambda q, qd, tau: -0.3 * np.sign(qd))
    broken = missing.residual * np.where(missing.held_out, -1.0, 1.0)[:, None]
    assert formula(missing.at(missing.time >= 0), 0) is not None
    other = ResidualEffort(**{**vars(missing), "residual": broken})
    assert formula(other, 0) is None


def test_windows_that_say_nothing_are_left_out():
    missing = windows_with(lambda q, qd, tau: -0.2 * np.sign(qd))
    residual = np.where(np.arange(len(missing.time))[:, None] % 3 == 0, np.nan, missing.residual)
    found = formula(ResidualEffort(**{**vars(missing), "residual": residual}), 0)
    assert found is not None
    assert "sgn(q̇)" in found.text
    nothing = ResidualEffort(**{**vars(missing), "residual": np.full_like(residual, np.nan)})
    assert formula(nothing, 0) is None


def test_is_the_same_each_time():
    missing = windows_with(lambda q, qd, tau: 0.15 * np.sin(14 * q))
    assert formula(missing, 0) == formula(missing, 0)
