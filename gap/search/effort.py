"""How much is tried: simulation steps, counted against those of the plain fit.

    effort = Effort("quick")
    effort.ground_is_done(on_feet=False)        # from now on so many times what has been spent
    if effort.allows("rare effects beside the ordinary ones"):
        ...

A step of a simulation costs the same wherever it is taken, so that the same command finds the same
on any machine. `stop` ends the search as soon as what is being fitted has been.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Final, Literal, get_args

from walkerkit.gap.errors import closest, refusal

Progress = Callable[[str, float], None]  # what is being done, and how far it is (0 to 1)
Level = Literal["quick", "normal", "thorough"]

_TIMES: Final = {"quick": 4.0, "normal": 60.0, "thorough": float("inf")}
"""How many times the steps of the plain fit are enough to begin nothing more."""

_TIMES_ON_FEET: Final = {"quick": 1.0, "normal": 3.0, "thorough": float("inf")}
"""The same of a floating base, whose plain fit has met the rare effects of base and ground already,
and where one look at the others takes as many steps."""

_SPENT: ContextVar[list[int] | None] = ContextVar("spent", default=None)


class EnoughError(Exception):
    """The search was asked to stop; what it has found stands."""


class Effort:
    """What a search may spend, and what it did not try.

    Args:
        level: `quick` for the plain fit and one look at what else there is, `normal`, or `thorough`
            for all that is worth a trial.

    Attributes:
        untried: what was not begun.
        stopped: `stop` was called.

    Raises:
        InputError: there is no such level.
    """

    def __init__(self, level: Level = "normal"):
        if level not in _TIMES:
            raise refusal(
                f"there is no effort {level!r}{closest(level, _TIMES)}. Choose "
                f"{', '.join(get_args(Level)[:-1])} or {get_args(Level)[-1]}."
            )
        self.level: Level = level
        self.untried: list[str] = []
        self.stopped = False
        self._plain: int | None = None
        self._times = _TIMES[level]

    def ground_is_done(self, *, on_feet: bool) -> None:
        """What has been spent until now is what others are counted against."""
        if self._plain is None:
            self._plain = spent()
            self._times = (_TIMES_ON_FEET if on_feet else _TIMES)[self.level]

    def allows(self, what: str) -> bool:
        """Whether something more may begin; what may not is remembered."""
        if self.stopped or (self._plain is not None and spent() > self._times * self._plain):
            if what not in self.untried:
                self.untried.append(what)
            return False
        return True

    def stop(self) -> None:
        """Has what is `checked` end what is being tried."""
        self.stopped = True

    def checked(self, progress: Progress | None) -> Progress:
        """To be called now and then: as `progress`; raises `EnoughError` once `stop` was called."""

        def check(stage: str, done: float) -> None:
            if self.stopped:
                raise EnoughError
            if progress is not None:
                progress(stage, done)

        return check


def counted() -> None:
    """Counts from zero from here on."""
    _SPENT.set([0])


def spend(steps: int) -> None:
    """Counts steps that were simulated, or that were in the run which this one goes on with."""
    count = _SPENT.get()
    if count is not None:
        count[0] += steps


def spent() -> int:
    """Steps since `counted`."""
    count = _SPENT.get()
    return 0 if count is None else count[0]
