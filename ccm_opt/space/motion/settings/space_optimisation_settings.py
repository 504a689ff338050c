"""Numbers of the optimisation of a motion, and weights of what it makes small.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceObjectiveSettings:
    """Weights of what the optimisation makes small.

    Attributes:
        unevenness: of ``∫|q''|²``; its root is the share of the motion over which corners are rounded.
        shape: of the curve's curvature and of its differences, as bends of a nominal link.
        following: of changes of the curve on which a fed arm lies, as bends of a nominal link; an arm whose curve does
            not change follows its tip. Measured on the disturbed jobs: a hundredth of their duration for half of the
            worst deviation.
        ridge: on all unknowns, so that the metric is definite.
    """

    unevenness: float = 4e-3
    following: float = 25.0
    shape: float = 1e-3
    ridge: float = 1e-7


@dataclass(frozen=True)
class SpaceOptimisationSettings:
    """Of the optimisation of a motion.

    Attributes:
        intervals: least number of intervals; a motion that needs more edges to be certified keeps them.
        many: intervals that are many, as a multiple of that.
        finer_lack: a motion that lacks more than this share of the wanted gap is made again of more keyframes; in pipes
            and wing boxes with few links seven in ten of those come out with all the room that there is.
        finer_intervals: least number of intervals then.
        finer_price: first price of slack then.
        leg_depth: how often an edge of the thinned motion may be halved by its certificate.
        first_stride: keyframes that an edge skips at first.
        rounds: most steps.
        first_rounds: steps at many keyframes, before the motion is thinned again.
        margin: gap that rows ask for beyond contact [u].
        active: rows nearer to their bound than this enter the program [u].
        most_travel: of the way of a joint over an interval that rows reach for [u].
        between: shares of an interval at which links that lack room have rows too.
        planes: most half-spaces about a link.
        behind: by how much surfaces may stand out from one of them without getting one of their own [u].
        groups: arms with more links than this have rows for groups of neighbouring joints.
        pair_share: of what links between two leave at full stretch that these are asked to keep apart.
        price: first price of one nominal link of slack, and what it lacks in room counts in a motion's merit.
        price_rise: its rise where the certificate fails.
        lack: share of the wanted gap that an interval may lack without its slack becoming dearer.
        lack_rise: rise of the price where it lacks more.
        highest_price: to which it rises.
        first_damping: weight on the squared turns of the first step.
        raised_damping: damping from which a refused step raises it.
        refused_growth: growth of the damping after a refused step.
        shortened_growth: its growth after a shortened step.
        good_shrinkage: its fall after a good step.
        least_damping: least damping.
        damping_ridge: damping of unknowns beside that of the turns.
        shortenings: shares of a step that are tried until one is certified.
        sufficient: share of the foreseen gain at which a step is taken.
        good: share of the foreseen gain from which a step is good.
        worth: share of the merit that a round has to gain.
        patience: rounds in a row that may gain less.
        patience_in_want: the same of a motion that lacks room.
        tries: programs of one round before it is given up.
        near_limit: coordinates nearer to their limit than this are limited in the program [rad, m].
        spare_turn: of the limits that rows leave [rad, m].
        knot_bend: bound on the bend by the curvature at a knot of a fed arm, as a multiple of the joint limit; a joint
            takes the mean about its place, which is less.
        slack_curvature: curvature of slack, so that the Hessian is definite.
        tolerance: of the program's solution.
        iterations: of the program.
        passing: how near the tip stays to the places that it passes, as a share of what counts as passing.
    """

    intervals: int = 24
    many: float = 1.2
    finer_lack: float = 0.15
    finer_intervals: int = 32
    finer_price: float = 400.0
    leg_depth: int = 4
    first_stride: int = 8
    rounds: int = 24
    first_rounds: int = 2
    margin: float = 0.02
    active: float = 0.3
    most_travel: float = 0.75
    between: tuple[float, ...] = (0.25, 0.75)
    planes: int = 6
    behind: float = 0.06
    groups: int = 24
    pair_share: float = 0.25
    price: float = 100.0
    price_rise: float = 4.0
    lack: float = 0.03
    lack_rise: float = 2.0
    highest_price: float = 500.0
    first_damping: float = 0.3
    raised_damping: float = 0.05
    refused_growth: float = 6.0
    shortened_growth: float = 2.0
    good_shrinkage: float = 3.0
    least_damping: float = 1e-4
    damping_ridge: float = 1e-3
    shortenings: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)
    sufficient: float = 0.1
    good: float = 0.6
    worth: float = 0.02
    patience: int = 1
    patience_in_want: int = 3
    tries: int = 6
    near_limit: float = 0.3
    spare_turn: float = 0.004
    knot_bend: float = 1.1
    slack_curvature: float = 1e-6
    tolerance: float = 1e-5
    iterations: int = 60
    passing: float = 0.5
