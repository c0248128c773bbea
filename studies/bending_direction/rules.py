"""What counts as correct: the paper's rule, and three that do not flatter."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from perception.chamber import Direction


@dataclass(frozen=True)
class Tally:
    """Answers to images of one direction.

    Attributes:
        truth: the direction.
        answers: what was answered, as often.
    """

    truth: Direction
    answers: tuple[Direction, ...]

    @classmethod
    def of_counts(cls, truth: Direction, counts: Iterable[tuple[Direction, int]]) -> Tally:
        """From numbers of answers."""
        return cls(truth, tuple(answer for answer, count in counts for _ in range(count)))

    def count(self, answer: Direction) -> int:
        """How often this was answered."""
        return self.answers.count(answer)

    @property
    def undecided(self) -> int:
        """Answers that name no direction: not bent, or no chamber in view."""
        return self.count(Direction.INITIAL) + self.count(Direction.UNDEFINED)

    @property
    def paper(self) -> float:
        """The paper's accuracy: "initial" counts as correct."""
        right = self.count(self.truth) + self.count(Direction.INITIAL)
        return right / len(self.answers)

    @property
    def strict(self) -> float:
        """Only the true direction is correct."""
        return self.count(self.truth) / len(self.answers)

    @property
    def decided(self) -> float:
        """Of the answers that name a direction, those that name the true one; NaN of none."""
        named = len(self.answers) - self.undecided
        return self.count(self.truth) / named if named else float("nan")

    @property
    def abstained(self) -> float:
        """Part that names no direction."""
        return self.undecided / len(self.answers)
