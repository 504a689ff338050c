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
        iterations: most iterations of the NLP; where it succeeds it takes some fifteen.
        enough: share of the wanted gap that its pose has to have for the end to be settled.
        opening: gap that steps at the goal make room for before the NLP is asked, as a multiple of the wanted one; a
            little more, so that the planes of the NLP leave all that is wanted (taste).
        opening_steps: most of these; five bring nearly all that there is.
        opening_weight: of the goal in them, beside the pull of walls that are too near.
        opened: they end when no joint moves farther than this [u].
    """

    iterations: int = 25
    enough: float = 0.9
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
    """

    extension: float = 2.0
    draws: int = 8000
    rounds: int = 4
    goals: int = 8
