"""Numbers of planning in the plane: step, guides, search, samplers, optimisation.

Lengths are in nominal links, which do not depend on how many links an arm really has: weights and advances that suit
one arm then suit another of the same shape. A weight "per nominal link" is shared out among the links of one.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.scene.contact_finder import CertificateSettings, ContactSettings


@dataclass(frozen=True)
class ShortcutSettings:
    """Numbers of replacing stretches of a way by straight motions.

    Attributes:
        rounds: in each of which one stretch may be replaced. Taste.
        tries: stretches that are tried in each round. Taste.
        saved: least share of the way that a shortcut saves. Taste.
    """

    rounds: int = 12
    tries: int = 16
    saved: float = 0.01


@dataclass(frozen=True)
class ConnectSettings:
    """Numbers of RRT-Connect.

    Attributes:
        few_links: arms with at most so many links are planned in all of their bends. Taste: beyond, shapes drawn at
            random in the bends crumple, and smooth ones are drawn.
        few_budgets: extensions that searches one after the other may take before all else, for arms of few links.
            Measured: most scenes take some thousand; what takes long is mostly found sooner from the beginning.
        shortcuts: of shortening what is found, before it is optimised.
    """

    few_links: int = 10
    few_budgets: tuple[int, ...] = (5000, 10000, 20000)
    shortcuts: ShortcutSettings = field(default_factory=ShortcutSettings)


@dataclass(frozen=True)
class EndSettings:
    """Numbers of the ends of a motion.

    Attributes:
        stretch: share of its length by which an arm is kept from full stretch where a goal out of reach is aimed at.
            Taste: there the tip cannot move along the arm.
        flush: a mount whose end is as near as this to its wall's clearance, as a share of the arm's length, stands
            flush on it. Taste.
        reach: gaps that are looked at, as a share of the arm's length. Taste.
    """

    stretch: float = 2e-3
    flush: float = 1e-5
    reach: float = 0.02


DEFAULT_ENDS = EndSettings()
"""The numbers that are used unless others are given."""


@dataclass(frozen=True)
class InterpolationSettings:
    """Numbers of the straight interpolation of coordinates.

    Attributes:
        advance: turn of the fastest link by which the target goes on in one step [rad]. Taste; below the step's own
            limit, so that the arm can keep up.
    """

    advance: float = 0.1


@dataclass(frozen=True)
class TipLedSettings:
    """Numbers of tip-led continuation, against a weight of 1 for the tip's error in nominal links.

    Attributes:
        advance: travel of the target in one step, in nominal links. Taste.
    """

    advance: float = 0.4


@dataclass(frozen=True)
class HairpinSettings:
    """Numbers of the travelling hairpin, against a weight of 1 for the tip's error in nominal links.

    What is measured was chosen on OMPL's kinematic chains of 12 to 96 links: a prototype with these numbers solved all
    fifteen at the first attempt, and 150 of 150 from perturbed starts; ``tests/benchmarks/bench_ompl.py`` runs them.

    Attributes:
        lengths: of the hairpin that are tried, in nominal links. Measured: what suits a passage lies between the least
            and the greatest.
        passage_share: length of the hairpin that fits a passage, as a share of its width. Measured.
        advance: travel of the fold in one step, in nominal links. Measured.
        leash: how far the tip may lag behind its target before the fold waits, in nominal links. Measured.
    """

    lengths: tuple[float, ...] = (5.0, 7.0, 4.0, 9.0)
    passage_share: float = 1.18
    advance: float = 0.3
    leash: float = 2.5


@dataclass(frozen=True)
class WithdrawalSettings:
    """Numbers of drawing an arm back along itself.

    Attributes:
        advance: travel of the fold in one step, in nominal links. Taste.
    """

    advance: float = 0.15


@dataclass(frozen=True)
class PassageWidthSettings:
    """Numbers of how passages are measured, and what follows from their width.

    Attributes:
        samples: places along a path at which its passage is measured. Taste.
    """

    samples: int = 96


@dataclass(frozen=True)
class GuideSettings:
    """Numbers of the guides and of the candidates made of them.

    Attributes:
        heading_window: length over which a track's heading is smoothed, in nominal links. Measured, as the hairpin's
            numbers are.
        corner: turn that makes a corner of a path [rad]. Taste.
        interpolation: of the straight interpolation of coordinates.
        tip_led: of tip-led continuation.
        hairpin: of the travelling hairpin.
        withdrawal: of drawing back.
        passages: of how passages are measured.
    """

    heading_window: float = 2.0
    corner: float = 0.02
    interpolation: InterpolationSettings = field(default_factory=InterpolationSettings)
    tip_led: TipLedSettings = field(default_factory=TipLedSettings)
    hairpin: HairpinSettings = field(default_factory=HairpinSettings)
    withdrawal: WithdrawalSettings = field(default_factory=WithdrawalSettings)
    passages: PassageWidthSettings = field(default_factory=PassageWidthSettings)


DEFAULT_GUIDES = GuideSettings()
"""What guides take when they are not given other settings."""


@dataclass(frozen=True)
class LiftingSettings:
    """Numbers of the repair of a lifted motion.

    Attributes:
        margin: planning margin of a repair, as a share of the arm's length. Taste.
    """

    margin: float = 1.5e-3


@dataclass(frozen=True)
class ObjectiveSettings:
    """Weights inside the objective; what the user weighs stands in the problem.

    Attributes:
        heading: weight of the turns of the links beside the turns of the joints. Taste.
        unevenness: weight of ``∫|q''|²``; its root is the share of the motion over which corners are rounded. Taste.
        shape: weight of the curve's curvature and of its differences, in nominal links. Taste.
        blend: weight on changes of the coordinate that blends a whole-arm goal in. Taste.
        following: of changes of the curve on which a fed arm lies still, as bends of a nominal link; an arm whose curve
            does not change follows its tip. Measured on the disturbed jobs: a hundredth of their duration for half of
            the worst deviation.
    """

    heading: float = 1e-3
    unevenness: float = 4e-3
    shape: float = 1e-3
    blend: float = 1e-3
    following: float = 25.0


@dataclass(frozen=True)
class BottleneckSettings:
    """How much more the busiest joints count, once a motion is nearly optimal.

    Attributes:
        share: of the weight of the path's length that goes to the joints by how busy they are. Measured: with 0.9 and a
            power of a half, 13 motions last 2.6 % less in the median, at best 15 % less and at worst 0.5 % longer.
        power: of a joint's largest turn from keyframe to keyframe over the root mean square of all joints'. Measured:
            with 1 the same motions last 1 % longer in the median.
        least: that ratio counts as at least this much. Taste.
    """

    share: float = 0.9
    power: float = 0.5
    least: float = 0.2


@dataclass(frozen=True)
class InteriorPointSettings:
    """Numbers of the reference, one nonlinear program.

    Attributes:
        tolerance: of IPOPT. Taste.
    """

    tolerance: float = 1e-5


@dataclass(frozen=True)
class ConvexSettings:
    """Numbers of the sequential convex programming.

    Attributes:
        tries: QPs of one round before it is given up. Taste.
        price: first price of one nominal link of slack. Taste.
        highest_price: to which it rises where an interval lacks room. Taste.
        raised_damping: damping from which a refused step raises it. Taste.
        shortened_growth: its growth after a step of less than half its length. Taste.
        good_shrinkage: its fall after a good step. Taste.
        least_damping: least damping. Taste.
        good: share of the foreseen gain from which a step is good. Taste.
        shortenings: shares of a step that are tried until one is certified. Taste.
        worth: share of the merit that a round has to gain. Taste.
        patience: rounds in a row that may gain less. Taste.
        patience_in_want: the same of a motion that lacks room. Taste.
        counts_room: whether the room that a motion lacks counts in its merit, and only one of more merit is stepped on
            from; else only rows count, at their prices, and every step is kept.
    """

    tries: int = 5
    price: float = 30.0
    highest_price: float = 500.0
    raised_damping: float = 0.05
    shortened_growth: float = 3.0
    good_shrinkage: float = 3.0
    least_damping: float = 1e-4
    good: float = 0.6
    shortenings: tuple[float, ...] = (1.0, 0.5, 0.25)
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
        margin: gap that rows ask for beyond contact, as a share of the arm's length. Taste.
        active: rows nearer to their bound than this many such links enter the QP. Taste.
        groups: arms with more links than this have rows for groups of neighbouring joints. Taste.
        most_intervals: intervals of a motion beyond which none that lets nothing move is cut finer. Taste.
        rounds: most steps that are taken. Taste.
        many: keyframes that are many, as a multiple of the intervals wanted. Taste.
        free_rounds: most steps before it is decided where the motion ends. Taste.
        end_rounds: most steps after that. Taste.
        bending_from: places along the motion, as shares of it, from where on it is tried to be bent to another end.
            Taste.
        finest: intervals beyond which a motion is not cut finer for its room. Taste: the cost of a step.
        moved_rounds: the same where keyframes have to be moved onto limits. Taste.
        steps: of the sequential convex programming.
    """

    intervals: int = 20
    moved_intervals: tuple[int, ...] = (24, 48, 96)
    margin: float = 1e-3
    active: float = 1.1
    groups: int = 36
    most_intervals: int = 60
    rounds: int = 14
    free_rounds: int = 9
    many: float = 1.5
    end_rounds: int = 5
    bending_from: tuple[float, ...] = (0.0, 0.5, 0.8)
    finest: int = 80
    moved_rounds: int = 24
    steps: ConvexSettings = ConvexSettings()


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the search.

    Attributes:
        margins: planning margins that are tried in turn, in nominal links: the wide one finds smoother motions, the
            narrow one gets through. Measured: with less than the narrow one, the first candidate failed in one scene.
        tree_margins: margins that trees of poses are grown with, in nominal links: a wide one moves on faster, a
            narrow one gets through. Taste.
        reach: contacts nearer than this make rows of the step, in nominal links. Taste: a step moves a link by less.
        lift_margin: gap that an optimised motion keeps when it is to be lifted, as a share of the arm's length.
            Taste: about what an arm of 24 links leaves the curve by.
        many_walls: walls in the neighbourhood beyond which the tip is led along every path before poses at the goal are
            looked for. Taste: among a thousand, such poses take seconds.
        spare: gap beyond contact that the certificate asks for, as a share of the arm's length. Taste.
    """

    margins: tuple[float, ...] = (0.06, 0.024)
    tree_margins: tuple[float, ...] = (0.12, 0.06, 0.024)
    reach: float = 0.96
    lift_margin: float = 3e-3
    many_walls: int = 150
    spare: float = 1e-4


@dataclass(frozen=True)
class RailSettings:
    """Numbers of the rails through narrow gates, and of the lines across them.

    Attributes:
        weight: on a joint's distance from the middle of its gate beyond a part of the play, against a nominal link's
            distance. Taste: with three times as much joints cannot give way to the goal.
        beside: joints farther off than this are not on the rail, in nominal links. Taste.
        places: of a gate's middle line at which it is measured where it is narrowest. Taste.
        narrowest: by this share more than the least distance to walls still counts as narrowest. Taste: a hundredth
            of a gate's width; lines before a rounded wall, where there is room aside, refuse motions that exist.
        short: a stretch shorter than this many radii of the gate has one line, not one at either end. Taste.
        across: a line is crossed where that is no farther from its middle, in nominal links. Taste.
        catching_up: most that a step asks a crossing to move towards the middle, in nominal links. Taste.
        exact: distance from the middles that is left, as a share of the arm's length. Taste: a thousandth of the play.
    """

    weight: float = 30.0
    beside: float = 0.5
    places: int = 61
    narrowest: float = 1e-3
    short: float = 0.15
    across: float = 0.25
    catching_up: float = 0.02
    exact: float = 1e-6


@dataclass(frozen=True)
class StepSettings:
    """Numbers of a single step.

    Attributes:
        limit_share: share of a joint limit that planning uses; what accepted poses and splines overshoot stays below
            the limit. Taste.
        full_limit_share: the same where the ends, or what keeps the arm off its goal, ask for more. Derived: what rows
            and polishing may err by is a hundredth of a degree at most.
        keep_share: share of the planning margin that every accepted pose keeps. Taste.
        largest_turn: largest turn of a link in one step [rad], so that the linearised rows hold. Taste.
        firm_share: the same that rows ask for, where there is such a step; usually nothing. Taste.
        narrow_firm_share: the same where margins are narrow. Taste.
        push_weight: weight on mending gaps inside their margin, against a nominal link's distance. Taste.
        ridge: keeps the step's Hessian definite where no term reaches. Taste.
        narrow_ridge: the same where margins are narrow. Measured: beside the heavy weights there the solver does not
            tell a Hessian with the usual ridge definite, and takes 600 iterations where 10 do.
        blend_ridge: the same on coordinates that blend a goal of the whole arm in. Measured on a chain in a horn, 12 to
            96 links: with the usual one a step along a guide's path took 36 to 280 iterations of its QP or never ended,
            with this one 3 to 7.
        narrow_margin: planning margin below which steps are smaller, in nominal links. Taste: the usual narrow one.
        rails: of what draws joints to the middle of narrow gates.
    """

    limit_share: float = 0.98
    full_limit_share: float = 0.9995
    keep_share: float = 0.4
    largest_turn: float = 0.15
    firm_share: float = 0.0
    narrow_firm_share: float = 0.5
    push_weight: float = 30.0
    ridge: float = 1e-9
    narrow_ridge: float = 1e-6
    blend_ridge: float = 1e-6
    narrow_margin: float = 0.024
    rails: RailSettings = field(default_factory=RailSettings)

    def narrowed(self, margin: float) -> "StepSettings":
        """The numbers for a planning margin, in nominal links: where it is small, so are the steps.

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
        bending: weight on the curve's curvature in every step, against a nominal link's distance. Taste: it decides
            only what nothing else does.
        jerk: weight on the differences of the curvature from knot to knot. Taste.
        settle_steps: most steps of settling on the goal. Taste.
        polish_turn: turn of the tip's heading from the goal's at which polishing is tried [rad]. Taste.
    """

    bending: float = 1e-4
    jerk: float = 1e-4
    settle_steps: int = 150
    polish_turn: float = 0.1


@dataclass(frozen=True)
class GoalSettings:
    """Numbers of drawing the tip onto the goal, and of putting it there exactly.

    Attributes:
        polish_tolerance: tip error [arm lengths] and heading error [rad] that the polish stops at. Derived: three
            orders below what the verifier allows.
        reached: times that tolerance which still counts as on the goal. Taste.
        heading_weight: weight of the heading, and of what limits miss at the goal, beside the position. Taste.
    """

    polish_tolerance: float = 1e-9
    reached: float = 10.0
    heading_weight: float = 0.3

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
        least_advance: step of u below which tracking is given up. Taste.
        growth: of the step of u after each that was met. Taste.
        arrival: u where tracking ends and the arm settles on the goal. Taste.
        steps: that may be needed to meet the constraints at a new u. Taste.
        largest_turn: largest turn towards the reference that a step asks for [rad]. Taste.
        pull_weight: weight of the reference, against a nominal link's distance. Taste.
    """

    first_advance: float = 1.0 / 80.0
    largest_advance: float = 1.0 / 40.0
    least_advance: float = 1e-4
    growth: float = 1.5
    arrival: float = 0.98
    steps: int = 24
    largest_turn: float = 0.3
    pull_weight: float = 0.1


@dataclass(frozen=True)
class StraighteningSettings:
    """Numbers of cutting a found motion short.

    Attributes:
        many: motions that need no more intervals to be certified are optimised as they are. Taste.
        shortcuts: that are tried. Measured: among 1000 polygons 64 rounds of 32 take a third off a motion in 0.17 s,
            these two fifths in 0.28 s, and twice as many rounds hardly more.
    """

    many: int = 40
    shortcuts: ShortcutSettings = field(default_factory=lambda: ShortcutSettings(128, 64, 0.005))


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
        nearest: distance of such places from there at least, as a share of the arm's length. Taste.
        rounding: distances that their paths keep from corners, as multiples of the usual one. Measured: with several
            the mean time to a solution was 3.3 s instead of 4.1.
    """

    margins: tuple[float, ...] = (0.012, 0.06, 0.024, 0.008)
    longest_way: float = 0.8
    early_walks: int = 150
    late_walks: int = 120
    nearest: float = 0.05
    rounding: tuple[float, ...] = (0.5, 1.0, 2.0)


@dataclass(frozen=True)
class TreeSettings:
    """Numbers of the trees of poses.

    Attributes:
        patience: steps without progress before an extension ends. Taste.
        dispersion: distance that nodes keep, as ``heading_weight`` measures it. Taste.
        heading_weight: of a radian of heading against the length of the arm in the distance of two poses. Taste.
        most_extensions: extensions in all before the search is given up, however much time is left, so that what is
            found does not depend on it. Measured in 24 scenes of clutter: 22 need at most 16, one 51, one 201.
    """

    patience: int = 12
    dispersion: float = 0.04
    heading_weight: float = 0.1
    most_extensions: int = 400


DEFAULT_TREES = TreeSettings()
"""What trees take when they are not given other settings."""


@dataclass(frozen=True)
class UserLimitSettings:
    """Numbers of the user's constraints as limits.

    A gap g has the user's unit; divided by the norm of its slope by the link headings it is the turn of the whole arm
    that closes it, and that is what margins are measured in.

    Attributes:
        margin: margin of a gap, as a turn of the whole arm [rad]. Taste: a tenth of a degree.
        keep_share: share of the margin that every accepted pose keeps. Taste, as for contacts.
        met: an equation is met when nothing misses by more, in the user's unit. Derived: four orders below what the
            verifier allows.
        met_at_goal: by how much constraints may be missed at the goal and at keyframes, in the user's unit. Derived:
            two orders below what the verifier allows.
        allowed: by which a hard constraint may be missed, in the user's unit. Derived: what the verifier allows.
        newton_steps: most steps of Newton's method back onto equations. Taste: it converges in four or never.
        far: gaps that the whole arm has to turn by more than this to close make no rows on keyframes [rad]. Taste.
        keyframe_turn: a keyframe that needs a larger turn of a link to meet its equations does not meet them [rad].
            Taste.
    """

    margin: float = 2e-3
    keep_share: float = 0.4
    met: float = 1e-10
    met_at_goal: float = 1e-8
    allowed: float = 1e-6
    newton_steps: int = 12
    far: float = 2.0
    keyframe_turn: float = 0.5


@dataclass(frozen=True)
class MotionSettings:
    """Numbers of the search for a motion.

    Attributes:
        ends: of resolving start and goal.
        contacts: of near pairs.
        certificate: of the certificate of contact.
        step: of a single step.
        continuation: of following a guide and settling on the goal.
        goal: of putting the tip onto the goal.
        tracking: of tracking a reference motion.
        user_limits: of the user's constraints.
        search: of the search over all strategies.
        guides: of the guides and candidates.
        tip_walks: of leading the tip among many walls.
        tree: of the trees of poses.
        connect: of RRT-Connect.
        lifting: of taking a motion over to an arm of many links.
        straightening: of cutting a long motion short before it is optimised.
        optimisation: of the optimisation of a motion.
        objective: weights inside its objective.
        bottleneck: how much more the busiest joints count at last.
        interior_point: of the optimisation as one nonlinear program.
    """

    ends: EndSettings = field(default_factory=EndSettings)
    contacts: ContactSettings = field(default_factory=ContactSettings)
    certificate: CertificateSettings = field(default_factory=CertificateSettings)
    step: StepSettings = field(default_factory=StepSettings)
    continuation: ContinuationSettings = field(default_factory=ContinuationSettings)
    goal: GoalSettings = field(default_factory=GoalSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    user_limits: UserLimitSettings = field(default_factory=UserLimitSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    guides: GuideSettings = field(default_factory=GuideSettings)
    tip_walks: TipWalkSettings = field(default_factory=TipWalkSettings)
    tree: TreeSettings = field(default_factory=TreeSettings)
    connect: ConnectSettings = field(default_factory=ConnectSettings)
    lifting: LiftingSettings = field(default_factory=LiftingSettings)
    straightening: StraighteningSettings = field(default_factory=StraighteningSettings)
    optimisation: OptimisationSettings = field(default_factory=OptimisationSettings)
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    bottleneck: BottleneckSettings = field(default_factory=BottleneckSettings)
    interior_point: InteriorPointSettings = field(default_factory=InteriorPointSettings)
