"""How the simulated arm differs from the one its controller believes in."""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.problem import Disturbances


def disturbed_arm(arm: DrivenArm, disturbances: Disturbances) -> DrivenArm:
    """The arm that is simulated: heavier links, more payload, more friction."""
    heavier = 1.0 + disturbances.mass_error
    return replace(
        arm,
        masses=heavier * arm.masses,
        inertia_axial=heavier * arm.inertia_axial,
        inertia_transverse=heavier * arm.inertia_transverse,
        payload=arm.payload + disturbances.payload,
        friction=np.asarray(arm.friction) + disturbances.friction,
    )


class Noise:
    """Normal noise on what is measured of the joints.

    Args:
        disturbances: its standard deviations and seed.
        planar: whether the arm stays in its plane; then only the bends are measured, so that it does stay there.
    """

    def __init__(self, disturbances: Disturbances, *, planar: bool) -> None:
        self._scale = np.array([[disturbances.angle_noise], [disturbances.velocity_noise]])
        self._random = np.random.default_rng(disturbances.seed)
        self._planar = planar

    def draw(self, count: int, joints: int) -> FloatArray:
        """Noise on angles [rad] and speeds [rad/s] of some steps, shape (count, 2, joints)."""
        if not np.any(self._scale):
            return np.zeros((count, 2, joints))
        noise = self._scale * self._random.standard_normal((count, 2, joints))
        if self._planar:
            # Drawn all the same, so that a seed gives the bends the same noise in the plane and out of it.
            noise[..., 0::3] = 0.0
            noise[..., 2::3] = 0.0
        return noise
