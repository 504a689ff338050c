"""From keyframes of bends and feed to a certified smooth path of both."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.collision.certificate import Certificate, allowed_contact
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.spline_path import certified_spline, spare_kept
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, FollowingSettings
from ccm_opt.planners.following.gating import straight_while_held


@dataclass(frozen=True)
class FeedMotions:
    """What makes a motion of the arm on its feed axis safe.

    Attributes:
        arm: with a feed axis.
        workspace: walls and boundary.
        travel: of the base between two samples of a trajectory [m].
        gap: of the narrower end of the motion [m]; the certificate spares half of it at most, and lets motions touch
            as an end that touches does.
        settings: of following.
    """

    arm: Arm
    workspace: Workspace
    travel: float
    gap: float = np.inf
    settings: FollowingSettings = DEFAULT_FOLLOWING

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate that motions must pass."""
        # Ends that touch may be left by motions that touch no deeper; else a little more than contact is asked for.
        contact = allowed_contact(self.arm, self.workspace)
        wanted = self.settings.spare_at_ends * self.gap - contact
        spare = np.clip(wanted, -contact, self.settings.spare * self.arm.length)
        return Certificate(self.arm, self.workspace, float(spare))

    def within_limits(self, keyframes: FloatArray) -> bool:
        """Whether keyframes keep joint limits and the range of the feed."""
        return bool(np.all((keyframes >= self.arm.lower_limits) & (keyframes <= self.arm.upper_limits)))

    def certified(self, keyframes: FloatArray) -> bool:
        """Whether keyframes of bends and feed, linear between them, are clear of everything."""
        return len(self.certificate.failures(self.arm.poses(keyframes))) == 0

    def path(self, keyframes: FloatArray) -> tuple[BSpline, float] | None:
        """The smooth path of bends and feed near keyframes, and the gap that it spares [m].

        Args:
            keyframes: bends and feed, shape (K, links + 1) [rad, m].

        Returns:
            None when no such path can be certified.
        """
        if not self.within_limits(keyframes):
            return None
        spline = certified_spline(self.arm.poses(keyframes), self.certificate, self.settings.smooth_path)
        if spline is None:
            return None
        # Bends and feed are linear in the poses, so the control points can be turned into them one by one.
        path = BSpline(spline.t, self.arm.configurations(np.asarray(spline.c)), spline.k)
        if not straight_while_held(self.arm, path, self.travel, self.settings):
            return None
        return path, spare_kept(spline, self.certificate, self.settings.smooth_path)
