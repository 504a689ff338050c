"""Smooth paths of fed motions: beside the keyframes of an optimised motion, or of a proposed one as it is."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.nearest_curves import nearest_curves
from ccm_opt.motion.smooth_path import SmoothPath, smooth_path
from ccm_opt.motion.spline_path import certified_spline, spare_kept
from ccm_opt.planners.feed.even_spline import even_spline
from ccm_opt.planners.feed.path_time import path_time
from ccm_opt.planners.feed.proposed_motion import ProposedMotion
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.solution import JointPath


@dataclass(frozen=True)
class FedPaths:
    """Lays smooth paths along motions, and says how long they last.

    Attributes:
        query: what is asked.
        task: the same as a task of the optimisation, with all limits.
    """

    query: FeedQuery
    task: MotionTask

    def time(self, path: JointPath) -> float:
        """Least duration of a path [s]."""
        return self.spline_time(path.spline)

    def spline_time(self, spline: BSpline) -> float:
        """Least duration of a spline of bends and feed [s]."""
        query = self.query
        return path_time(query.arm, query.problem.limits, spline, query.settings.time_samples)

    def smooth(self, motion: Motion) -> JointPath | None:
        """The quickest smooth path along a motion of the optimisation."""
        arm = self.query.arm
        curves = nearest_curves(arm, motion.headings[:, : arm.links])
        keyframes = arm.configurations(motion.headings)
        paths = []
        for path in (self._even(motion), smooth_path(motion, self.task) or self._beside_keyframes(motion)):
            if path is not None:
                spline = BSpline(path.spline.t, arm.configurations(path.spline.c), path.spline.k)
                paths.append(JointPath(spline, keyframes, curves, motion.candidate, (), path.spare))
        return min(paths, key=self.time, default=None)

    def _even(self, motion: Motion) -> SmoothPath | None:
        """A path that is even where joints come out of the tube; none where it may not leave the keyframes."""
        if any(limit.shapes_path for limit in self.task.user_limits):
            return None
        settings = self.task.settings.smooth_path
        finer = self.query.settings.finer_samples
        certificate = self.task.certificate
        travel = self.query.motions.travel
        spline = even_spline(self.query.arm, motion.headings, travel, certificate, finer, settings)
        return None if spline is None else SmoothPath(spline, spare_kept(spline, certificate, settings))

    def _beside_keyframes(self, motion: Motion) -> SmoothPath | None:
        """A path beside the keyframes where it meets the user's equations all the same.

        A path through knots on equations swings a little everywhere, and so in the guide tube too; one beside keyframes
        is straight where they are, and meets what is linear in bends and feed.
        """
        if not any(limit.shapes_path for limit in self.task.user_limits):
            return None
        settings = self.task.settings.smooth_path
        spline = certified_spline(motion.headings, self.task.certificate, settings)
        if spline is None:
            return None
        u = np.linspace(0.0, 1.0, self.query.settings.room_samples)
        if any(limit.misses_path(spline(u), u).any() for limit in self.task.user_limits):
            return None
        return SmoothPath(spline, spare_kept(spline, self.task.certificate, settings))

    def plain(self, proposed: ProposedMotion) -> JointPath | None:
        """The path near the keyframes as they are."""
        certified = self.query.motions.path(proposed.keyframes)
        if certified is None:
            return None
        spline, spare = certified
        arm = self.query.arm
        curves = nearest_curves(arm, arm.headings(proposed.keyframes[:, : arm.links]))
        return JointPath(spline, proposed.keyframes, curves, proposed.name, proposed.leaders, spare)
