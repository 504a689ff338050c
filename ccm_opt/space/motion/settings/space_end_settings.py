"""Numbers of poses at the goal and of the sampler that joins them; turns and edges are in radians."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GoalPoseSettings:
    """Of poses at the goal by drawn curves.

    Attributes:
        draws: at most so many.
        steps: of each towards the goal.
        polish_turn: largest turn of a link in a step of Newton's method onto the goal [rad].
        wanted: poses that are moved to in turn before the sampler is tried.
    """

    draws: int = 200
    steps: int = 40
    polish_turn: float = 0.3
    wanted: int = 8


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
        opening: gap that steps at the goal make room for before the NLP is asked, as a multiple of the wanted one; a
            little more, so that the planes of the NLP leave all that is wanted (taste).
        opening_steps: most of these; five bring nearly all that there is.
        opening_weight: of the goal in them, beside the pull of walls that are too near.
        opened: they end when no joint moves farther than this [u].
    """

    iterations: int = 100
    enough: float = 0.9
    room_share: float = 1.6
    bending_from: tuple[float, ...] = (0.0, 0.5, 0.8)
    opening: float = 1.05
    opening_steps: int = 20
    opening_weight: float = 10.0
    opened: float = 0.02


@dataclass(frozen=True)
class SpaceConnectSettings:
    """Of the sampler, RRT-Connect in the unknowns of the curve.

    Attributes:
        extension: longest edge, in the norm of turns of the links [rad].
        draws: of targets, at most, each time that it begins.
        rounds: how often it begins with other draws and poses, as long as there is time; the first half of them before
            the finest grid is searched. Measured among 320 bodies.
        goals: poses at the goal that the second tree grows from.
        base_share: share of the draws in which the base alone is turned anywhere, and the curve is that between the
            start and a goal.
    """

    extension: float = 2.0
    draws: int = 8000
    rounds: int = 4
    goals: int = 8
    base_share: float = 0.0
