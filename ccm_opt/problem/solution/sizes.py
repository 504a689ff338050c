"""Sizes of arms: what was tried, the size that is enough with its plan, and the next smaller one."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ccm_opt.core.length_words import file_length
from ccm_opt.problem.definition import Problem
from ccm_opt.problem.solution.solution import Solution

SizeName: TypeAlias = Literal["length", "links", "radius"]
"""What a size is: the least length, the fewest links of the given length, or the greatest radius."""
TrialOutcome: TypeAlias = Literal["verified", "impossible", "not found"]
"""Outcomes of a trial: a verified plan, a proof that there is none, or neither within the time."""


@dataclass(frozen=True)
class SizeTrial:
    """An arm that was tried.

    Attributes:
        length: length of the arm [m].
        links: number of its links.
        radius: radius of its links, or the greatest [m].
        base: position of its base, (x, y) or (x, y, z) [m].
        outcome: "verified", "impossible" if it is proved that there is no plan, or "not found".
        reason: why there is no plan, or why none was found; empty with a plan.
        cpu: CPU time of the trial [s].
        limit: CPU time that the search had [s]; 0 for proofs without a search.
    """

    length: float
    links: int
    radius: float
    base: tuple[float, ...]
    outcome: TrialOutcome
    reason: str = ""
    cpu: float = 0.0
    limit: float = 0.0

    @classmethod
    def of(
        cls, problem: Problem, outcome: TrialOutcome, reason: str = "", cpu: float = 0.0, limit: float = 0.0
    ) -> "SizeTrial":
        """Return the record of a trial of a problem's arm; arguments are those of the attributes."""
        arm = problem.arm
        base = tuple(float(each) for each in arm.base)
        return cls(arm.length, arm.links, arm.radius, base, outcome, reason, cpu, limit)

    def words(self, find: SizeName, figures: int = 4) -> str:
        """Return text for the size of the arm, with its unit; lengths with a number of significant digits."""
        if find == "links":
            return f"{self.links} links"
        if find == "length":
            return file_length(self.length, figures)
        return f"a radius of {file_length(self.radius, figures)}"


@dataclass(frozen=True)
class ArmSize:
    """The size of an arm that is enough for a problem.

    Attributes:
        find: what was sought: "length", "links" or "radius".
        solution: verified plan of the arm of this size; its problem has the arm.
        following: the next arm, shorter, of fewer links or thicker, for which there is no plan or none was found; None
            if nothing smaller was tried.
        bound: the nearest arm for which it is proved that there is no plan, nor for any beyond it; None if there is no
            such proof. It may be ``following`` itself.
        trials: all arms that were tried, in order.
        places: number of places of the base.
        places_proved: number of the other places that are proved not to be better.
    """

    find: SizeName
    solution: Solution
    following: SizeTrial | None
    bound: SizeTrial | None
    trials: tuple[SizeTrial, ...]
    places: int = 1
    places_proved: int = 0

    @property
    def enough(self) -> SizeTrial:
        """Record of the arm that is enough."""
        return SizeTrial.of(self.solution.problem, "verified")

    @property
    def value(self) -> float:
        """Length or radius that is enough [m], or number of links."""
        arm = self.solution.problem.arm
        return float(getattr(arm, self.find))


@dataclass(frozen=True)
class SizeFront:
    """Least lengths of arms of several radii.

    Attributes:
        problem: the problem as posed.
        radii: the radii, in ascending order [m].
        sizes: the least length for each radius; None where no plan was found.
        bounds: for each radius, the arm of the greatest length that is proved to be too short, as are all shorter and
            all thicker ones; None if none is.
        reasons: for each radius, why no plan was found; empty with a plan.
        trials: all arms that were tried.
    """

    problem: Problem
    radii: tuple[float, ...]
    sizes: tuple[ArmSize | None, ...]
    bounds: tuple[SizeTrial | None, ...]
    reasons: tuple[str, ...]
    trials: tuple[SizeTrial, ...]

    @property
    def best(self) -> int:
        """Index of the radius whose plan is shown, which is the nearest to that of the problem with a plan."""
        found = [k for k, size in enumerate(self.sizes) if size is not None]
        return min(found, key=lambda k: abs(self.radii[k] - self.problem.arm.radius))
