"""Settings of the members to which routes are led where the goal is a set."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GoalMemberSettings:
    """Numbers of the choice of members.

    Attributes:
        most: members that are chosen, but for one in every piece. Taste: each is worth routes of its own.
        pieces: pieces of the set that are looked at, the largest first. Taste.
        grid: places across the set, in both directions. Taste.
        turn_step: between headings that are looked at [rad], at most. Taste: 5°.
        turn_share: of the arm's length that a turn of one radian counts for. Taste.
        different: members that differ by less than this share of the arm's length count as one. Taste: a nominal link.
        edge: distance of places from the edge of free space, as a share of the set's radius. Taste.
        reach: share of its length to which the arm can be expected to stretch. Taste: at full stretch no step has a
            choice.
        runs: straight runs onto a member that are told apart, in nominal links. Taste.
        run_samples: places of a run that have to be free. Taste.
    """

    most: int = 5
    pieces: int = 4
    grid: int = 9
    turn_step: float = 0.08726646259971647
    turn_share: float = 0.1
    different: float = 0.04
    edge: float = 0.02
    reach: float = 0.99
    runs: tuple[float, ...] = (0.5, 1.0, 2.0)
    run_samples: int = 9
