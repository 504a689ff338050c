"""Numbers of planning in space.

Lengths are in nominal links u = L / 24 unless said otherwise.

Lengths are in nominal links u = L / 24 unless said otherwise.

Lengths are in nominal links u = L / 24 unless said otherwise.

Lengths are in nominal links u = L / 24 unless said otherwise.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass, field
from functools import partial

from ccm_opt.planning.settings import ConvexSettings, ObjectiveSettings


@dataclass(frozen=True)
class EndingSettings:
    """Of the pose in which a motion ends.

    Attributes:
        iterations: most iterations of the NLP; mostly it takes some twenty, and of arms on fixed bases, whose ends a
            search leaves far from smooth, one in four takes 30 to 80 (measured among 40 and 80 bodies).
        enough: share of the wanted gap that its pose has to have for the end to be settled.
        room_share: room that the NLP makes at the end, where there is so much, as a multiple of the wanted gap. An arm
            that follows its tip lies all the way near where it ends, and strays from that by some of it: with 1.6 fed
            arms keep 0.82 to 1.2 of the wanted gap all the way among bays, blades and pipes, with 1 they keep 0.6 to 1.
        bending_from: places along a motion, as shares of it, from where on it is tried to be bent to another end.
        opened: they end when no joint moves farther than this [u].
    """

    iterations: int = 100
    enough: float = 0.9
    room_share: float = 1.6
    bending_from: tuple[float, ...] = (0.0, 0.5, 0.8)
    opened: float = 0.02


@dataclass(frozen=True)
class SpaceConnectSettings:
    """Of the sampler, RRT-Connect in the unknowns of the curve.

    Attributes:
        draws: of targets, at most, each time that it begins.
        base_share: share of the draws in which the base alone is turned anywhere, and the curve is that between the
            start and a goal.
    """

    draws: int = 8000
    base_share: float = 0.0


_STEPS = ConvexSettings(
    tries=6,
    price=100.0,
    shortened_growth=2.0,
    shortenings=(1.0, 0.5, 0.25, 0.1),
    worth=0.02,
    patience=1,
    patience_in_want=3,
    counts_room=True,
)
"""Of the optimisation: in space an iterate counts by the room that it has, not by its rows alone."""


@dataclass(frozen=True)
class SpaceOptimisationSettings:
    """Of the optimisation of a motion.

    Attributes:
        intervals: least number of intervals; a motion that needs more edges to be certified keeps them.
        many: intervals that are many, as a multiple of that.
        margin: gap that rows ask for beyond contact [u].
        active: rows nearer to their bound than this enter the program [u].
        between: shares of an interval at which links that lack room have rows too.
        planes: most half-spaces about a link.
        groups: arms with more links than this have rows for groups of neighbouring joints.
        steps: of the sequential convex programming.
    """

    intervals: int = 24
    many: float = 1.2
    margin: float = 0.02
    active: float = 0.3
    between: tuple[float, ...] = (0.25, 0.75)
    planes: int = 6
    groups: int = 24
    steps: ConvexSettings = _STEPS


@dataclass(frozen=True)
class SpaceCertificateSettings:
    """Of the proof that a motion touches nothing.

    Attributes:
        depth: how often an interval may be halved; taste: at twelve a step has been cut into four thousand.
        step_depth: the same for a step of the search, of which a shorter one is tried instead; measured in clutter.
        spare: gap that is proved beyond contact, for the path between its samples [u].
        slack: share of a link's motion by which distances may be told too small at first; walks along finely meshed
            walls are shorter so, and where it does not prove enough they are made again without.
    """

    depth: int = 12
    step_depth: int = 5
    spare: float = 0.002
    slack: float = 0.3


@dataclass(frozen=True)
class SpaceStepSettings:
    """Of one step: a small quadratic program in the unknowns of the curve.

    Attributes:
        margin: gap that steps keep beyond contact [u].
        share: of the gap beyond the margin that one step may use.
        turn: largest turn of a link in a step [rad].
        feed: farthest way of the base in a step [u].
        bends: weight on the curve's curvature, as bends of a nominal link.
        planes: most half-spaces that a link is given.
    """

    margin: float = 0.06
    share: float = 0.5
    turn: float = 0.15
    feed: float = 0.3
    bends: float = 1e-4
    planes: int = 14


@dataclass(frozen=True)
class SpaceGuideSettings:
    """Of what leads the tip.

    Attributes:
        onto_track: weight on their distance from it.
        advance: how far it moves on at a time [u].
        settle_steps: most steps from the end of a path onto the goal.
        settle_growth: by how much the weight of the goal grows from step to step.
        polish_turn: the same of the direction [rad].
        polish_steps: most steps of it.
        pose_step: how far the target moves on at a time on its way to a pose, in unknowns.
        exact: distance at which the arm counts as on the goal, as a share of the arm's length, and turn [rad].
    """

    onto_track: float = 0.1
    advance: float = 0.4
    settle_steps: int = 60
    settle_growth: float = 0.5
    polish_turn: float = 0.2
    polish_steps: int = 12
    pose_step: float = 0.15
    exact: float = 1e-9


@dataclass(frozen=True)
class FollowableWaySettings:
    """Of ways that an arm can follow behind its tip, with bends no sharper than it takes.

    Attributes:
        step: length of the arcs of which a way is made [u].
        bends: of the arcs, as shares of the tightest one; straight ones come first.
        place_bin: states in one bin count as one: size of its places [u].
        direction_bins: half the number of bins along each side of the six faces of directions.
        most_states: that are looked at.
    """

    step: float = 1.0
    bends: tuple[float, ...] = (0.5, 1.0)
    place_bin: float = 0.5
    direction_bins: int = 2
    most_states: int = 20_000


@dataclass(frozen=True)
class SpaceMotionSettings:
    """All numbers of the search.

    Attributes:
        certificate: of proofs.
        step: of single steps.
        guide: of what leads the tip.
        followable: ways for arms that follow their tip.
        swing: trees between poses that have been unbent; they meet after few draws or not at all. Measured on curled
            arms beside a post, where some hundred draws are enough.
        connect: trees as the last resort.
        ending: of the pose in which a motion ends.
        objective: of the optimisation.
        optimisation: of a found motion.
    """

    certificate: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    step: SpaceStepSettings = field(default_factory=SpaceStepSettings)
    guide: SpaceGuideSettings = field(default_factory=SpaceGuideSettings)
    followable: FollowableWaySettings = field(default_factory=FollowableWaySettings)
    swing: SpaceConnectSettings = field(default_factory=partial(SpaceConnectSettings, draws=1000, base_share=0.8))
    connect: SpaceConnectSettings = field(default_factory=SpaceConnectSettings)
    ending: EndingSettings = field(default_factory=EndingSettings)
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    optimisation: SpaceOptimisationSettings = field(default_factory=SpaceOptimisationSettings)
