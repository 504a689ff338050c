"""Settings of how the ends of a motion are resolved."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EndSettings:
    """Numbers of the ends of a motion.

    Attributes:
        tolerance_share: share of the goal's tolerances that planning uses where the goal cannot be met exactly. Taste.
        precise_place: position tolerances up to this share of the arm's length say how exactly a place is to be met;
            wider ones make the goal a set. Taste.
        precise_turn: the same for heading tolerances [rad]. Taste: 2°, twice what is allowed by default.
        room_used: share of the tolerances of such a set that planning uses; the rest is left to rounding and smoothing.
            Taste.
        aim_share: share of the position tolerance by which planning may aim beside a goal that the tip cannot take.
            Taste.
        stretch: share of its length by which an arm is kept from full stretch where a goal out of reach is aimed at.
            Taste: there the tip cannot move along the arm.
        room_share: share of that tolerance that is left as room beside a wall that is too near to the goal. Taste.
        flush: a mount whose end is as near as this to its wall's clearance, as a share of the arm's length, stands
            flush on it. Taste.
        upright: sine of the angle between a flush mount and its wall's normal above which a turn of the base leaves
            the wall. Taste.
        reach: gaps that are looked at, as a share of the arm's length. Taste.
    """

    tolerance_share: float = 0.5
    precise_place: float = 5e-3
    precise_turn: float = 0.03490658503988659
    room_used: float = 0.95
    aim_share: float = 0.9
    stretch: float = 2e-3
    room_share: float = 0.05
    flush: float = 1e-5
    upright: float = 0.1
    reach: float = 0.02


DEFAULT_ENDS = EndSettings()
"""The numbers that are used unless others are given."""
