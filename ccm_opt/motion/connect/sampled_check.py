"""The cheap check of many straight motions at once: poses along them, looked up in a raster, refute most that touch.

What it lets pass is not proved; that is left to the certificate.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ccm_opt.collision.segment_pairs import closest_on_segments, segments_cross
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.native import NativeCall
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.connect.blocked_raster import BlockedRaster
from ccm_opt.motion.settings.connect_settings import SamplingSettings

_BEYOND_REACH = 1.001
"""Half of the raster's side in arm lengths: rounding takes no place out of it."""


@dataclass(frozen=True)
class SampledCheck:
    """Looks at poses of one arm in one room.

    Attributes:
        arm: the arm.
        raster: of places where its axis is too near to a wall.
        reach: how far each place that is looked up lies along each link, shape (links, places) [m].
        spacing: how far the tip moves between two poses that are looked at [m].
        settings: numbers.
        parts: of a link between places that are looked up.
    """

    arm: Arm
    raster: BlockedRaster
    reach: npt.NDArray[np.float32]
    spacing: float
    settings: SamplingSettings
    parts: int

    @classmethod
    def of(cls, arm: Arm, workspace: Workspace, settings: SamplingSettings) -> "SampledCheck":
        """The check of an arm in a room."""
        gap = arm.radius + workspace.clearance
        raster = BlockedRaster.around(workspace, arm.base, _BEYOND_REACH * arm.length, gap, settings.cells)
        least = settings.least_spacing * arm.length
        parts = int(np.ceil(arm.link_length / max(settings.point_spacing * gap, least)))
        places = _places(arm, parts)
        # A place at arc length s takes the whole of every link before it and part of its own.
        before = arm.link_length * np.arange(arm.links)[:, None]
        reach = np.clip(places - before, 0.0, arm.link_length).astype(np.float32)
        spacing = max(settings.pose_spacing * gap, least)
        return cls(arm, raster, reach, spacing, settings, parts)

    def refuted(self, headings: FloatArray) -> BoolArray:
        """Which poses touch something for sure, link headings (m, links) [rad], result (m,)."""
        cosines = np.cos(headings).astype(np.float32)
        sines = np.sin(headings).astype(np.float32)
        x = cosines @ self.reach + np.float32(self.arm.base[0])
        y = sines @ self.reach + np.float32(self.arm.base[1])
        refuted = np.asarray(self.raster.at(x, y).any(axis=1))
        if self.arm.self_collision:
            left = np.flatnonzero(~refuted)
            refuted[left] = self._on_itself(headings[left])
        return refuted

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """How far straight motions come before a pose that is refuted, as shares of the whole.

        Args:
            start: link headings, shape (m, links) [rad]; poses that are not looked at again.
            end: likewise.

        Returns:
            Shape (m,); the last pose looked at that is not refuted, 1 for the end.
        """
        arm = self.arm
        raster = self.raster
        link, at = arm.mount_end
        if start.shape[1:] != (arm.links,) or end.shape != start.shape:
            raise ValueError(f"motions have the shapes {start.shape} and {end.shape}; expected (m, {arm.links})")
        shares = np.empty(len(start))
        NativeCall(
            "free_shares",
            links=arm.links, mount_link=link, mount_at=at, parts=self.parts, stride=self.settings.stride,
            first_self_pair=arm.first_self_pair if arm.self_collision else 0,
            link_length=arm.link_length, radius=arm.radius, base_x=arm.base[0], base_y=arm.base[1],
            side=raster.blocked.shape[0], cell=raster.cell, corner_x=raster.corner[0], corner_y=raster.corner[1],
            blocked=np.ascontiguousarray(raster.blocked, dtype=np.bool_), spacing=self.spacing,
            work=np.empty(8 * arm.links + 2), motions=len(start), start=start, end=end, share=shares,
        )()  # fmt: skip
        return shares

    def _on_itself(self, headings: FloatArray) -> BoolArray:
        """Which poses have distant links that meet, shape (m, links) to (m,)."""
        arm = self.arm
        points = arm.joint_positions(headings)
        first, second = arm.self_pairs
        middles = 0.5 * (points[:, :-1] + points[:, 1:])
        apart = middles[:, first] - middles[:, second]
        close = arm.link_length + 2.0 * arm.radius
        pose, pair = np.nonzero(np.einsum("mpd,mpd->mp", apart, apart) < close**2)

        i = first[pair]
        j = second[pair]
        ends = (points[pose, i], points[pose, i + 1], points[pose, j], points[pose, j + 1])
        _, _, gap = closest_on_segments(*ends)
        meeting = (np.hypot(gap[:, 0], gap[:, 1]) < 2.0 * arm.radius) | segments_cross(*ends)
        refuted = np.zeros(len(headings), dtype=bool)
        refuted[pose[meeting]] = True
        return refuted


def _places(arm: Arm, parts: int) -> FloatArray:
    """Arc lengths of the places that are looked up, beyond the mount, so many a link, shape (places,) [m]."""
    along = arm.link_length / parts * np.arange(arm.links * parts + 1)
    link, share = arm.mount_end
    mount = (link + share) * arm.link_length
    return np.append(mount, along[along > mount])
