"""The arm as OMPL sees it: a state is the bends, and what may be is decided by the certificate that judges our plans.

A straight motion of the bends turns every link evenly, which is what the certificate proves, for all times and not at
samples. So OMPL's planners are held to the same as ours, and ask for a motion what ours ask.
"""

from typing import Any

import numpy as np

from ccm_opt.collision.certificate import Certificate
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.ompl_peer.tip_goal_poses import stands_free


class OmplSpace:
    """Bends of an arm as a state space of OMPL.

    Args:
        base: the module ``ompl.base``.
        certificate: of poses and motions.
        start: bends at the start, shape (links,) [rad]; bounds hold them in any case.
        clamped: whether the base cannot turn.
    """

    def __init__(self, base: Any, certificate: Certificate, start: FloatArray, *, clamped: bool) -> None:
        self._arm = certificate.arm
        bounds = base.RealVectorBounds(self._arm.links)
        reach = np.maximum(self._arm.bend_limits, np.abs(start))
        low = -reach
        high = reach.copy()
        if clamped:
            low[0] = start[0]
            high[0] = start[0]
        for joint in range(self._arm.links):
            bounds.setLow(joint, float(low[joint]))
            bounds.setHigh(joint, float(high[joint]))
        space = base.RealVectorStateSpace(self._arm.links)
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.information.setStateValidityChecker(_validity(self._arm, certificate))
        self.information.setMotionValidator(_motions(base, self.information, self._arm, certificate))
        self.information.setup()

    def state(self, bends: FloatArray) -> Any:
        """A state of OMPL from bends, shape (links,) [rad]."""
        state = self.information.allocState()
        for joint, bend in enumerate(bends):
            state[joint] = float(bend)
        return state

    def bends(self, state: Any) -> FloatArray:
        """Bends of a state, shape (links,) [rad]."""
        return _bends(self._arm, state)


def _bends(arm: Arm, state: Any) -> FloatArray:
    return np.array([state[joint] for joint in range(arm.links)])


def _validity(arm: Arm, certificate: Certificate) -> Any:
    """Whether a pose touches nothing; bends within the bounds are OMPL's own business."""
    return lambda state: stands_free(certificate, arm.headings(_bends(arm, state)))


def _motions(base: Any, information: Any, arm: Arm, certificate: Certificate) -> Any:
    """OMPL's interface for motions between two states; the class is made here, for OMPL may not be installed."""

    class CertifiedMotions(base.MotionValidator):  # type: ignore[misc]
        """Motions that the certificate proves free of contact."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Whether the straight motion from a state to another touches nothing."""
            pair = np.stack((arm.headings(_bends(arm, one)), arm.headings(_bends(arm, other))))
            return len(certificate.failures(pair)) == 0

    return CertifiedMotions(information)
