"""Certified motions, piecewise linear in the unknowns of a curve."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths, path_length
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import CurveUnknowns, Pose

_BENDING_FROM = (0.0, 0.5, 0.8)
"""Fractions of a motion at which its deformation to another end begins, tried in turn. Heuristic."""


def bending_shares(along: FloatArray) -> Iterator[FloatArray]:
    """Yield the shares of a change of its end by which a motion is deformed, which begin later and later.

    Args:
        along: places of the keyframes as fractions of the motion, shape (K,).
    """
    for beginning in _BENDING_FROM:
        share = np.clip((along - beginning) / (1.0 - beginning), 0.0, 1.0)
        yield share**2 * (3.0 - 2.0 * share)


CurveType = TypeVar("CurveType", bound=CurveUnknowns)
"""Type of the map from unknowns to configurations of a motion."""


@dataclass(frozen=True, eq=False)
class CurveMotion(Generic[CurveType]):
    """Certified motion whose unknowns are linear between K keyframes.

    Attributes:
        curve: map from the unknowns to configurations.
        unknowns: unknowns at the keyframes, shape (K, p).
        configurations: configurations at the keyframes, shape (K, c) [rad, m], with more between them where those of a
            fed arm are not linear.
        candidate: name of the candidate that found the motion.
        u: path parameters of the keyframes, increasing from 0 to 1, shape (K,); None if nothing depends on them.
        end_pose: configuration of the offered goal pose in which the motion ends, for the arm with which the motion was
            planned, shape (c,); None if it ends elsewhere.
        follows: whether a fed arm follows a leader's path during the whole motion.
        instead: control points of a certified path between the same ends, shape (K, c), if the motion itself is not
            certified; else None.
    """

    curve: CurveType
    unknowns: FloatArray
    configurations: FloatArray
    candidate: str
    u: FloatArray | None = None
    end_pose: FloatArray | None = None
    follows: bool = False
    instead: FloatArray | None = None

    @classmethod
    def from_poses(cls, curve: CurveType, poses: list[Pose], candidate: str) -> "CurveMotion[CurveType]":
        """Return the motion through given poses, named after a candidate."""
        return cls(curve, np.array([pose.v for pose in poses]), np.array([pose.q for pose in poses]), candidate)

    def without_blending(self, curve: CurveType) -> "CurveMotion[CurveType]":
        """Return the motion in a map with more unknowns, which blend into a goal pose and are set to 0 here."""
        return replace(self, curve=curve, unknowns=curve.extended(self.unknowns, self.curve))

    def through(self, unknowns: FloatArray) -> "CurveMotion[CurveType]":
        """Return a copy of the motion with other keyframes, given by unknowns (K, p)."""
        return replace(self, unknowns=unknowns, configurations=self.curve.configurations(unknowns))

    def backwards(self) -> "CurveMotion[CurveType]":
        """Return the motion from its end to its start; nothing in it may depend on the path parameter."""
        return replace(self, unknowns=self.unknowns[::-1].copy(), configurations=self.configurations[::-1].copy())

    def bent_to(self, end: FloatArray) -> Iterator["CurveMotion[CurveType]"]:
        """Yield versions of the motion deformed to another end, by a change that grows smoothly along the motion.

        From version to version, the change starts later along the motion.

        Args:
            end: unknowns of the other end, shape (p,).
        """
        change = end - self.unknowns[-1]
        for share in bending_shares(self.path_parameters):
            unknowns = self.unknowns + share[:, None] * change
            unknowns[-1] = end
            yield self.through(unknowns)

    def continued(self, poses: list[Pose]) -> "CurveMotion[CurveType]":
        """Return the motion with further poses appended as keyframes."""
        return replace(
            self,
            unknowns=np.vstack((self.unknowns, *(pose.v for pose in poses))),
            configurations=np.vstack((self.configurations, *(pose.q for pose in poses))),
            u=None,
        )

    @property
    def path_parameters(self) -> FloatArray:
        """Path parameters of the keyframes: those given, or else fractions of the length of the joint path, (K,)."""
        if self.u is not None:
            return self.u
        inserted = len(self.configurations) != len(self.unknowns)
        at_keyframes = self.curve.configurations(self.unknowns) if inserted else self.configurations
        arcs = arc_lengths(self.curve.drives(at_keyframes))
        shares: FloatArray = arcs / arcs[-1] if arcs[-1] > 0.0 else np.linspace(0.0, 1.0, len(arcs))
        return shares

    @property
    def busiest(self) -> float:
        """Sum over the intervals of the largest travel of any drive, a measure of the least duration of the motion."""
        return float(np.abs(np.diff(self.curve.drives(self.configurations), axis=0)).max(axis=1).sum())

    @property
    def travel(self) -> float:
        """Length of the motion's polyline in the space of the drive positions."""
        return path_length(self.curve.drives(self.configurations))


Motion: TypeAlias = CurveMotion[LinkSpace]
"""Certified motion of a planar arm."""
SpaceMotion: TypeAlias = CurveMotion[CurveMap]
"""Certified motion of an arm in space."""
