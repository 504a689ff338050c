"""Motions planned backwards: from a pose at the goal to the start, also when the goal is the whole arm's."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask, coarsened
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.passage_exit import backward_tasks, reversed_motion
from ccm_opt.planning.refinement import REFINEMENT_MARGIN, refine_motion
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.strategies import find_motion
from ccm_opt.problem import JointPose
from tests.scenes import clutter, motion_task

EXACT = 1e-9


@cache
def whole_arm_task(links: int) -> MotionTask:
    """A scene of clutter with a goal for the whole arm, to be found without optimisation."""
    scene = clutter(4, 20, links)
    return replace(motion_task(scene.problem(JointPose(scene.arm.bends(scene.goal)))), optimiser="none")


@cache
def turned(links: int) -> MotionTask:
    """The same with its ends exchanged."""
    task = whole_arm_task(links)
    (other,) = backward_tasks(task, PlanarRun.from_task(task, 0.06).stepper)
    assert other is not None
    return other


@cache
def backwards() -> Motion:
    """The motion that is found backwards, run forwards."""
    return reversed_motion(find_motion(turned(24)))


def test_ends_of_a_whole_arm_goal_are_exchanged() -> None:
    """The goal becomes the start, and the start a goal for the whole arm."""
    task = whole_arm_task(24)
    other = turned(24)
    assert task.goal_pose is not None
    assert other.goal_pose is not None
    np.testing.assert_allclose(other.start, task.goal_pose)
    np.testing.assert_allclose(other.goal_pose, task.start)


def test_reversed_motion_runs_from_start_to_goal() -> None:
    """A motion found backwards begins at the start, ends at the goal pose, and is certified."""
    task = whole_arm_task(24)
    motion = backwards()
    np.testing.assert_allclose(motion.configurations[0], task.start, atol=EXACT)
    np.testing.assert_allclose(motion.configurations[-1], task.goal_pose, atol=EXACT)
    assert len(task.certificate.failures(motion.configurations)) == 0


@pytest.mark.parametrize("links", [36, 60])
def test_reversed_motion_is_lifted_exactly(links: int) -> None:
    """Lifted to more links, a motion found backwards meets both ends of the finer arm exactly."""
    task = whole_arm_task(links)
    coarse = coarsened(task, 24)
    (other,) = backward_tasks(coarse, PlanarRun.from_task(coarse, 0.06).stepper)
    assert other is not None
    found = reversed_motion(find_motion(other))
    refined = refine_motion(optimise(found, replace(coarse, optimiser="sequential-convex"), REFINEMENT_MARGIN), task)
    assert refined is not None
    np.testing.assert_allclose(refined.configurations[0], task.start, atol=EXACT)
    np.testing.assert_allclose(refined.configurations[-1], task.goal_pose, atol=EXACT)
    assert len(task.certificate.failures(refined.configurations)) == 0
