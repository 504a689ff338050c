"""Settings of the user's constraints as limits of a motion."""

from dataclasses import dataclass


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
        path_share: share of what is allowed by which the smooth path may miss a row between its knots. Taste.
        pull_weight: weight on mending gaps inside their margin, against a nominal link's distance. Taste, as for
            contacts.
        urgency: scale of the rows of broken gaps, beside those inside their margin. Taste.
        joint_share: share of a joint limit to which bends beyond that are brought back; what splines overshoot stays
            below the limit. Taste.
        newton_steps: most steps of Newton's method back onto equations. Taste: it converges in four or never.
        rank: singular values below this share of the largest count as none, so that equations that follow from
            others are left out. Taste.
        far: gaps that the whole arm has to turn by more than this to close make no rows on keyframes [rad]. Taste.
        keyframe_turn: a keyframe that needs a larger turn of a link to meet its equations does not meet them [rad].
            Taste.
        reserve: share of the kept margin that a gap keeps between keyframes, for what lies between samples. Taste.
        knot_reserves: reserves to which a knot of the smooth path is moved that has less than half of that. Measured:
            with 2 a path at the edge of a camera's view was refused, with 4 it is laid.
        samples: samples of an interval between keyframes. Taste.
        near_end: share of the intervals at either end at which a gap may be as narrow as at that end. Taste.
    """

    margin: float = 2e-3
    keep_share: float = 0.4
    met: float = 1e-10
    met_at_goal: float = 1e-8
    allowed: float = 1e-6
    path_share: float = 0.2
    pull_weight: float = 30.0
    urgency: float = 10.0
    joint_share: float = 0.995
    newton_steps: int = 12
    rank: float = 1e-9
    far: float = 2.0
    keyframe_turn: float = 0.5
    reserve: float = 0.02
    knot_reserves: float = 4.0
    samples: int = 4
    near_end: float = 0.1
