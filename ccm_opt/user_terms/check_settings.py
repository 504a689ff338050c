"""How exactly users' constraints are checked on the finished motion, and how much of their costs counts."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TermCheckSettings:
    """How users' constraints are checked on the finished motion.

    Attributes:
        tolerance: by which a hard constraint may be violated, in the unit of its expression. Taste: documented to
            users, and far above what planning leaves.
        rate: samples a second between the written ones at which the motion is checked [Hz]. Taste: documented to
            users.
        places_per_knot: places of the path to a knot, among which the path parameter of a pose is looked for. Taste:
            Newton's method does the rest.
        window: how many of these places, from the one of the sample before, are looked at. Derived: 40 knots, more
            than a motion passes between two samples.
        newton_steps: steps of Newton's method from the nearest place. Taste: three square an error of 1/16 knot to
            below rounding.
        bisections: times that the headings of the tip are halved in the proof that a constraint contradicts the goal.
            Taste: with 12 they are told apart to less than a degree.
    """

    tolerance: float = 1e-6
    rate: float = 1000.0
    places_per_knot: int = 16
    window: int = 40 * 16
    newton_steps: int = 3
    bisections: int = 12


TERM_CHECKS = TermCheckSettings()
"""Used where no other settings are given."""
COST_SHARES = (1.0, 0.1, 0.0)
"""Shares of the weights of users' costs with which a plan is sought in turn; the last is none of them. Taste."""
