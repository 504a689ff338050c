"""Settings of the guide tube as a limit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GuideTubeSettings:
    """Numbers of the rows that keep straight what a guide tube holds.

    Attributes:
        reserve: how far beyond the hole, and what the base travels between two samples, planning lets joints bend, in
            link lengths; the smooth path beside the keyframes takes some of it. Taste.
        mixed: keyframes to either side that the smooth path mixes with one: a joint may bend at a keyframe where it is
            outside at all of these. Derived: four control points shape every span of a cubic spline, and where a span
            begins the first three.
        bend_share: share of its limit by which the bend of a joint may grow for every link length that it comes out
            in a step. Taste.
        tiny_bend: bends below this, of joints that should be straight, are the accuracy of a QP [rad]. Derived: its
            tolerance, ten times.
        rounding: of places along the arm, in link lengths. Derived: some thousand roundings of a place on a long axis.
        at_end: how near to an end of its range the base counts as there, in link lengths. Taste.
    """

    reserve: float = 0.1
    mixed: int = 2
    bend_share: float = 2.0
    tiny_bend: float = 1e-4
    rounding: float = 1e-9
    at_end: float = 1e-3
