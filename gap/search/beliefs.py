"""What a user knows or doubts of a model before any log is seen.

    beliefs = Beliefs.of(known=["payload", "mass:calf"], doubt=["position_gain:knee"])

What is known is not changed: a mass that was weighed, a gain that was set. What is doubted costs
nothing to name, and its size is as plausible as any other. Each is an effect or one of its numbers,
at one joint or body, or wherever it can be.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from walkerkit.gap.effects import Effect
from walkerkit.gap.errors import InputError, closest
from walkerkit.gap.search.structure import Term, candidate_terms
from walkerkit.gap.simulation.robot import Robot


@dataclass(frozen=True, kw_only=True)
class _Named:
    """One of them: an effect or a number, and where; None for everywhere."""

    word: str
    place: str | None

    @classmethod
    def of(cls, text: str) -> _Named:
        word, _, place = text.partition(":")
        return cls(word=word, place=place or None)

    def names(self, words: Iterable[str], place: str) -> bool:
        return self.word in words and self.place in (None, place)

    def __str__(self) -> str:
        return self.word if self.place is None else f"{self.word}:{self.place}"


@dataclass(frozen=True, kw_only=True)
class Beliefs:
    """What is known and what is doubted.

    Attributes:
        known: effects or numbers that are right in the model.
        doubted: effects or numbers of which nobody knows the size.
    """

    known: tuple[_Named, ...] = ()
    doubted: tuple[_Named, ...] = ()

    @classmethod
    def of(cls, known: Sequence[str] = (), doubt: Sequence[str] = ()) -> Beliefs:
        """Reads them as they are written on the command line."""
        known, doubt = ([one] if isinstance(one, str) else one for one in (known, doubt))
        return cls(known=tuple(map(_Named.of, known)), doubted=tuple(map(_Named.of, doubt)))

    def __bool__(self) -> bool:
        return bool(self.known or self.doubted)

    def terms(
        self, effects: Sequence[Effect], robots: Sequence[Robot], joints: Sequence[str]
    ) -> tuple[Term, ...]:
        """As `candidate_terms`, without what is known, and with what is doubted marked so."""
        found = []
        for term in candidate_terms(effects, robots, joints):
            left = tuple(s for s in term.sites if not self._has(self.known, term, s, robots[0]))
            doubted = frozenset(s for s in left if self._has(self.doubted, term, s, robots[0]))
            if left:
                shared = term.shared and len(left) > 1
                found.append(replace(term, sites=left, shared=shared, doubted=doubted))
        return tuple(found)

    def check(
        self, effects: Sequence[Effect], robots: Sequence[Robot], joints: Sequence[str]
    ) -> None:
        """Refuses words that nothing is called by on these robots.

        Raises:
            InputError: one names no effect, no number of one, or no place of it.
        """
        places: dict[str, set[str]] = {}
        for term in candidate_terms(effects, robots, joints):
            for word in _words(term, robots[0]):
                places.setdefault(word, set()).update(term.sites)
        for flag, some in (("known", self.known), ("doubt", self.doubted)):
            for one in some:
                if one.word not in places:
                    raise InputError(
                        f"--{flag} {one}: no effect that this robot can have, and none of its "
                        f"numbers, is called {one.word!r}{closest(one.word, places)}. "
                        "`walkerkit effects` lists them."
                    )
                if one.place is not None and one.place not in places[one.word]:
                    raise InputError(
                        f"--{flag} {one}: {one.word} is not at {one.place!r}"
                        f"{closest(one.place, places[one.word])}; it can be at "
                        f"{', '.join(sorted(places[one.word]))}."
                    )

    @staticmethod
    def _has(some: Sequence[_Named], term: Term, site: str, robot: Robot) -> bool:
        return bool(some) and any(one.names(_words(term, robot), site) for one in some)


NOTHING = Beliefs()


def _words(term: Term, robot: Robot) -> tuple[str, ...]:
    """What a term is called by: its effect, and the numbers of that."""
    numbers = term.effect.parameters(robot, term.sites[0])
    return (term.effect.name, *(number.name for number in numbers))
