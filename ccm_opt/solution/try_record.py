"""What came of one of several tries of a problem."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TryRecord:
    """What came of one of several tries of a problem, which differ in their seeds.

    Attributes:
        seed: of the try.
        duration: of its motion [s]; None when there is none.
        gap: least gap beyond the clearance that the motion keeps [m]; None when there is none.
        reason: why there is no motion, or empty.
        taken: whether it is the plan.
    """

    seed: int
    duration: float | None
    gap: float | None
    reason: str = ""
    taken: bool = False
