"""Settings of the poses at a goal that bend every joint as far as it goes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LimitArcSettings:
    """Numbers of the arcs that reach a goal with their joints at their limits.

    Attributes:
        ample: share of the joints' limits with which guides get to a goal if an arc does. Measured: at 0.98, what steps
            use unless an end asks for more, guides do not reach in 13 s goals for which an arc needs 0.96 of them.
        places: joints at which the side to which an arc bends may change. Taste.
        most_turn: arcs that turn by more than this begin bent less, so that they do not coil up [rad]. Taste.
        heading_length: distance of the tip, in arm lengths, that counts as much as a radian of its heading when the
            arcs that come nearest to the goal are chosen. Taste.
        tried: arcs that Newton's method begins from. Taste.
        kept: poses at the goal that motions are looked for to. Taste.
        alike: poses of which no joint differs by more than this share of its limit are one. Taste.
        steps: of Newton's method. Taste.
        turn: most that a joint turns in one of them [rad]. Taste.
        releases: joints beyond their limits are held, and the step taken anew, up to so often. Taste.
        ridge: added to the diagonal of its equations, in squared arm lengths. Derived: some thousand roundings.
        arrived: error of the tip, in arm lengths or radians, that counts as none. Derived: far below what the
            optimisation asks of a motion's end.
    """

    ample: float = 0.9
    places: int = 24
    most_turn: float = 7.0
    heading_length: float = 0.25
    tried: int = 16
    kept: int = 4
    alike: float = 0.3
    steps: int = 30
    turn: float = 0.3
    releases: int = 8
    ridge: float = 1e-13
    arrived: float = 1e-11
