"""The cheap check of many straight motions at once: poses along them, looked up in a raster, refute most that touch.

What it lets pass is not proved; that is left to the certificate.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ccm_opt.collision.neighbour_pairs import closest_on_segments, segments_cross
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.connect.blocked_raster import BlockedRaster
from ccm_opt.motion.connect.compiled_shares import CompiledShares, compiled_shares
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
        compiled: does the same for whole motions, several times faster; None where there is no compiling.
    """

    arm: Arm
    raster: BlockedRaster
    reach: npt.NDArray[np.float32]
    spacing: float
    settings: SamplingSettings
    compiled: CompiledShares | None = None

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
        compiled = compiled_shares(arm, raster, parts, spacing, settings.stride)
        return cls(arm, raster, reach, spacing, settings, compiled)

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
        if self.compiled is not None:
            return self.compiled.free_shares(start, end)
        travel = self.arm.link_length * np.abs(end - start).sum(axis=1)
        count = np.maximum(1, np.ceil(travel / self.spacing)).astype(np.intp)
        # One beyond the last pose stands for none that is refuted.
        first = count + 1
        stride = self.settings.stride
        motion, k = _steps(count)
        early = (k % stride == 0) | (k == count[motion])
        self._look(start, end, count, motion[early], k[early], first)
        # Then only what lies before the first pose that was refuted.
        late = ~early & (k < first[motion])
        self._look(start, end, count, motion[late], k[late], first)
        shares: FloatArray = (first - 1) / count
        return shares

    def _look(
        self, start: FloatArray, end: FloatArray, count: IntArray, motion: IntArray, k: IntArray, first: IntArray
    ) -> None:
        """Lower ``first`` of every motion to the first of some of its poses that is refuted."""
        chunk = self.settings.chunk
        for begin in range(0, len(motion), chunk):
            part = motion[begin : begin + chunk]
            step = k[begin : begin + chunk]
            share = (step / count[part])[:, None]
            bad = self.refuted(start[part] + share * (end[part] - start[part]))
            np.minimum.at(first, part[bad], step[bad])

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


def _steps(count: IntArray) -> tuple[IntArray, IntArray]:
    """Numbers 1 to count of several things, one after the other: which thing, and the number."""
    thing = np.repeat(np.arange(len(count)), count)
    number = np.arange(1, len(thing) + 1) - np.repeat(np.cumsum(count) - count, count)
    return thing, number
