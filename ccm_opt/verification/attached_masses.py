"""The verifier's own model of the mass of what is fixed to links: four point masses for each rigid body.

Every rigid body moves like four equal point masses at the corners of a tetrahedron about its centre: with principal
second moments λ_i = ½ tr I − I_i along the unit vectors v_i, they lie at c + Σ_i s_i √(λ_i / m) v_i, whose signs s are
those of the corners of a cube with an even number of minus signs. ``robot.tool`` adds up moments of inertia instead,
for planning and timing.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import cross

_CORNERS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


@dataclass(frozen=True)
class PointMasses:
    """Point masses fixed to links, n in all.

    Attributes:
        link: index of the link of each, from 0, shape (n,).
        mass: mass of each, shape (n,) [kg].
        place: place of each in the frame of its link, from the link's distal end, shape (n, 3) [m].
    """

    link: IntArray
    mass: FloatArray
    place: FloatArray

    @classmethod
    def of(cls, arm: Arm) -> "PointMasses":
        """Return the point masses that stand for the bodies and the tool of an arm."""
        links: list[int] = []
        masses: list[float] = []
        places: list[FloatArray] = []
        for body in arm.rigid_bodies:
            if body.mass == 0.0:
                continue
            centre = np.zeros(arm.dimension) if body.centre is None else body.centre
            about = np.zeros((3, 3)) if body.inertia is None else body.inertia
            second, axes = np.linalg.eigh(0.5 * np.trace(about) * np.eye(3) - about)
            out = _CORNERS * np.sqrt(np.maximum(second, 0.0) / body.mass) @ axes.T
            # A planar frame (x, y) is x-z in space.
            links += [body.link % arm.links] * 4
            masses += [0.25 * body.mass] * 4
            places += list(out + (centre if len(centre) == 3 else np.array([centre[0], 0.0, centre[1]])))
        return cls(np.array(links, dtype=np.intp), np.array(masses), np.reshape(places, (-1, 3)))

    @property
    def reach(self) -> FloatArray:
        """Distance of each from the distal end of its link, shape (n,) [m]."""
        return np.asarray(np.sqrt(np.sum(self.place**2, axis=1)))

    def turned(self, along: FloatArray, left: FloatArray, across: FloatArray) -> FloatArray:
        """Return the vectors from the ends of the links to the masses, shape (T, n, 3) [m].

        Args:
            along: x axes of the links, shape (T, links, 3).
            left: y axes of the links, likewise.
            across: z axes of the links, likewise.
        """
        x, y, z = self.place.T[..., None]
        return np.asarray(x * along[:, self.link] + y * left[:, self.link] + z * across[:, self.link])

    def loads(
        self, out: FloatArray, rate: FloatArray, growth: FloatArray, ends: FloatArray, gravity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the forces on each link, and the moments about its distal end, that the masses require.

        Args:
            out: vectors from the ends of the links to the masses, as ``turned`` gives them, shape (T, n, 3) [m].
            rate: angular velocities of the links, shape (T, links, 3) [rad/s].
            growth: their derivatives, likewise [rad/s²].
            ends: accelerations of the distal ends of the links, likewise [m/s²].
            gravity: gravitational acceleration, shape (3,) [m/s²].

        Returns:
            Two arrays of shape (T, links, 3) [N, N m].
        """
        turning = rate[:, self.link]
        gain = ends[:, self.link] + cross(growth[:, self.link], out) + cross(turning, cross(turning, out))
        forces, moments = np.zeros((2, *rate.shape))
        each = self.mass[:, None] * (gain - gravity)
        # Several masses may be on one link, whose index comes first here.
        np.add.at(forces.swapaxes(0, 1), self.link, each.swapaxes(0, 1))
        np.add.at(moments.swapaxes(0, 1), self.link, cross(out, each).swapaxes(0, 1))
        return forces, moments


def all_masses(arm: Arm) -> FloatArray:
    """Return the masses of the links, the payload and the point masses fixed to links, shape (links + 1 + n,) [kg]."""
    return np.concatenate((arm.masses, [arm.payload], PointMasses.of(arm).mass))


def mass_links(arm: Arm) -> IntArray:
    """Return the index of the link of each of ``all_masses``; the payload counts as beyond the last link."""
    return np.concatenate((np.arange(arm.links + 1), PointMasses.of(arm).link))
