"""What the search for a motion is asked, and what it finds."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.space_certificate import LinkMotion, SpaceCertificate
from ccm_opt.planning.space_continuation import SpaceTipPose
from ccm_opt.planning.space_pose import SpacePose
from ccm_opt.planning.space_settings import SpaceMotionSettings
from ccm_opt.planning.space_step import SpaceStepper
from ccm_opt.planning.space_user_limit import SpaceUserLimit
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.robot.space_kinematics import exposed_links, joint_positions
from ccm_opt.scene.distances.surface_tree import SurfaceTree


@dataclass(frozen=True, eq=False)
class SpaceTask:
    """One motion to be found.

    Attributes:
        arm: the arm.
        tree: of the surfaces of the scene.
        start: configuration at which it begins, shape (c,) [rad, m].
        goal: where the tip shall end; None where a whole pose is asked.
        goal_pose: configuration at which it shall end, shape (c,); None where the tip alone counts.
        via: places that the tip passes in this order, each of shape (3,) [m].
        via_reach: how near the tip has to come to pass them [m].
        clearance: gap that the user asks for beyond the arm's radius [m].
        wanted_gap: room beyond that which motions keep where there is so much [m].
        box: where the tip may go, lower and upper corner, shape (2, 3) [m].
        scene: extent of all surfaces, lower and upper corner, shape (2, 3) [m]; empty where there are none.
        names: of the owners of surfaces.
        slowness: how dear a unit of each coordinate is, by the speed that it allows, shape (c,); of bends about 1.
        deadline: when to stop.
        seed: of draws.
        refuse: raises where it is proved that there is no motion; it is asked when no way of the tip led to the goal.
        settings: numbers of the search.
        user: the user's constraints and costs; None where there are none.
    """

    arm: SpaceArm
    tree: SurfaceTree
    start: FloatArray
    goal: SpaceTipPose | None
    goal_pose: FloatArray | None
    via: tuple[FloatArray, ...]
    via_reach: float
    clearance: float
    wanted_gap: float
    box: FloatArray
    scene: FloatArray
    names: tuple[str, ...]
    slowness: FloatArray
    deadline: Deadline
    seed: int = 0
    refuse: Callable[[], None] | None = None
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    user: SpaceUserLimit | None = None

    @property
    def unit(self) -> float:
        """u, length of a nominal link [m]."""
        return self.arm.length / NOMINAL_LINKS

    def deadline_within(self, seconds: float) -> "SpaceTask":
        """The same task with a deadline after so much CPU time from now on, or its own if that is earlier."""
        return replace(self, deadline=self.deadline.within(seconds))

    @cached_property
    def certificate(self) -> SpaceCertificate:
        """Of the motion; it spares a little gap for what the path between samples may use."""
        gap = self.clearance + self.spare
        return SpaceCertificate(self.arm, self.tree, gap, self.spare, self.settings.certificate, self.user)

    @cached_property
    def spare(self) -> float:
        """Gap that is proved beyond the clearance: as asked, or half of what there is where the motion ends [m]."""
        most = self.settings.certificate.spare * self.unit
        ends = (self.start,) if self.goal_pose is None else (self.start, self.goal_pose)
        room = min(self._room(q, 2.0 * most) for q in ends)
        return most if room >= most else max(0.5 * room, self.least_spare)

    @property
    def least_spare(self) -> float:
        """No smaller gap is proved [m]."""
        return self.settings.certificate.least_spare * self.unit

    def _room(self, q: FloatArray, most: float) -> float:
        """Least gap of a configuration beyond the clearance, or between its links, up to so much [m]."""
        arm = self.arm
        points = joint_positions(arm, q)
        _, axes = exposed_links(arm, points)
        kept = arm.radius + self.clearance
        room = float(np.min(self.tree.distances(axes, kept + most), initial=kept + most)) - kept
        if arm.self_collision:
            nearest = LinkMotion(arm).nearest_pairs(points[None], 2.0 * arm.radius + most)
            room = min(room, float(nearest.distance[0]) - 2.0 * arm.radius)
        return room

    @cached_property
    def margin(self) -> float:
        """Gap that steps keep beyond the clearance [m]."""
        return self.settings.step.margin * self.unit

    def stepper(self, curve: CurveMap, share: float = 1.0) -> SpaceStepper:
        """Takes steps in the unknowns of a curve, with a share of the margin."""
        return SpaceStepper(curve, self.tree, self.certificate, share * self.margin, self.settings, self.user)


@dataclass(frozen=True, eq=False)
class SpaceMotion:
    """A certified motion, linear in its configurations between keyframes.

    Attributes:
        curve: the map that its unknowns belong to.
        unknowns: at the keyframes, shape (K, p).
        configurations: the same as configurations, shape (K, c) [rad, m].
        candidate: name of the tactic that found it.
        u: path parameters of the keyframes, increasing from 0 to 1, shape (K,); None where any will do.
    """

    curve: CurveMap
    unknowns: FloatArray
    configurations: FloatArray
    candidate: str
    u: FloatArray | None = None

    @classmethod
    def of(cls, curve: CurveMap, poses: list[SpacePose], candidate: str) -> "SpaceMotion":
        """The motion through poses."""
        unknowns = np.stack([pose.v for pose in poses])
        return cls(curve, unknowns, np.stack([pose.q for pose in poses]), candidate)
