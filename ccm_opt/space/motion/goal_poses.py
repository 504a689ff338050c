"""Poses of the whole arm with the tip at the goal that touch nothing, by drawn curves and Newton's method."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.motion.space_goal import SpaceTipPose, keeps_terms_at_goal, onto_goal, terms_to_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceTask


def goal_poses(task: SpaceTask, stepper: SpaceStepper, rng: np.random.Generator) -> Iterator[SpacePose]:
    """Poses at the goal that touch nothing and keep the joint limits; drawn until the deadline, or the draws, end.

    Args:
        task: with a goal for the tip.
        stepper: in whose unknowns they are.
        rng: for the draws.
    """
    settings = task.settings.goal_poses
    if task.goal is None:
        return
    for _ in range(settings.draws):
        if task.deadline.passed():
            return
        pose = _brought_onto_goal(stepper, task.goal, stepper.pose(drawn_unknowns(stepper, rng)), task)
        if pose is not None:
            yield pose


def drawn_unknowns(stepper: SpaceStepper, rng: np.random.Generator) -> FloatArray:
    """Unknowns of a curve with smooth random curvature, and a random feed."""
    curve = stepper.curve
    arm = curve.arm
    k = curve.knots
    controls = rng.normal(size=(2, 4)) * rng.uniform(0.1, 1.0)
    places = np.linspace(0.0, 1.0, 4)
    # Curvature as bends of a nominal link; three quarters of the limit is a strong bend already.
    largest = 0.4 * min(arm.joint_limit * arm.links / NOMINAL_LINKS, 1.0) / stepper.unit
    curvature = [largest * np.interp(np.linspace(0.0, 1.0, k), places, row) for row in controls]
    v = np.zeros(curve.dimension)
    turned = 0 if arm.base_axes else 2
    if turned:
        v[:2] = rng.normal(size=2) * 0.5 * min(arm.base_limit, 1.5)
    v[turned : turned + 2 * k] = np.concatenate(curvature) / curve.scale[turned : turned + 2 * k]
    if arm.base_axes:
        low, high = arm.base_range
        v[turned + 2 * k] = rng.uniform(low, high) / curve.scale[turned + 2 * k]
    return v


def _brought_onto_goal(stepper: SpaceStepper, goal: SpaceTipPose, pose: SpacePose, task: SpaceTask) -> SpacePose | None:
    """The pose brought onto the goal, off the walls and within limits; None where that fails."""
    settings = task.settings.goal_poses
    for k in range(settings.steps):
        pose = stepper.step(pose, terms_to_goal(stepper, goal, pose, 1.0 + k), certified=False)
        distance, turn = goal.errors(pose)
        if distance < 0.1 * stepper.unit and turn < 0.05:
            break
    onto = onto_goal(stepper, goal, pose, settings.polish_turn)
    return onto if onto is not None and _free(stepper, onto) else None


def _free(stepper: SpaceStepper, pose: SpacePose) -> bool:
    """Whether a pose touches nothing and keeps the limits."""
    if not stepper.within_limits(pose.q) or not keeps_terms_at_goal(stepper, pose):
        return False
    return stepper.certificate.safe(pose.q, pose.q)
