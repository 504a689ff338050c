"""Numbers of the growth of the path parameter along a motion."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ScheduleSettings:
    """Of how fast the path parameter grows along a motion under constraints that depend on it.

    Attributes:
        places: of the motion that are looked at; taste.
        steps: of the path parameter; taste.
        price: of a constraint that is missed by a turn of the whole arm of 1 rad, against uneven growth; taste.
        even: least growth of the one where the other grows alone, as a share; taste.
        lead: of the path parameter, by which planning keeps a constraint before and behind its interval; taste.
    """

    places: int = 101
    steps: int = 61
    price: float = 1e4
    even: float = 0.02
    lead: float = 0.04
