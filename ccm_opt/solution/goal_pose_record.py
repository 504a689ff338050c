"""What the goal-pose NLP said about where the arm ends."""

from collections.abc import Mapping
from dataclasses import dataclass

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class GoalPoseRecord:
    """What the goal-pose NLP said about where the arm ends, and whether the motion ends there.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: why it does not, in words; empty when it does.
        headings: of the links, shape (links,) [rad]. An arm of many links may have been asked for with fewer.
        curve: the curve whose mean headings they are.
        gap: least room of any link beyond radius and clearance, at most the wanted gap [m].
        wanted_gap: room beyond radius and clearance above which more was worth nothing [m].
        costs: weighted parts of the objective by name; they sum to it.
        multipliers: of the rows that shape the pose, by name: how much the objective would fall for one unit of the
            row (one arm's length, one radian, one unit of the user's); the largest first.
        iterations: of the solver.
        size: numbers of variables and rows.
        status: the solver's own word for how it stopped.
        tried: how many poses were asked for, this one among them.
    """

    reached: bool
    reason: str
    headings: FloatArray
    curve: Configuration
    gap: float
    wanted_gap: float
    costs: Mapping[str, float]
    multipliers: Mapping[str, float]
    iterations: int
    size: tuple[int, int]
    status: str
    tried: int = 1

    @property
    def cost(self) -> float:
        """The objective."""
        return float(sum(self.costs.values()))
