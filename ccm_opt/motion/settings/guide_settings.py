"""Settings of the guides, which say where the arm should go next, and of the candidates made of them.

Lengths are in nominal links, which do not depend on how many links an arm really has: weights and advances that suit
one arm then suit another of the same shape. A weight "per nominal link" is shared out among the links of one.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class InterpolationSettings:
    """Numbers of the straight interpolation of coordinates.

    Attributes:
        advance: turn of the fastest link by which the target goes on in one step [rad]. Taste; below the step's own
            limit, so that the arm can keep up.
        leash: largest turn that any link may lag behind before the target waits [rad]. Taste.
        arrived: largest turn between a link and the end at which the interpolation has arrived [rad]. Taste; what is
            left is settled or followed once more.
        coordinate_weight: of the coordinates themselves, which ties down what no link heading shows. Taste.
        coordinate_step: largest change of a coordinate that is asked for in one step [rad] or [1/m]. Taste.
    """

    advance: float = 0.1
    leash: float = 0.4
    arrived: float = 0.1
    coordinate_weight: float = 1e-4
    coordinate_step: float = 1.0


@dataclass(frozen=True)
class TipLedSettings:
    """Numbers of tip-led continuation, against a weight of 1 for the tip's error in nominal links.

    Attributes:
        advance: travel of the target in one step, in nominal links. Taste.
        leash: how far the tip may lag before the target waits, in nominal links. Taste.
        longest_error: error of the tip that is asked to be mended in one step, in nominal links. Taste.
        following_weight: of a link's heading when it lies on the track, per nominal link. Taste.
        largest_turn: of a link onto the track that is asked for in one step [rad]. Taste.
        turn_weight: of every link's turn, per nominal link: the arm moves as little as it can. Taste.
        motion_weight: of every joint's motion, per nominal link. Taste.
    """

    advance: float = 0.4
    leash: float = 1.5
    longest_error: float = 1.0
    following_weight: float = 0.1
    largest_turn: float = 0.3
    turn_weight: float = 0.01
    motion_weight: float = 0.01


@dataclass(frozen=True)
class HairpinSettings:
    """Numbers of the travelling hairpin, against a weight of 1 for the tip's error in nominal links.

    What is measured was chosen on OMPL's kinematic chains of 12 to 96 links: a prototype with these numbers solved all
    fifteen at the first attempt, and 150 of 150 from perturbed starts; ``tests/benchmarks/bench_ompl.py`` runs them.

    Attributes:
        lengths: of the hairpin that are tried, in nominal links. Measured: what suits a passage lies between the least
            and the greatest.
        passage_share: length of the hairpin that fits a passage, as a share of its width. Measured.
        passage_quantile: of the widths along a path that counts as the passage's; the least alone may be a corner that
            is only touched. Taste.
        same_length: hairpins whose lengths differ by less are the same, in nominal links. Taste.
        advance: travel of the fold in one step, in nominal links. Measured.
        leash: how far the tip may lag behind its target before the fold waits, in nominal links. Measured.
        longest_error: error of the tip that is asked to be mended in one step, in nominal links. Taste.
        heading_weight: of every link's heading against the reference, per nominal link. Measured.
        turn_weight: of every link's turn, per nominal link. Measured.
        motion_weight: of every joint's motion, per nominal link. Taste.
        still_weight: of a joint's motion ahead of the fold in addition, where the arm should stay. Taste.
        longest_shape: the taut path from the base may be this share of the arm's length; it cuts no corner, so the
            arm itself may fit where the path seems a little too long. Taste.
        places: of the fold among which is the one where it would have led the tip to the end of its track. Taste.
    """

    lengths: tuple[float, ...] = (5.0, 7.0, 4.0, 9.0)
    passage_share: float = 1.18
    passage_quantile: float = 0.25
    same_length: float = 0.5
    advance: float = 0.3
    leash: float = 2.5
    longest_error: float = 1.5
    heading_weight: float = 0.3
    turn_weight: float = 0.002
    motion_weight: float = 0.02
    still_weight: float = 4.0
    longest_shape: float = 1.1
    places: int = 400


@dataclass(frozen=True)
class WithdrawalSettings:
    """Numbers of drawing an arm back along itself.

    Attributes:
        least_way: of the tip back through passages in which the arm lies and a fold has no room, for drawing back to be
            tried first, in nominal links. Taste.
        beside: a place of the tip's way that is nearer to the arm than this lies beside it, in nominal links. Taste.
        near_base: links nearer to the base along the arm than this do not count, in nominal links. Taste.
        advance: travel of the fold in one step, in nominal links. Taste.
        leash: how far the strand may lag before the fold waits, in nominal links. Taste.
        longest_error: error of a joint that is asked to be mended in one step, in nominal links. Taste.
        strand_weight: of the joints of the strand that is drawn back, per nominal link. Taste.
        heading_weight: of every link's heading against the reference, per nominal link. Taste.
        turn_weight: of every link's turn, per nominal link. Taste.
        motion_weight: of every joint's motion, per nominal link. Taste.
    """

    least_way: float = 2.0
    beside: float = 2.5
    near_base: float = 3.0
    advance: float = 0.15
    leash: float = 0.3
    longest_error: float = 1.0
    strand_weight: float = 1.0
    heading_weight: float = 0.3
    turn_weight: float = 0.002
    motion_weight: float = 0.02


@dataclass(frozen=True)
class SlidingSettings:
    """Numbers of sliding out of narrow gates.

    Attributes:
        advance: by which the arm is drawn back in one step, in nominal links. Taste.
        leash: how far a joint may lag before the arm is drawn on, in nominal links. Taste.
        longest_error: error of a joint that is asked to be mended in one step, in nominal links. Taste.
        strand_weight: of the joints that are drawn back, per nominal link, against their distance in nominal links.
            Taste.
        bending: weight of the curvature, in nominal links. Taste: far more than elsewhere, so that the arm bows out in
            one bow and does not crumple.
        evenness: weight of its differences from knot to knot. Taste.
        turn_weight: of every link's turn, per nominal link. Taste.
        bowing: way over which the arm is bent to a side at first, in nominal links. Taste.
        bow: curvature to which it is then drawn, in nominal links. Taste.
        beside: a gate lies about the arm if its middle is nearer to it than this, in nominal links. Taste.
    """

    advance: float = 0.2
    leash: float = 0.6
    longest_error: float = 1.0
    strand_weight: float = 1.0
    bending: float = 0.03
    evenness: float = 0.03
    turn_weight: float = 0.002
    bowing: float = 3.0
    bow: float = 0.1
    beside: float = 0.5


@dataclass(frozen=True)
class PassageWidthSettings:
    """Numbers of how passages are measured, and what follows from their width.

    Attributes:
        samples: places along a path at which its passage is measured. Taste.
        narrow: passages less wide than this many nominal links ask for shorter nominal links. Taste: a fold in
            a passage is about a third of its width high, and should not be shorter than a nominal link.
        roomy: width that such passages then have, in nominal links. Taste.
        fitting_share: share of the gap beside the arm that a planning margin may be. Taste: with all of it taken, a
            step could move nowhere.
        margin_share: where no planning margin fits, this share of the gap that there is serves as one. Taste.
        least_margin: least planning margin, in nominal links. Taste.
    """

    samples: int = 96
    narrow: float = 2.5
    roomy: float = 3.2
    fitting_share: float = 0.8
    margin_share: float = 0.5
    least_margin: float = 0.001


@dataclass(frozen=True)
class GuideSettings:
    """Numbers of the guides and of the candidates made of them.

    Attributes:
        heading_window: length over which a track's heading is smoothed, in nominal links. Measured, as the hairpin's
            numbers are.
        corner: turn that makes a corner of a path [rad]. Taste.
        few_corners: a route with more corners bends the arm so that straight interpolation seldom works. Taste.
        interpolation: of the straight interpolation of coordinates.
        tip_led: of tip-led continuation.
        hairpin: of the travelling hairpin.
        withdrawal: of drawing back.
        sliding: of sliding out of narrow gates.
        passages: of how passages are measured.
    """

    heading_window: float = 2.0
    corner: float = 0.02
    few_corners: int = 2
    interpolation: InterpolationSettings = field(default_factory=InterpolationSettings)
    tip_led: TipLedSettings = field(default_factory=TipLedSettings)
    hairpin: HairpinSettings = field(default_factory=HairpinSettings)
    withdrawal: WithdrawalSettings = field(default_factory=WithdrawalSettings)
    sliding: SlidingSettings = field(default_factory=SlidingSettings)
    passages: PassageWidthSettings = field(default_factory=PassageWidthSettings)


DEFAULT_GUIDES = GuideSettings()
"""What guides take when they are not given other settings."""
