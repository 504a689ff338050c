"""Numbers of one step of the search, and of what leads the tip from step to step.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceStepSettings:
    """Of one step: a small quadratic program in the unknowns of the curve.

    Attributes:
        margin: gap that steps keep beyond contact [u].
        reach: gap from which on walls are left out [u].
        pair_reach: the same of links to each other [u].
        share: of the gap beyond the margin that one step may use.
        pull: weight that draws out what lies within the margin.
        turn: largest turn of a link in a step [rad].
        travel: farthest way of a joint in a step [u].
        feed: farthest way of the base in a step [u].
        travel_near_walls: the same where walls or other links are within reach.
        still_turns: weight on the turns of the links.
        still_moves: weight on the ways of the joints.
        follow: weight on the links' directions along the track of the tip.
        bends: weight on the curve's curvature, as bends of a nominal link.
        evenness: weight on its differences from knot to knot.
        spare_turn: of the joint limits that rows leave [rad].
        ridge: on every unknown, so that the program has one answer.
        planes: most half-spaces that a link is given.
        backtracks: how often a step is halved before it is given up.
    """

    margin: float = 0.06
    reach: float = 0.35
    pair_reach: float = 0.35
    share: float = 0.5
    pull: float = 30.0
    turn: float = 0.15
    travel: float = 1.5
    travel_near_walls: float = 0.8
    feed: float = 0.3
    still_turns: float = 0.01
    still_moves: float = 0.01
    follow: float = 0.1
    bends: float = 1e-4
    evenness: float = 1e-4
    spare_turn: float = 0.005
    ridge: float = 1e-8
    planes: int = 14
    backtracks: int = 4


@dataclass(frozen=True)
class SpaceGuideSettings:
    """Of what leads the tip.

    Attributes:
        leash: how far the target may be ahead of the tip [u].
        track_leash: the same where all joints are drawn onto the track of the tip [u].
        onto_track: weight on their distance from it.
        close_onto_track: the same where an arm got stuck on walls; links that are long beside the bends of a duct do
            with less (measured in pipes and slots with 8 and 12 links).
        advance: how far it moves on at a time [u].
        patience: steps without progress before a guide is given up.
        approach: length of the straight end of a path along the wanted direction [u].
        settle_steps: most steps from the end of a path onto the goal.
        settle_growth: by how much the weight of the goal grows from step to step.
        polish: from how near Newton's method puts the arm onto the goal [u].
        polish_turn: the same of the direction [rad].
        polish_steps: most steps of it.
        pose_step: how far the target moves on at a time on its way to a pose, in unknowns.
        exact: distance at which the arm counts as on the goal, as a share of the arm's length, and turn [rad].
    """

    leash: float = 1.5
    track_leash: float = 1.0
    onto_track: float = 0.1
    close_onto_track: float = 3.0
    advance: float = 0.4
    patience: int = 60
    approach: float = 3.0
    settle_steps: int = 60
    settle_growth: float = 0.5
    polish: float = 0.5
    polish_turn: float = 0.2
    polish_steps: int = 12
    pose_step: float = 0.15
    exact: float = 1e-9
