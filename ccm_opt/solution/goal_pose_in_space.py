"""What the goal-pose NLP in space said about where the arm ends, kept with the motion that ends there or elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class SpaceGoalPoseRecord:
    """The answer of the program to a motion that was found; for an arm of many links, of the few that it is planned by.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: why it does not, in words; empty when it does.
        configuration: both bends of every joint, and the feed where there is one, shape (c,) [rad, m].
        gap: least room of any link beyond radius and clearance, at most the wanted gap [m].
        wanted_gap: room beyond radius and clearance above which more was worth nothing [m].
        costs: weighted parts of the objective by name; they sum to it.
        multipliers: of the rows that shape the pose, by name, the largest first, as in the plane.
        iterations: of the solver.
        size: numbers of variables and rows.
        status: the solver's own word for how it stopped.
        tried: how many poses were asked for, this one among them.
    """

    reached: bool
    reason: str
    configuration: FloatArray
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
