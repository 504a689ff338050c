"""Curled arms: unbent, swung about the base past what they cannot be turned past as they are, and bent again."""

import numpy as np
import pytest

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.sampled_poses import unbending_poses
from ccm_opt.planning.strategies import find_by_ways
from tests.snakes_in_space import boxes, least_gaps, snake, task_of

POST = boxes([([0.33, -0.02, -0.5], [0.37, 0.02, 0.5])])
WALL = boxes([([-0.1, 0.1, -0.6], [0.9, 0.12, 0.6])])


def curled(links: int, side: float) -> FloatArray:
    """An arm that reaches past the post on one side and curls behind it."""
    bends = np.zeros((links, 2))
    bends[0, 0] = side * np.deg2rad(35.0)
    bends[1:, 0] = -side * np.deg2rad(125.0) / (links - 1)
    return bends.ravel()


@pytest.mark.parametrize("links", [9, 26])
def test_an_arm_curled_behind_a_post_comes_to_its_mirror_image(links: int) -> None:
    """The motion begins and ends in these poses, and touches neither the post nor the arm itself on its way."""
    arm = snake(links, limit_deg=60.0)
    task = task_of(arm, POST, None, start=curled(links, 1.0), goal_pose=curled(links, -1.0))
    motion = find_by_ways(task)
    assert motion.candidate in {"a quick sampler", "unbent and swung"}
    assert motion.configurations[0] == pytest.approx(task.start, abs=1e-9)
    assert motion.configurations[-1] == pytest.approx(curled(links, -1.0), abs=1e-7)
    walls, pairs = least_gaps(arm, POST, motion.configurations)
    assert walls > 0.0
    assert pairs > 0.0


@pytest.mark.parametrize("walled", [False, True])
def test_an_arm_is_unbent_as_far_as_walls_allow(walled: bool) -> None:
    """In the open it ends straight; beside a wall that is in its way it ends where it is, or straighter, and free."""
    arm = snake(10, limit_deg=60.0)
    start = curled(10, 1.0) * (0.5 if walled else 1.0)
    task = task_of(arm, WALL if walled else POST, None, start=start)
    curve, v = CurveMap.through(arm, task.start)
    stepper = task.stepper(curve)
    poses = unbending_poses(stepper, stepper.pose(v), task.deadline)
    ends = [np.linalg.norm(arm.joint_positions_at(pose.q)[-1]) for pose in (poses[0], poses[-1])]
    assert ends[1] > ends[0]
    assert (ends[1] > 0.999 * arm.length) != walled
    walls, _ = least_gaps(arm, WALL if walled else POST, np.stack([pose.q for pose in poses]))
    assert walls > 0.0
