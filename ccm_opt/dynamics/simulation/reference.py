"""A sampled motion as reference for a controller that works in steps, and back."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class StepReference:
    """Joint reference on a grid of equal steps.

    Angles follow the cubic Hermite polynomial of the samples' angles and velocities, velocities its derivative; the
    acceleration of a step is the mean over it, which is what a control held over the step can follow.

    Attributes:
        angles: cubic Hermite spline of the angles of the joints that move.
        velocities: its derivative.
        moving: numbers of the joints that move, shape (M,); all others stand at zero.
        joints: number of all joints.
        step: [s].
        steps: number of steps that cover the motion.
    """

    angles: CubicHermiteSpline
    velocities: CubicHermiteSpline
    moving: IntArray
    joints: int
    step: float
    steps: int

    def window(self, first: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Reference of ``count`` steps from step ``first`` on.

        Returns:
            Angles, velocities and accelerations at the start of each step, shape (count, 3, joints), and the angles at
            the end of each step, shape (count, joints). Steps past the end hold the last pose.
        """
        # The last step may reach past the end of the motion, where the splines would run on.
        end = float(self.angles.x[-1])
        times = np.minimum(np.arange(first, first + count + 1) * self.step, end)
        angles = self.angles(times)
        velocities = self.velocities(times)
        accelerations = np.diff(velocities, axis=0) / self.step  # means over the steps: see the class
        reference = np.zeros((count, 3, self.joints))
        ends = np.zeros((count, self.joints))
        for k, values in enumerate((angles[:-1], velocities[:-1], accelerations)):
            reference[:, k, self.moving] = values
        ends[:, self.moving] = angles[1:]
        return reference, ends


def step_reference(time: FloatArray, angles: FloatArray, velocities: FloatArray, step: float) -> StepReference:
    """Reference of a sampled motion.

    Args:
        time: strictly increasing from 0, shape (T,) [s].
        angles: shape (T, joints) [rad].
        velocities: shape (T, joints) [rad/s].
        step: [s].
    """
    steps = max(1, int(np.ceil(time[-1] / step - 1e-9)))  # a last sample that rounding puts past a step needs no more
    # In the plane two of three revolutes never move.
    moving = np.flatnonzero(np.any(angles != 0.0, axis=0) | np.any(velocities != 0.0, axis=0))
    spline = CubicHermiteSpline(time, angles[:, moving], velocities[:, moving])
    return StepReference(spline, spline.derivative(), moving, angles.shape[1], step, steps)


def hermite(fraction: FloatArray, step: float, start: FloatArray, end: FloatArray) -> FloatArray:
    """Angles inside steps from angles and velocities at both ends of each.

    Args:
        fraction: place inside the step in [0, 1], shape (N,).
        step: length of a step [s].
        start: angles and velocities at the start of each step, shape (N, 2, joints).
        end: likewise at the end.

    Returns:
        Angles, shape (N, joints) [rad].
    """
    q0 = start[:, 0]
    v0 = start[:, 1]
    q1 = end[:, 0]
    v1 = end[:, 1]
    u = fraction[:, None]
    # The cubic Hermite basis: (3 − 2u) u² for the rise, u (1 − u)² and −u² (1 − u) for the slopes.
    rise = u * u * (3.0 - 2.0 * u)
    drop = 1.0 - u
    return q0 + rise * (q1 - q0) + step * u * drop * (drop * v0 - u * v1)
