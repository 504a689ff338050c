"""Clearance of an arm in space from every surface at all times, and that it starts outside of all solids."""

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.scene.scene import SpaceWorkspace
from ccm_opt.solution import Check, NearPlace
from ccm_opt.verification.bisection import Nearest, Verdict, least_allowed_gap
from ccm_opt.verification.body_sides import depth_enclosed, separations
from ccm_opt.verification.rounding import distance_rounding
from ccm_opt.verification.space_chain_motion import SpaceChainMotion, TimeStretches
from ccm_opt.verification.space_contact import CheckedSurfaces
from ccm_opt.verification.stretch_proof import (
    DEFAULT_SPACE_PROOF,
    Measured,
    SpaceProofSettings,
    StretchPairs,
    prove_stretches,
)
from ccm_opt.verification.verification_settings import VerificationSettings
from ccm_opt.verification.wall_clearance import gap_beyond, touch_beside_mount


def check_surfaces(
    motion: SpaceChainMotion,
    workspace: SpaceWorkspace,
    settings: VerificationSettings,
    proof: SpaceProofSettings = DEFAULT_SPACE_PROOF,
) -> Check:
    """Check that the arm beyond its mount keeps the clearance from every surface at all times."""
    exposed = exposed_shares(motion.arm)
    if len(workspace.soup) == 0 or not np.any(exposed < 1.0):
        why = "there is no wall" if len(workspace.soup) == 0 else "the whole arm counts as its mount"
        return Check("wall clearance", np.inf, workspace.clearance, "m", why, passed=True)
    surfaces = CheckedSurfaces.of(workspace.soup)
    least = least_allowed_gap(workspace.clearance, motion.arm.radius, settings)
    verdict = SurfaceProof(motion, surfaces, exposed).prove(least, settings, proof)
    near = verdict.nearest
    names = np.array(workspace.soup.names)[surfaces.owner]
    wall = str(names[near.other - surfaces.offsets[-2]])
    where = f"link {near.link + 1} to {wall!r} at t = {near.time:.4f} s"
    remark = verdict.remark or touch_beside_mount(motion.arm, near.link, near.gap)
    exposed[: near.link + 1] = 1.0
    if not verdict.remark and remark and np.any(exposed < 1.0):
        beyond = SurfaceProof(motion, surfaces, exposed).prove(least, settings, proof).nearest
        remark += gap_beyond(beyond.gap, str(names[beyond.other - surfaces.offsets[-2]]))
    where = f"{where}: {remark}" if remark else where
    place = NearPlace(near.gap - workspace.clearance, 0.0, near.time, near.link + 1, obstacle=wall)
    return Check("wall clearance", near.gap, workspace.clearance, "m", where, passed=verdict.proved, place=place)


def exposed_shares(arm: SpaceArm) -> FloatArray:
    """Share of each link that belongs to the mount and may touch walls, shape (links,); 1 for a whole link."""
    return np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)


class SurfaceProof:
    """Proves that links keep a gap to the surfaces of a scene, by measuring them against boxes of these.

    Args:
        motion: of the arm.
        surfaces: of the scene.
        exposed: share of each link that may touch walls.
    """

    def __init__(self, motion: SpaceChainMotion, surfaces: CheckedSurfaces, exposed: FloatArray) -> None:
        self.motion = motion
        self.surfaces = surfaces
        self._exposed = exposed
        size = max(float(np.max(np.abs(surfaces.triangles))), float(np.max(np.abs(motion.points))))
        self._lost = motion.rounding + distance_rounding(size)

    def prove(self, least: float, settings: VerificationSettings, proof: SpaceProofSettings) -> Verdict:
        """Prove that all links keep a gap."""
        samples = len(self.motion.time)
        few = np.unique(np.linspace(0, samples - 1, proof.probes).astype(int)).astype(np.float64)
        # At a few moments the nearest surface is looked for alone, to know how far the search must look.
        moments = self._of_all_links(TimeStretches(few, few), least, settings, None)
        if moments.nearest.gap < least:
            return moments
        blocks = TimeStretches.blocks(samples, proof.block)
        return self._of_all_links(blocks, least, settings, moments.nearest)

    def _of_all_links(
        self, stretches: TimeStretches, least: float, settings: VerificationSettings, nearest: Nearest | None
    ) -> Verdict:
        links = np.flatnonzero(self._exposed < 1.0)
        stretch = np.repeat(np.arange(len(stretches)), len(links))
        link = np.tile(links, len(stretches))
        pairs = StretchPairs(stretch, link, np.zeros(len(link), dtype=np.intp))
        return prove_stretches(self.motion, stretches, pairs, self.measure, least, settings, self._opened, nearest)

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: StretchPairs, cutoff: FloatArray | float
    ) -> Measured:
        """What is known of the gaps of pairs; beyond the cutoff, one number or of shape (P,) [m], not exactly."""
        travels = self.motion.travels(stretches).ravel()
        points = poses.reshape(-1, 3)
        joint = pairs.stretch * poses.shape[1] + pairs.link
        travel = np.maximum(travels.take(joint), travels.take(joint + 1))
        end = points.take(joint + 1, axis=0)
        start = points.take(joint, axis=0)
        start += self._exposed.take(pairs.link)[:, None] * (end - start)
        low, high = self.surfaces.bounds(pairs.other, start, end)
        thick = self.motion.arm.radius + self.surfaces.rounding.take(pairs.other)
        off = self.motion.off(stretches, pairs.stretch, pairs.link)
        # Triangles whose boxes are far enough need not be measured.
        exact = self.surfaces.is_triangle(pairs.other) & (low - thick - self._lost - off - travel < cutoff)
        triangles = self.surfaces.triangles[pairs.other[exact] - self.surfaces.offsets[-2]]
        low[exact], high[exact] = separations(start[exact], end[exact], triangles)
        # A box may hold triangles of less rounding than the largest, which are farther.
        most = high - np.where(exact, thick, self.motion.arm.radius)
        return Measured(low - thick - self._lost - off, most, travel, exact)

    def _opened(self, pairs: StretchPairs, travel: FloatArray) -> tuple[StretchPairs, BoolArray]:
        surfaces = self.surfaces
        boxes = ~surfaces.is_triangle(pairs.other)
        size = surfaces.size(pairs.other)
        boxes &= (size > travel) | (size == 0.0)
        place, child = surfaces.children(pairs.other[boxes])
        closed = pairs.where(boxes)
        return StretchPairs(closed.stretch[place], closed.link[place], child), boxes


def check_side(motion: SpaceChainMotion, workspace: SpaceWorkspace) -> Check:
    """Check that the arm lies inside the room and outside of all solid obstacles.

    One point decides: an arm that never meets a closed surface cannot change sides, neither along itself nor over time.
    """
    arm = motion.arm
    # The point where the mount ends: what lies before it may be inside a wall.
    k = min(int(arm.mount_length // arm.link_length), arm.links - 1)
    share = min(arm.mount_length / arm.link_length - k, 1.0)
    joints = motion.points[0]
    point = joints[k] + share * (joints[k + 1] - joints[k])
    depths = {each.name: depth_enclosed(each.body.triangles, point) for each in workspace.obstacles if each.body.solid}
    if workspace.bounds is not None:
        depths["room"] = float(np.max(np.concatenate((workspace.bounds[0] - point, point - workspace.bounds[1]))))
    worst = max(depths, key=lambda name: depths[name], default="")
    depth = max(depths.get(worst, 0.0), 0.0)
    side = f", on the wrong side of {worst!r}" if depth > 0.0 else ""
    return Check("free side", 0.0 - depth, 0.0, "m", f"link {k + 1} at t = 0{side}", passed=depth <= 0.0)
