"""Numbers of planning that are tuned or passed in: step, guides, search, samplers, optimisation, planners.

Lengths are in nominal links, which do not depend on how many links an arm really has: weights and advances that suit
one arm then suit another of the same shape. A weight "per nominal link" is shared out among the links of one.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.scene.contact_finder import CertificateSettings


@dataclass(frozen=True)
class ConvexSettings:
    """Numbers of the sequential convex programming.

    Attributes:
        price: first price of one nominal link of slack. Taste.
        highest_price: to which it rises where an interval lacks room. Taste.
        worth: share of the merit that a round has to gain. Taste.
        patience: rounds in a row that may gain less. Taste.
        patience_in_want: the same of a motion that lacks room. Taste.
        counts_room: whether the room that a motion lacks counts in its merit, and only one of more merit is stepped on
            from; else only rows count, at their prices, and every step is kept.
    """

    price: float = 30.0
    highest_price: float = 500.0
    worth: float = 3e-3
    patience: int = 2
    patience_in_want: int = 2
    counts_room: bool = False


@dataclass(frozen=True)
class OptimisationSettings:
    """Numbers of the optimisation of a motion.

    Attributes:
        intervals: least number of intervals; a motion that needs more legs to be certified keeps them. Measured:
            twice as many shortened motions by 5 % at most.
        moved_intervals: numbers of intervals that are tried where keyframes have to be moved onto limits, until the
            motion through them is certified. Taste.
        finer_intervals: least number of intervals where a motion lacks room. Measured: of 18 motions among clutter that
            lacked it, few gained much with as many as before, most with about twice as many.
        leg_depth: bisections that a leg of the thinned motion may need for its certificate. Taste.
        first_stride: keyframes that such a leg skips at first. Taste.
        first_rounds: steps at many keyframes, before the motion is thinned again. Taste.
        rounds: most steps that are taken. Taste.
        free_rounds: most steps before it is decided where the motion ends. Taste.
        end_rounds: most steps after that. Taste.
        steps: of the sequential convex programming.
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
    """Numbers of a single step, whatever its limits.

    Attributes:
        largest_turn: largest turn of a link in one step [rad], so that the linearised rows hold. Taste.
        limit_share: share of a joint limit that planning uses: rows do not know that the shape of a fed arm changes
            with its feed. Taste.
        firm_share: of what a gap lacks to its margin that rows ask for, where there is such a step; usually nothing.
            Taste.
        mending_share: the same that a step is drawn to mend. Taste.
        push_weight: weight on that, against a nominal link's distance. Taste.
        keep_share: share of the planning margin that every accepted pose keeps, where steps are not proved. Taste.
        travel: farthest way of a joint in a step, and the same where walls or links are within reach [u].
        still: whether to keep the arm still where nothing else asks for more.
        proof_depth: bisections of the proof of every step; None where whole motions alone are proved.
        ridge: keeps the step's Hessian definite where no term reaches. Taste.
        blend_ridge: the same on unknowns that blend a goal of the whole arm in, where that is more.
    """

    largest_turn: float = 0.15
    ridge: float = 1e-8
    blend_ridge: float = 1e-8
    limit_share: float = 0.995
    firm_share: float = 0.0
    mending_share: float = 1.0
    push_weight: float = 30.0
    keep_share: float = 0.0
    travel: tuple[float, float] = (1.5, 0.8)
    still: bool = True
    proof_depth: int | None = 5

    @property
    def accepted_share(self) -> float:
        """Share of a joint limit that may come of a step: a QP is not more exact."""
        return 1.0 - 1e-5


@dataclass(frozen=True)
class StepSettings(AnyStepSettings):
    """Numbers of a single step in the plane.

    Attributes:
        limit_share: share of a joint limit that planning uses; what accepted poses and splines overshoot stays below
            the limit. Taste.
        full_limit_share: the same where the ends, or what keeps the arm off its goal, ask for more. Derived: what rows
            and polishing may err by is a hundredth of a degree at most.
        narrow_firm_share: the same where margins are narrow. Taste.
        ridge: as of any step.
        narrow_ridge: the same where margins are narrow. Measured: beside the heavy weights there the solver does not
            tell a Hessian with the usual ridge definite, and takes 600 iterations where 10 do.
        blend_ridge: the same on coordinates that blend a goal of the whole arm in. Measured on a chain in a horn, 12 to
            96 links: with the usual one a step along a guide's path took 36 to 280 iterations of its QP or never ended,
            with this one 3 to 7.
        narrow_margin: planning margin below which steps are smaller, in nominal links. Taste: the usual narrow one.
    """

    limit_share: float = 0.98
    still: bool = False
    proof_depth: int | None = None
    full_limit_share: float = 0.9995
    keep_share: float = 0.4
    mending_share: float = 0.5
    travel: tuple[float, float] = (np.inf, np.inf)
    narrow_firm_share: float = 0.5
    ridge: float = 1e-9
    narrow_ridge: float = 1e-6
    blend_ridge: float = 1e-6
    narrow_margin: float = 0.024

    @property
    def accepted_share(self) -> float:
        """Half-way between what planning uses and the limit."""
        return 0.5 * (1.0 + self.limit_share)

    def narrowed(self, margin: float) -> "StepSettings":
        """Return the numbers for a planning margin, in nominal links: where it is small, so are the steps.

        Linearised rows err by the square of the turn. What pushes the arm out of its margin has to grow as the margin
        gets smaller, or the guide would hold it at the very edge, where no step is left.
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
    """Numbers of following a guide, and of settling on the goal where it ends.

    Attributes:
        settle_steps: most steps of settling on the goal. Taste.
        settle_least: steps of settling that are taken even if the arm hardly moves. Taste.
        settle_growth: growth of the goal's weight from step to step. Taste.
        still_weight: weight on standing still while settling, for all links together. Taste.
        polish_distance: distance from the goal at which polishing is tried, in nominal links. Taste.
        polish_turn: turn of the tip's direction from the goal's at which polishing is tried [rad]. Taste.
    """

    settle_steps: int = 150
    settle_least: int = 20
    settle_growth: float = 0.2
    still_weight: float = 0.5
    polish_distance: float = 0.1
    polish_turn: float = 0.1


@dataclass(frozen=True)
class GoalSettings:
    """Numbers of drawing the tip onto the goal, and of putting it there exactly.

    Attributes:
        polish_tolerance: tip error [arm lengths] and heading error [rad] that the polish stops at. Derived: three
            orders below what the verifier allows.
        reached: times that tolerance which still counts as on the goal. Taste.
        heading_weight: weight of the heading, and of what limits miss at the goal, beside the position. Taste.
        distance_step: largest advance onto the goal that a step asks for, in nominal links. Taste.
        turn_step: largest turn onto the goal's direction that a step asks for [rad]. Taste.
    """

    polish_tolerance: float = 1e-9
    reached: float = 10.0
    heading_weight: float = 0.3
    distance_step: float = 1.5
    turn_step: float = 0.3

    @property
    def on_goal(self) -> float:
        """Errors up to this count as none [arm lengths] and [rad]."""
        return self.reached * self.polish_tolerance


@dataclass(frozen=True)
class TrackingSettings:
    """Numbers of tracking a reference motion under constraints that depend on the path parameter u.

    Attributes:
        first_advance: first step of u. Taste.
        largest_advance: largest step of u. Taste.
    """

    first_advance: float = 1.0 / 80.0
    largest_advance: float = 1.0 / 40.0


@dataclass(frozen=True)
class TipWalkSettings:
    """Numbers of walks of the tip.

    The measured ones were chosen on nine walked fields of 1000 and 3000 polygons in which no straight attempt arrives,
    seeds 100 to 107 of ``tests/benchmarks/bench_growth.py``.

    Attributes:
        margins: planning margins with which the tip is led straight on, and that walks draw from, in nominal links.
            Measured: of fourteen fields of 1000 and 3000 polygons the first alone solves seven, the others two more.
        longest_way: beyond which there are no early walks, as a share of the arm's length. Measured: in fields of 1000
            polygons with goals drawn at random, walks along 0.2 to 0.6 of the arm's length mostly arrive, and along
            1.2 to 2.0, where the arm has to be laid anew from its base, never.
        early_walks: before poses at the goal are looked for. Taste: half of what those take in vain, or less.
        late_walks: before the trees. Taste: a few times as many.
    """

    margins: tuple[float, ...] = (0.012, 0.06, 0.024, 0.008)
    longest_way: float = 0.8
    early_walks: int = 150
    late_walks: int = 120


@dataclass(frozen=True)
class EngineSettings:
    """Numbers of taking steps, of following a guide and of tracking.

    Attributes:
        step: of a single step.
        continuation: of following a guide and settling on the goal.
        goal: of putting the tip onto the goal.
        tracking: of tracking a reference motion.
        optimisation: of the optimisation of a motion.
    """

    step: AnyStepSettings = field(default_factory=AnyStepSettings)
    continuation: ContinuationSettings = field(default_factory=ContinuationSettings)
    goal: GoalSettings = field(default_factory=GoalSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    optimisation: OptimisationSettings = field(default_factory=OptimisationSettings)


@dataclass(frozen=True)
class MotionSettings(EngineSettings):
    """Numbers of the search for a motion in the plane, besides those of any.

    Attributes:
        certificate: of the certificate of contact.
        step: of a single step.
        many_walls: walls in the neighbourhood beyond which the tip is led along every path before poses at the goal are
            looked for. Taste: among a thousand, such poses take seconds.
        tip_walks: of leading the tip among many walls.
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
"""Of the optimisation: in space an iterate counts by the room that it has, not by its rows alone."""


@dataclass(frozen=True)
class SpaceCertificateSettings:
    """Of the proof that a motion touches nothing.

    Attributes:
        depth: how often an interval may be halved; taste: at twelve a step has been cut into four thousand.
        spare: gap that is proved beyond contact, for the path between its samples [u].
        slack: share of a link's motion by which distances may be told too small at first; walks along finely meshed
            walls are shorter so, and where it does not prove enough they are made again without.
    """

    depth: int = 12
    spare: float = 0.002
    slack: float = 0.3


@dataclass(frozen=True)
class SpaceMotionSettings(EngineSettings):
    """All numbers of the search in space, besides those of any.

    Attributes:
        certificate: of proofs.
        continuation: of following a guide and settling on the goal.
        goal: of putting the tip onto the goal.
        optimisation: of a found motion.
    """

    certificate: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    continuation: ContinuationSettings = ContinuationSettings(60, 10, 0.5, 0.0, 0.5, 0.2)
    goal: GoalSettings = GoalSettings(heading_weight=1.0, distance_step=1.0, turn_step=0.5)
    optimisation: OptimisationSettings = OptimisationSettings(
        intervals=24, finer_intervals=32, leg_depth=4, first_stride=8, first_rounds=2, rounds=24, steps=_STEPS
    )


# ------------------------------------------------------------ planners of curves and of feed
@dataclass(frozen=True)
class CurvePlannerSettings:
    """Numbers of the planner, from free space to the smooth path.

    Attributes:
        motion: of the search for a motion.
        goal_pose: of the goal pose's NLP.
    """

    motion: MotionSettings = field(default_factory=MotionSettings)
    goal_pose: PoseSettings = field(default_factory=PoseSettings)


DEFAULT_CURVE_PLANNER = CurvePlannerSettings()
"""The numbers that are used unless others are given."""
