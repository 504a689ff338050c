"""What the optimisation of a motion in the plane has to keep."""

from dataclasses import dataclass, field

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.limit import KeyframeRows, Limit, MotionCost, restored_keyframes
from ccm_opt.planning.limits.motion_certificate import failed_intervals
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, joined_rows
from ccm_opt.planning.optimisation.objective import JointSlowness, Objective
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.settings import ConvexSettings, MotionSettings
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.robot.arm import Arm

_ACTIVE_AT_MANY = 0.5
"""Share of how near rows enter the QP at many keyframes. Measured: among 300 and 1000 polygons the same motions in
three quarters of the time."""
_GROUPS = 36
"""Arms with more links than this have rows for groups of neighbouring joints. Taste."""
MANY = 1.5
"""Keyframes that are many, as a multiple of the intervals wanted. Taste."""


@dataclass(frozen=True, eq=False)
class PlanarProgram(MotionProgram[PlanarSweep]):
    """A motion in the plane: it stacks what the limits contribute, and knows none of them.

    Attributes:
        space: the link space.
        goal: where the tip has to stay.
        limits: all that the motion has to keep.
        u: path parameter of the keyframes, shape (K + 1,).
        active: rows nearer to their bound than this enter the QP [m].
        slowness: of the joints.
        in_gates: whether the motion leads through gates with hardly any play.
        settings: of the search for a motion.
    """

    space: LinkSpace
    goal: GoalPose
    limits: tuple[Limit, ...]
    u: FloatArray
    active: float
    slowness: JointSlowness | None = None
    in_gates: bool = False
    settings: MotionSettings = field(default_factory=MotionSettings)

    @property
    def steps(self) -> ConvexSettings:
        """Numbers of the steps."""
        return self.settings.optimisation.steps

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.space.arm

    @property
    def groups(self) -> int:
        """Arms with more links than this have rows for groups of neighbouring joints."""
        return _GROUPS

    @property
    def yielding(self) -> bool:
        """Whether keyframes may take less of a step where the motion would not be certified, the others all."""
        return self.in_gates

    def sweep(self, unknowns: FloatArray) -> PlanarSweep:
        """The motion through keyframes, coordinates of shape (K + 1, p)."""
        return PlanarSweep(self.space, unknowns)

    def objective(self, intervals: int) -> Objective:
        """The quadratic part of the objective."""
        return Objective(self.space, intervals, self.weights, self.slowness)

    def rows(self, sweep: PlanarSweep) -> IntervalRows:
        """All rows over intervals about a motion."""
        return joined_rows([rows for limit in self.limits for rows in limit.interval_rows(sweep)])

    def seen_by_steps(self, sweep: PlanarSweep) -> float:
        """How near to their bound rows enter the QP [m]; many keyframes are steps as short as the rows are many."""
        settings = self.settings.optimisation
        many = sweep.intervals > MANY * settings.intervals
        return self.active * (_ACTIVE_AT_MANY if many else 1.0)

    def keyframe_rows(self, sweep: PlanarSweep) -> tuple[KeyframeRows, ...]:
        """Rows on single keyframes that have to hold."""
        return tuple(each for limit in self.limits for each in limit.keyframe_rows(sweep, self.u))

    def equations(self, sweep: PlanarSweep) -> tuple[KeyframeRows, ...]:
        """Equations on single keyframes."""
        return tuple(each for limit in self.limits for each in limit.keyframe_equations(sweep, self.u))

    def tip_rows(self, sweep: PlanarSweep) -> FloatArray:
        """Rows that hold the tip in its goal, and its heading where one is asked, shape (2 or 3, p)."""
        return self.goal.rows(self.space.pose(sweep.unknowns[-1]), self.unit)

    def further_costs(self, sweep: PlanarSweep) -> tuple[MotionCost, ...]:
        """The costs of the limits."""
        del sweep
        return tuple(cost for limit in self.limits for cost in limit.costs(self.space, self.u))

    def restored(self, coordinates: FloatArray) -> FloatArray:
        """The keyframes brought back onto the limits, shape (K + 1, p); the same array where no limit moves them."""
        return restored_keyframes(self.limits, self.space, coordinates, self.u)

    def ended(self, unknowns: FloatArray) -> FloatArray:
        """The coordinates with the keyframes on the limits and the last one polished onto the goal."""
        coordinates = self.restored(unknowns)
        if not self.end_fixed:
            coordinates[-1] = moved_onto(self.space, self.goal, self.space.pose(coordinates[-1])).v
        return coordinates

    def holds(self, sweep: PlanarSweep, before: PlanarSweep) -> bool:
        """Whether a motion's keyframes keep every limit as well as those of another motion did, or better."""
        return all(limit.holds(sweep, before, self.u) for limit in self.limits)

    def feasible(self, sweep: PlanarSweep, before: PlanarSweep) -> bool:
        """Whether a motion keeps the limits and ends on the goal."""
        if not self.holds(sweep, before):
            return False
        return self.end_fixed or self.goal.on_goal(self.space.pose(sweep.unknowns[-1]))

    def failures(self, sweep: PlanarSweep) -> IntArray:
        """Intervals of a motion that are not certified."""
        return failed_intervals(self.limits, sweep.headings)
