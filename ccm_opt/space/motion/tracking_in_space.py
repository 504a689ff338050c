"""A motion bent to constraints that depend on how far it has come.

The path parameter u advances in small steps. At each the arm is drawn to a reference motion, which knows nothing of
these constraints, while those at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.errors import Diagnosis, MotionNotFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.settings.step_settings import TrackingSettings
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.pieces import edge_is_safe, pieces
from ccm_opt.space.motion.pose_led import PoseLed
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow, settle
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.space_user_limit import SpaceUserLimit
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask
from ccm_opt.space.motion.term_schedule import schedule


def tracked(task: SpaceTask, motion: SpaceMotion) -> SpaceMotion:
    """A motion under constraints that depend on u, near one that knows nothing of it.

    Args:
        task: with the constraints.
        motion: certified, to the same goal.

    Raises:
        MotionNotFound: naming the constraint that could not be met, and by how much it was missed.
    """
    if task.user is None or not task.user.terms.parametric:
        return motion
    u = schedule(motion, task.user, task.slowness, task.settings.schedule)
    if not task.user.terms.hard:
        return replace(motion, u=u)
    return _Tracking(task, task.user, motion, u).run()


@dataclass(eq=False)
class _Tracking:
    """One motion that is tracked.

    Args:
        task: with the constraints.
        user: the constraints.
        motion: the reference.
        of_motion: its path parameters, shape (K,).
    """

    task: SpaceTask
    user: SpaceUserLimit
    motion: SpaceMotion
    of_motion: FloatArray
    settings: TrackingSettings = field(default_factory=TrackingSettings)

    def run(self) -> SpaceMotion:
        """The tracked motion."""
        stepper = self.task.stepper(self.motion.curve)
        poses = [stepper.pose(self.motion.unknowns[0])]
        u = [0.0]
        advance = self.settings.first_advance
        while u[-1] < self.settings.arrival:
            to = self._next(u[-1], advance)
            there = replace(stepper, user=self.user.placed(to))
            further = self._advanced(there, to, poses[-1])
            if further is None:
                # Rows that move a little with u may be met where a large step of u outruns the arm.
                advance *= 0.5
                if advance < self.settings.least_advance or self.task.deadline.passed():
                    raise self._failed(there, poses[-1], to)
                continue
            u.extend(np.linspace(u[-1], to, len(further) + 1)[1:].tolist())
            poses.extend(further)
            advance = min(self.settings.largest_advance, self.settings.growth * advance)
        last = self._ended(stepper, poses[-1])
        u.extend(np.linspace(u[-1], 1.0, len(last) + 1)[1:].tolist())
        return self._motion([*poses, *last], np.array(u))

    def _next(self, u: float, advance: float) -> float:
        """The next path parameter: no constraint begins or ends between two of them."""
        to = min(self.settings.arrival, u + advance)
        between = [float(at) for at in self.user.breaks if u < at < to]
        return between[0] if between else to

    def _reference(self, share: float) -> FloatArray:
        """Unknowns of the reference, shape (p,)."""
        return np.array([np.interp(share, self.of_motion, column) for column in self.motion.unknowns.T])

    def _advanced(self, stepper: SpaceStepper, u: float, pose: SpacePose) -> list[SpacePose] | None:
        """Poses towards the reference at u, to one that meets the constraints there; None when there is none."""
        settings = self.settings
        target = self._reference(u / settings.arrival)
        kept = False
        poses = []
        weight = settings.pull_weight * NOMINAL_LINKS / self.task.arm.links
        for _ in range(settings.steps):
            before = pose
            missing = target - pose.v
            turning = pose.chain.turning.reshape(-1, len(missing))
            turn = turning @ missing
            turn *= min(1.0, settings.largest_turn / max(float(np.max(np.abs(turn))), 1e-12))
            near = SpaceTerm(np.eye(len(missing)), missing, 1e-2)
            pose = stepper.step(pose, [SpaceTerm(turning, turn, weight), near])
            if pose is not before:
                poses.append(pose)
            kept = self.user.placed(u).miss(pose.q) <= 0.0
            if pose is before or (kept and float(np.max(np.abs(turn))) < settings.largest_turn):
                break
        # The arm may stay where it is while u goes on.
        return (poses or [pose]) if kept else None

    def _ended(self, stepper: SpaceStepper, pose: SpacePose) -> list[SpacePose]:
        """Poses from the last one that was tracked to where the reference ends, or at least onto the goal."""
        at_end = replace(stepper, user=self.user.placed(1.0))
        task = self.task
        end = self.motion.unknowns[-1]
        guide = PoseLed(pose.v, end, task.settings.guide.pose_step, task.settings.guide)
        try:
            poses = follow(at_end, guide, pose, task.deadline)
        except SpaceStalled as stalled:
            poses = stalled.poses
        if edge_is_safe(at_end, poses[-1].v, end):
            return [*poses[1:], *(stepper.pose(v) for v in pieces(stepper, poses[-1].v, end)[1:])]
        try:
            if task.goal is not None:
                return [*poses[1:], *settle(at_end, task.goal, poses[-1], task.deadline)[1:]]
        except SpaceStalled as stalled:
            raise self._failed(at_end, stalled.poses[-1], 1.0, f": {stalled}") from None
        raise self._failed(at_end, poses[-1], 1.0)

    def _motion(self, poses: list[SpacePose], u: FloatArray) -> SpaceMotion:
        motion = SpaceMotion.of(self.motion.curve, poses, self.motion.candidate)
        return replace(motion, u=u)

    def _failed(self, stepper: SpaceStepper, pose: SpacePose, u: float, why: str = "") -> MotionNotFound:
        what = "" if stepper.user is None else stepper.user.describe(pose.q)
        names = " and ".join(f"'{name}'" for name in self.user.names)
        reason = f"at u = {u:.3f} {what or f'a motion that was found cannot be bent to constraint {names}'}{why}"
        return MotionNotFound(Diagnosis(reason, "motion", ("relax the constraints, or make them soft",)))
