"""Settings of the planning stages: step, guides, search, samplers, optimisation and planners.

Lengths are in nominal links (1/24 of the arm), which do not depend on the number of links of the real arm: weights and
advances tuned on one arm then suit another arm of the same shape. A weight "per nominal link" is divided among the
links in one nominal link.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.scene.contact_finder import CertificateSettings


@dataclass(frozen=True)
class ConvexSettings:
    """Settings of the sequential convex programming.

    Attributes:
        price: initial penalty on one nominal link of slack. Heuristic.
        highest_price: largest value to which the price rises where an interval lacks clearance. Heuristic.
        worth: fraction by which a round has to improve the merit, or count as without gain. Heuristic.
        patience: maximum number of successive rounds without gain. Heuristic.
        patience_in_want: value of ``patience`` for a motion that lacks clearance. Heuristic.
        counts_room: whether missing clearance counts in a motion's merit, and only iterates with a better merit are
            kept; otherwise only violated constraints count, at their prices, and every step is kept.
    """

    price: float = 30.0
    highest_price: float = 500.0
    worth: float = 3e-3
    patience: int = 2
    patience_in_want: int = 2
    counts_room: bool = False


@dataclass(frozen=True)
class OptimisationSettings:
    """Settings of the optimisation of a motion.

    Attributes:
        intervals: minimum number of intervals; a motion that needs more to be certified keeps more. Measured: twice as
            many shortened motions by 5 % at most.
        moved_intervals: numbers of intervals tried if keyframes have to be moved onto limits, until the motion through
            them is certified. Heuristic.
        finer_intervals: minimum number of intervals if a motion lacks clearance. Measured: of 18 motions among clutter
            that lacked clearance, few gained much with as many as before, most with about twice as many.
        leg_depth: maximum number of bisections in the certificate of an interval when keyframes are removed. Heuristic.
        first_stride: number of keyframes that are skipped at first when keyframes are removed. Heuristic.
        first_rounds: number of steps with many keyframes before keyframes are removed again. Heuristic.
        rounds: maximum number of steps. Heuristic.
        free_rounds: maximum number of steps before the end pose of the motion is chosen. Heuristic.
        end_rounds: maximum number of steps after the end pose is chosen. Heuristic.
        steps: settings of the sequential convex programming.
    """

    intervals: int = 20
    moved_intervals: tuple[int, ...] = (24, 48, 96)
    finer_intervals: int = 44
    leg_depth: int = 2
    first_stride: int = 16
    first_rounds: int = 5
    rounds: int = 14
    free_rounds: int = 9
    end_rounds: int = 5
    steps: ConvexSettings = ConvexSettings()


@dataclass(frozen=True)
class AnyStepSettings:
    """Settings of a single QP step, in the plane or in space.

    Attributes:
        largest_turn: largest turn of a link in one step [rad], so that the linearised constraints are valid. Heuristic.
        limit_share: fraction of a joint limit that planning uses, since linearised constraints ignore that the shape
            of a fed arm changes with its feed. Heuristic.
        firm_share: fraction of a gap's shortfall from the margin that constraints enforce, if such a step exists; 0
            by default. Heuristic.
        restoration_share: fraction of a gap's shortfall from the margin that the step aims to restore. Heuristic.
        push_weight: weight on restoring such a shortfall, relative to the distance of a nominal link. Heuristic.
        keep_share: fraction of the planning margin that every accepted pose keeps if steps are not certified.
            Heuristic.
        travel: largest travel of a joint in a step, in general and where walls or links are within reach, in nominal
            links.
        still: whether turns and displacements of links have a cost, so that the arm moves only if another term requires
            it.
        proof_depth: number of bisections of the certificate of every step; None if only whole motions are certified.
        ridge: value on the diagonal of the step's Hessian that makes it positive definite. Heuristic.
        blend_ridge: ridge on unknowns that blend into a goal of the whole arm, if larger.
    """

    largest_turn: float = 0.15
    ridge: float = 1e-8
    blend_ridge: float = 1e-8
    limit_share: float = 0.995
    firm_share: float = 0.0
    restoration_share: float = 1.0
    push_weight: float = 30.0
    keep_share: float = 0.0
    travel: tuple[float, float] = (1.5, 0.8)
    still: bool = True
    proof_depth: int | None = 5

    @property
    def accepted_share(self) -> float:
        """Fraction of a joint limit that an accepted step may reach, which allows for the inaccuracy of the QP."""
        return 1.0 - 1e-5


@dataclass(frozen=True)
class StepSettings(AnyStepSettings):
    """Settings of a single QP step in the plane.

    Attributes:
        limit_share: fraction of a joint limit that planning uses; the overshoot of accepted poses and splines stays
            below the limit. Heuristic.
        full_limit_share: fraction of a joint limit used if the ends need more, or if joint limits stop the arm short of
            its goal. Derived: linearised constraints and Newton corrections err by a hundredth of a degree at most.
        narrow_firm_share: ``firm_share`` for narrow margins. Heuristic.
        ridge: as in ``AnyStepSettings``.
        narrow_ridge: ridge for narrow margins. Measured: with the large weights for narrow margins, the solver does not
            recognise a Hessian with the usual ridge as definite, and takes 600 iterations instead of 10.
        blend_ridge: ridge on coordinates that blend into a goal of the whole arm. Measured on a chain in a horn, 12 to
            96 links: with the usual ridge a step along a guide's path took 36 to 280 iterations of its QP or never
            ended, with this one 3 to 7.
        narrow_margin: planning margin below which steps are smaller, in nominal links. Heuristic: the usual narrow one.
    """

    limit_share: float = 0.98
    still: bool = False
    proof_depth: int | None = None
    full_limit_share: float = 0.9995
    keep_share: float = 0.4
    restoration_share: float = 0.5
    travel: tuple[float, float] = (np.inf, np.inf)
    narrow_firm_share: float = 0.5
    ridge: float = 1e-9
    narrow_ridge: float = 1e-6
    blend_ridge: float = 1e-6
    narrow_margin: float = 0.024

    @property
    def accepted_share(self) -> float:
        """Fraction of a joint limit that an accepted step may reach, half-way between ``limit_share`` and 1."""
        return 0.5 * (1.0 + self.limit_share)

    def narrowed(self, margin: float) -> "StepSettings":
        """Return step settings for a planning margin, in nominal links: the narrower the margin, the smaller the steps.

        The error of linearised constraints grows with the square of the turn. The weight that pushes links out of the
        margin grows as the margin shrinks, or the guide would hold the arm at the edge of the margin, where no step is
        possible.
        """
        share = margin / self.narrow_margin
        if share >= 1.0:
            return self
        turn = self.largest_turn * float(np.sqrt(share))
        return replace(
            self,
            largest_turn=turn,
            push_weight=self.push_weight / share,
            firm_share=self.narrow_firm_share,
            ridge=self.narrow_ridge,
        )


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the stages in which QP steps lead the arm along a guide and finally settle the tip on the goal.

    Attributes:
        settle_steps: maximum number of steps of settling on the goal. Heuristic.
        settle_least: number of settling steps that are taken even if the arm hardly moves. Heuristic.
        settle_growth: growth of the goal's weight from step to step. Heuristic.
        still_weight: weight of the turns of all links together while settling. Heuristic.
        polish_distance: tip distance from the goal below which Newton's method is tried, in nominal links. Heuristic.
        polish_turn: angle between the directions of tip and goal below which Newton's method is tried [rad]. Heuristic.
    """

    settle_steps: int = 150
    settle_least: int = 20
    settle_growth: float = 0.2
    still_weight: float = 0.5
    polish_distance: float = 0.1
    polish_turn: float = 0.1


@dataclass(frozen=True)
class GoalSettings:
    """Settings of the cost terms that pull the tip to the goal, and of Newton's method that places it exactly there.

    Attributes:
        polish_tolerance: tip error [arm lengths] and heading error [rad] at which Newton's method stops. Derived: three
            orders of magnitude below what the verifier allows.
        reached: multiple of ``polish_tolerance`` up to which a tip counts as on the goal. Heuristic.
        heading_weight: weight of the tip's heading, and of limit violations at the goal, relative to its position.
            Heuristic.
        distance_step: largest advance onto the goal at which a step aims, in nominal links. Heuristic.
        turn_step: largest turn onto the goal's direction at which a step aims [rad]. Heuristic.
    """

    polish_tolerance: float = 1e-9
    reached: float = 10.0
    heading_weight: float = 0.3
    distance_step: float = 1.5
    turn_step: float = 0.3

    @property
    def on_goal(self) -> float:
        """Errors of the tip position [arm lengths] and heading [rad] up to which the tip counts as on the goal."""
        return self.reached * self.polish_tolerance


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of the stage that tracks a reference motion under constraints that depend on the path parameter u.

    Attributes:
        first_advance: first increment of u, which runs from 0 to 1. Heuristic.
        largest_advance: largest increment of u. Heuristic.
    """

    first_advance: float = 1.0 / 80.0
    largest_advance: float = 1.0 / 40.0


@dataclass(frozen=True)
class TipWalkSettings:
    """Settings of random walks of the tip, which lead the tip along random paths among many walls.

    Measured values were chosen on nine fields of 1000 and 3000 polygons in which no direct attempt reaches the goal,
    seeds 100 to 107 of ``tests/benchmarks/bench_growth.py``.

    Attributes:
        margins: planning margins of direct attempts and walks, in nominal links. Measured: of fourteen fields of 1000
            and 3000 polygons the first alone solves seven, the others two more.
        longest_way: length of the tip path above which there are no early walks, as a fraction of the arm's length.
            Measured: in fields of 1000 polygons with sampled goals, walks along 0.2 to 0.6 of the arm's length mostly
            arrive, and along 1.2 to 2.0, where the whole arm has to take another route, never.
        early_walks: number of walks before poses at the goal are sought. Heuristic: at most half the time of a failed
            search for such poses.
        late_walks: number of walks after all candidates. Heuristic.
    """

    margins: tuple[float, ...] = (0.012, 0.06, 0.024, 0.008)
    longest_way: float = 0.8
    early_walks: int = 150
    late_walks: int = 120


@dataclass(frozen=True)
class EngineSettings:
    """Settings of QP steps, following of guides, tracking and optimisation, in the plane or in space.

    Attributes:
        step: settings of a single step.
        continuation: settings of following a guide and settling on the goal.
        goal: settings of placing the tip on the goal.
        tracking: settings of tracking a reference motion.
        optimisation: settings of the optimisation of a motion.
    """

    step: AnyStepSettings = field(default_factory=AnyStepSettings)
    continuation: ContinuationSettings = field(default_factory=ContinuationSettings)
    goal: GoalSettings = field(default_factory=GoalSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    optimisation: OptimisationSettings = field(default_factory=OptimisationSettings)


@dataclass(frozen=True)
class MotionSettings(EngineSettings):
    """Settings of the search for a motion in the plane, in addition to the general ones.

    Attributes:
        certificate: settings of the certificate of contact.
        step: settings of a single step.
        many_walls: number of walls in the neighbourhood above which the tip is led along every path before poses at the
            goal are sought. Heuristic: among a thousand walls, such poses take seconds.
        tip_walks: settings of leading the tip among many walls.
    """

    certificate: CertificateSettings = field(default_factory=CertificateSettings)
    step: StepSettings = field(default_factory=StepSettings)
    many_walls: int = 150
    tip_walks: TipWalkSettings = field(default_factory=TipWalkSettings)


# ------------------------------------------------------------ in space
_STEPS = ConvexSettings(
    price=100.0,
    worth=0.02,
    patience=1,
    patience_in_want=3,
    counts_room=True,
)
"""Settings of the optimisation in space: iterates are also judged by missing clearance, not by constraints alone."""


@dataclass(frozen=True)
class SpaceCertificateSettings:
    """Settings of the certificate that a motion in space is collision-free.

    Attributes:
        depth: number of times that an interval may be halved. Heuristic: twelve halvings cut a step into four thousand
            parts.
        spare: certified gap beyond contact, as a reserve for the path between samples, in nominal links.
        slack: fraction of a link's motion by which distances may at first be underestimated; this shortens the
            computation along finely meshed walls; without a proof, it is repeated with exact distances.
    """

    depth: int = 12
    spare: float = 0.002
    slack: float = 0.3


@dataclass(frozen=True)
class SpaceMotionSettings(EngineSettings):
    """Settings of the search in space, in addition to the general ones.

    Attributes:
        certificate: settings of the certificate of contact.
        continuation: settings of following a guide and settling on the goal.
        goal: settings of placing the tip on the goal.
        optimisation: settings of the optimisation of a motion found.
    """

    certificate: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    continuation: ContinuationSettings = ContinuationSettings(60, 10, 0.5, 0.0, 0.5, 0.2)
    goal: GoalSettings = GoalSettings(heading_weight=1.0, distance_step=1.0, turn_step=0.5)
    optimisation: OptimisationSettings = OptimisationSettings(
        intervals=24, finer_intervals=32, leg_depth=4, first_stride=8, first_rounds=1, rounds=24, steps=_STEPS
    )


# ------------------------------------------------------------ planners of curves and of feed
@dataclass(frozen=True)
class CurvePlannerSettings:
    """Settings of the planner in the plane, from free space to the smooth path.

    Attributes:
        motion: settings of the search for a motion.
        goal_pose: settings of the goal-pose NLP.
    """

    motion: MotionSettings = field(default_factory=MotionSettings)
    goal_pose: PoseSettings = field(default_factory=PoseSettings)


DEFAULT_CURVE_PLANNER = CurvePlannerSettings()
"""Default settings of the planner in the plane."""
