"""How far from the proved motion an arm may be whose controller interpolates the samples by polynomials.

Proved is the motion whose coordinates are linear between samples. Controllers of robots make smooth curves of them: by
cubics through places and velocities, or by quintics through accelerations too. Whatever such a curve adds *along* the
straight piece is another time on the same way; what it adds across it is bounded here (``docs/theory.md``, theorem 10).
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import JointTrajectory

OF_CUBIC = 0.25
"""By how much a cubic answers to the greater of two errors of velocity: the greatest value of s (1 - s)."""
OF_VELOCITY = 0.2078
"""By how much a quintic answers to an error of velocity: the greatest of s - 6 s³ + 8 s⁴ - 3 s⁵, rounded up."""
OF_ACCELERATION = 0.0173
"""By how much it answers to an acceleration: the greatest of ½ s² (1 - s)³, rounded up."""


def interpolation_deviation(arm: Arm, trajectory: JointTrajectory) -> float:
    """A distance that no point of the arm passes on such a curve from where it is at some time of the proved motion.

    Args:
        arm: the arm.
        trajectory: the motion, at least two samples.

    Returns:
        The distance [m].
    """
    step = np.diff(trajectory.time)[:, None]
    velocities = _ways(arm, trajectory.velocities)
    accelerations = _ways(arm, trajectory.accelerations)
    way = np.diff(_ways(arm, trajectory.positions), axis=0)

    # By what the velocities at both ends differ from the mean of the step, and accelerations, as ways over the step.
    errors = [_Part.of(step * values - way, way) for values in (velocities[:-1], velocities[1:])]
    pulls = [_Part.of(step**2 * values, way) for values in (accelerations[:-1], accelerations[1:])]
    start = 1.0 + errors[0].along
    end = 1.0 + errors[1].along
    cubic_stays = _within([start / 3.0, 1.0 - end / 3.0])
    cubic = OF_CUBIC * np.maximum(*(error.size(cubic_stays) for error in errors))
    quintic_stays = _within(
        [
            start / 5.0,
            0.4 * start + pulls[0].along / 20.0,
            1.0 - 0.4 * end + pulls[1].along / 20.0,
            1.0 - end / 5.0,
        ]
    )
    quintic = OF_VELOCITY * (errors[0].size(quintic_stays) + errors[1].size(quintic_stays))
    quintic += OF_ACCELERATION * (pulls[0].size(quintic_stays) + pulls[1].size(quintic_stays))
    return float(np.max(np.maximum(cubic, quintic)))


@dataclass(frozen=True)
class _Part:
    """A change in every step, taken apart along the way of the step and across it, each array of shape (T - 1,).

    Attributes:
        along: how many times the way.
        across: sum over the coordinates of what is left [m].
        whole: sum over the coordinates of all of it [m].
    """

    along: FloatArray
    across: FloatArray
    whole: FloatArray

    @classmethod
    def of(cls, part: FloatArray, way: FloatArray) -> "_Part":
        """Take a change apart, shape (T - 1, c) [m]."""
        square = np.einsum("tc,tc->t", way, way)
        along = np.einsum("tc,tc->t", part, way) / np.where(square > 0.0, square, 1.0)
        across = np.sum(np.abs(part - along[:, None] * way), axis=1)
        return cls(along, across, np.sum(np.abs(part), axis=1))

    def size(self, stays: BoolArray) -> FloatArray:
        """What counts of it: all where the curve does not stay on its piece of the way."""
        return np.where(stays, self.across, self.whole)


def _ways(arm: Arm, values: FloatArray) -> FloatArray:
    """What turns of the links, and the axes of the base, move the tip by at most, shape (T, c) [m, or its rates]."""
    turns = arm.link_length * np.cumsum(values[:, : arm.links], axis=1)
    return np.concatenate((turns, values[:, arm.links :]), axis=1)


def _within(controls: list[FloatArray]) -> BoolArray:
    """Where all Bernstein coefficients of a curve's place on its piece lie on the piece, shape (T - 1,)."""
    return np.asarray(np.all([(control >= 0.0) & (control <= 1.0) for control in controls], axis=0))
