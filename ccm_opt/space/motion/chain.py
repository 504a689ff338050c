"""Places and rotations of the links and their derivatives by some unknowns, by C where there is a compiler."""

import ctypes
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import pointer_to
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.motion.arm_library import arm_library


class _ChainStruct(ctypes.Structure):
    """``ChainQuery`` of arm_motion.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("links", "unknowns", "fed")),
        ("length", ctypes.c_double),
        *(
            (name, ctypes.c_void_p)
            for name in ("start", "base", "q", "slopes", "points", "rotations", "turning", "moving")
        ),
    )


@dataclass(frozen=True)
class SpaceChain:
    """The links of an arm in a pose, with derivatives by p unknowns.

    Attributes:
        points: joints and tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3); the first column is the direction of the link.
        turning: Ω, angular velocities of the links for a unit of each unknown, shape (links, 3, p) [rad].
        moving: derivatives of the points, shape (links + 1, 3, p) [m].
    """

    points: FloatArray
    rotations: FloatArray
    turning: FloatArray
    moving: FloatArray

    @property
    def directions(self) -> FloatArray:
        """Unit vectors along the links, shape (links, 3)."""
        return self.rotations[:, :, 0]


class Chains:
    """Makes chains of an arm.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: SpaceArm) -> None:
        self._arm = arm
        self._library = arm_library()
        self._start = np.ascontiguousarray(arm.base, dtype=np.float64)
        self._base = np.ascontiguousarray(arm.base_rotation, dtype=np.float64)
        self._fed = len(arm.base_axes)

    def at(self, q: FloatArray, slopes: FloatArray) -> SpaceChain:
        """The chain of a configuration.

        Args:
            q: shape (c,) [rad, m].
            slopes: derivatives of it by the unknowns, shape (c, p).
        """
        arm = self._arm
        n = arm.links
        p = slopes.shape[1]
        if self._library is None:
            return self._interpreted(q, slopes)
        q = np.ascontiguousarray(q)
        slopes = np.ascontiguousarray(slopes)
        chain = SpaceChain(np.empty((n + 1, 3)), np.empty((n, 3, 3)), np.empty((n, 3, p)), np.empty((n + 1, 3, p)))
        struct = _ChainStruct(links=n, unknowns=p, fed=self._fed, length=arm.link_length)
        struct.start = self._start.ctypes.data
        struct.base = self._base.ctypes.data
        struct.q = q.ctypes.data
        struct.slopes = slopes.ctypes.data
        for name in ("points", "rotations", "turning", "moving"):
            setattr(struct, name, getattr(chain, name).ctypes.data)
        self._library.chain(pointer_to(struct))
        return chain

    def places(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Joints and tip, shape (links + 1, 3) [m], and rotations of the links, (links, 3, 3), without derivatives."""
        chain = self.at(q, np.empty((len(q), 0)))
        return chain.points, chain.rotations

    def _interpreted(self, q: FloatArray, slopes: FloatArray) -> SpaceChain:
        arm = self._arm
        n = arm.links
        p = slopes.shape[1]
        points = np.zeros((n + 1, 3))
        rotations = np.zeros((n, 3, 3))
        turning = np.zeros((n, 3, p))
        moving = np.zeros((n + 1, 3, p))
        points[0] = self._start
        if self._fed:
            points[0] += self._base[:, 0] * q[2 * n]
            moving[0] = np.outer(self._base[:, 0], slopes[2 * n])
        before = self._base
        turned = np.zeros((3, p))
        for j in range(n):
            a = q[2 * j]
            b = q[2 * j + 1]
            about_z = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
            about_y = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
            after = before @ about_z @ about_y
            turned = turned + np.outer(before[:, 2], slopes[2 * j]) + np.outer(after[:, 1], slopes[2 * j + 1])
            rotations[j] = after
            turning[j] = turned
            step = arm.link_length * after[:, 0]
            points[j + 1] = points[j] + step
            moving[j + 1] = moving[j] + np.cross(turned, step[:, None], axisa=0, axisb=0, axisc=0)
            before = after
        return SpaceChain(points, rotations, turning, moving)
