"""The numbers of inverse kinematics in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TipNewtonSettings:
    """How an arm is brought to a place of its tip by damped Newton steps.

    Attributes:
        most_steps: Newton steps at most. Taste, five times what is usual.
        length_unit: share of the arm's length that counts as much as one radian of the tip's direction. Derived: a
            nominal link, of which there are 24.
        settled: error of the tip, in these units, at which it is there. Derived: what rounding leaves, ten times.
        most_turn: most that a bend changes in a step [rad]; keeps steps where their linear model means something.
            Taste.
        damping: first weight of the step's length against the squared error, as a share of that error. Taste.
        relaxed: factor on the damping after a step that came nearer. Taste, usual in Levenberg and Marquardt's method.
        stiffened: factor on it after one that did not. Likewise.
        most_damping: damping at which it gives up. Taste.
        inset: how far inside its limit a coordinate is stopped [rad, m]. Derived: twice what the quadratic program's
            solver may be off.
        at_limit: how far beyond a limit rounding may put a coordinate, which then counts as on it [rad, m]. Derived.
        singular: share added to the diagonal of the steps' equations, so that they can be solved where the tip cannot
            move one way. Derived: a thousand times rounding.
    """

    most_steps: int = 80
    length_unit: float = 1.0 / 24.0
    settled: float = 1e-11
    most_turn: float = 0.3
    damping: float = 1e-2
    relaxed: float = 0.2
    stiffened: float = 8.0
    most_damping: float = 1e8
    inset: float = 2e-6
    at_limit: float = 1e-12
    singular: float = 1e-13


DEFAULT_TIP_NEWTON = TipNewtonSettings()
"""The numbers of inverse kinematics unless others are passed."""
