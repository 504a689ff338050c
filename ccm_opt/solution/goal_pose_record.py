"""What the goal-pose NLP said about where the arm ends, kept with the motion that ends there or elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class EndRecord:
    """What is kept of the program's answer, in the plane and in space alike.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: why it does not, in words; empty when it does.
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


@dataclass(frozen=True, eq=False, kw_only=True)
class GoalPoseRecord(EndRecord):
    """Where an arm of the plane ends; one of many links may have been asked for with fewer.

    Attributes:
        headings: of the links, shape (links,) [rad].
        curve: the curve whose mean headings they are.
    """

    headings: FloatArray
    curve: Configuration


@dataclass(frozen=True, eq=False, kw_only=True)
class SpaceGoalPoseRecord(EndRecord):
    """Where an arm in space ends; of one of many links, what the few that it is planned by say.

    Attributes:
        configuration: both bends of every joint, and the feed where there is one, shape (c,) [rad, m].
    """

    configuration: FloatArray
