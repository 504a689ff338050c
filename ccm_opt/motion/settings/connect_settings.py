"""Settings of RRT-Connect in the coordinates of the curve."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class SamplingSettings:
    """Numbers of the sampled check that rejects most motions before any is certified.

    Attributes:
        cells: of the raster along a side of the square that the arm reaches. Taste: 4 million cells fill in some
            hundredths of a second, and a cell is a thousandth of the reach.
        point_spacing: distance of the places that are looked up on the links, in distances that the axis has to keep.
            Derived: between places so near a corner can come no nearer than 94 % of that distance.
        pose_spacing: how far the tip moves between two poses that are looked at, in the same unit. Taste: what is
            missed between them the certificate sees.
        least_spacing: least value of both spacings, as a share of the arm's length. Taste: for thin arms.
        stride: every so many poses are looked at first. Taste: most motions that touch do so in a wide stretch.
    """

    cells: int = 2000
    point_spacing: float = 0.7
    pose_spacing: float = 0.75
    least_spacing: float = 0.005
    stride: int = 8


@dataclass(frozen=True)
class GoalDrawSettings:
    """Numbers of the poses at a goal for the tip that the tree at the goal begins with.

    Attributes:
        draws: random poses that Newton's method brings onto the goal, each time. Taste.
        steps: of Newton's method. Measured: what has not arrived by then seldom does.
        turn: most that a link turns in one of its steps [rad]. Taste.
        arrived: tip's distance [arm lengths] or turn [rad] that counts as arrived. Derived: well inside what the polish
            takes on.
        apart: root mean square of the turns of all links by which two poses at the goal differ at least [rad]. Taste.
    """

    draws: int = 64
    steps: int = 15
    turn: float = 0.5
    arrived: float = 1e-6
    apart: float = 0.1


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
        batch: targets that are drawn at once, at least and at most; the batch doubles from round to round. Taste: a
            plain scene is solved by a few extensions, a hard one by tens of thousands, which NumPy does together.
        range: longest extension of arms of few links, the mean turn of the links [rad]. Measured: on scenes of 4 to 8
            links half as much takes half as long again.
        smooth_range: the same for arms of more links. Measured on four hard scenes of 24 links among 30 polygons: 0.4
            solves them in 16 of 16 searches, by 1000 to 60 000 extensions each; 1.5 finds nothing in two of them by
            60 000.
        least: shortest extension that makes a node [rad]. Taste.
        bumped: share of targets that are poses of the tree with a part of the arm turned aside. Taste.
        attracted: share of targets that are poses of the other tree. Taste.
        winding: how far the base turns beyond its directions at the ends at most [rad]. Taste: a whole turn leaves both
            ways round.
        knots: curvature of a smooth target is linear between so many knots at most. Measured on the hardest of these
            scenes: 12 finds a way in 6 of 6 searches of 60 000 extensions, 9 in 5, at 6 they are half as long again.
        turning: most that a smooth target turns along the arm [rad]. Measured: past two posts 12 and 25 take 0.3 s, 5
            takes 5 s, for an arm that curls up gets out from behind them.
        bump_widths: least and greatest width of a turn aside, as shares of the arm's length. Taste.
        bump: standard deviation of a turn aside [rad]. Taste.
        goal_rounds: rounds between two searches for more poses at the goal. Taste.
        most_goals: poses at the goal that the tree may begin with. Taste.
        few_budgets: extensions that searches one after the other may take before all else, for arms of few links.
            Measured: most scenes take some thousand; what takes long is mostly found sooner from the beginning.
        whole_arm_budgets: the same for other arms with a goal for the whole arm, but for arms so thin that poses lie
            nearer to each other than these are wide. Taste: a quarter of a second.
        middle_budgets: the same once more after the candidates with the widest margin. Taste: three seconds.
        late_budgets: the same for all, before the trees of poses. Taste: some seconds.
        most_links: arms with more links are not planned so. Taste: a pose costs by the links.
        shortcuts: of shortening what is found, before it is optimised.
        turn: most that a link turns between two keyframes [rad]. Derived: that of a step of the continuation.
        sampling: of the sampled check.
        goals: of poses at a goal for the tip.
    """

    few_links: int = 10
    batch: tuple[int, int] = (4, 32)
    range: float = 1.5
    smooth_range: float = 0.4
    least: float = 0.01
    bumped: float = 0.2
    attracted: float = 0.1
    winding: float = 2.0 * np.pi
    knots: int = 12
    turning: float = 25.0
    bump_widths: tuple[float, float] = (0.05, 0.3)
    bump: float = 0.8
    goal_rounds: int = 10
    most_goals: int = 40
    few_budgets: tuple[int, ...] = (5000, 10000, 20000)
    whole_arm_budgets: tuple[int, ...] = (8000,)
    middle_budgets: tuple[int, ...] = (60000, 60000)
    late_budgets: tuple[int, ...] = (60000, 60000)
    most_links: int = 48
    shortcuts: ShortcutSettings = field(default_factory=ShortcutSettings)
    turn: float = 0.15
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    goals: GoalDrawSettings = field(default_factory=GoalDrawSettings)
