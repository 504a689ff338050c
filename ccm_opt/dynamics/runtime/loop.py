"""What a closed loop is, whoever runs it: compiled code or CasADi's virtual machine."""

from dataclasses import dataclass
from typing import Protocol

from ccm_opt.arrays import FloatArray


@dataclass(frozen=True)
class LoopSettings:
    """Numbers of a closed loop.

    Attributes:
        step: [s].
        computed: whether the law is computed torque, else PD.
        proportional: gain on joint errors.
        derivative: gain on joint speed errors.
        feed_proportional: the same for the feed axis.
        feed_derivative: the same for the feed axis.
        limit: bound on torques, shape (3 * links,) [N m].
        feed_limit: bound on the thrust of the feed axis [N].
    """

    step: float
    computed: bool
    proportional: float
    derivative: float
    feed_proportional: float
    feed_derivative: float
    limit: FloatArray
    feed_limit: float


class ClosedLoop(Protocol):
    """A plant under its controller; arrays end with the feed axis, W = 3 * links + 1, at rest when there is none."""

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Make some steps.

        Args:
            state: positions and velocities before the first step, shape (2, W).
            reference: positions, velocities and accelerations of every step, shape (N, 3, W).
            noise: added to what is measured of the joints' angles and speeds, shape (N, 2, W - 1).
            held: number of steps from the first on in which brakes hold the arm.

        Returns:
            States at the ends of the steps, shape (N, 2, W), and efforts held over them, shape (N, W).
        """
        ...
