"""Withdrawals of fed arms in space: back no farther than needed, and then by any strategy."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.planning.withdrawals import turned_over, withdrawal_poses
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from tests.snakes_in_space import boxes, least_gaps, snake, task_of
from tests.witness_scenes import witness_scene

WALL = boxes([([1.3, -0.01, -1.0], [2.5, 0.01, 1.0])])


def back_and_onward(triangle_soup: TriangleSoup) -> tuple[SpaceTask, CurveMap, FloatArray, FloatArray]:
    """A fed arm on one side of what may be a wall along its axis, drawn back, and fed in on the other side."""
    arm = snake(12, feed=Feed(0.0, 0.9, 0.9))
    task = task_of(arm, triangle_soup, GoalPose(np.array([1.4, -0.2, 0.0]), None))
    curve, home = CurveMap.through(arm, np.zeros(25))
    shapes = np.zeros((2, len(home)))
    shapes[0, : curve.knots] = 1.2 / curve.scale[: curve.knots]
    shapes[1, : curve.knots] = -1.2 / curve.scale[: curve.knots]
    shapes[:, curve.feed_column] = 0.7 / curve.scale[curve.feed_column]
    stepper = task.stepper(curve, 0.0)
    back, onward = (np.stack([pose.v for pose in withdrawal_poses(stepper, v, task.deadline)]) for v in shapes)
    return task, curve, back, onward[::-1]


@pytest.mark.parametrize("triangle_soup", [TriangleSoup.joined([]), WALL], ids=["open", "wall"])
def test_an_arm_goes_back_no_farther_than_it_must(triangle_soup: TriangleSoup) -> None:
    """Nowhere in the open, but to the edge of a wall between the two shapes; all of it is certified."""
    task, curve, back, onward = back_and_onward(triangle_soup)
    stepper = task.stepper(curve, 0.0)
    feed = curve.feed_column
    whole = turned_over(stepper, back, onward, wholly=True)
    over = turned_over(stepper, back, onward)
    assert whole is not None
    assert over is not None
    for unknowns in (whole, over):
        assert len(stepper.failing_edges(unknowns)) == 0
        np.testing.assert_array_equal(unknowns[[0, -1]], np.stack((back[0], onward[-1])))
    least = over[:, feed].min() * curve.scale[feed]
    assert whole[:, feed].min() == back[:, feed].min()
    assert least == pytest.approx(0.7) if len(triangle_soup) == 0 else 0.2 < least < 0.5


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("knots", [(11, 16), (16, 11)])
def test_motions_of_different_knots_are_joined_in_one_curve(knots: tuple[int, int]) -> None:
    """What was found with fewer knots is sought with those of the other; the joined motion is certified."""
    arm = snake(12, feed=Feed(0.0, 0.9, 0.9))
    start = np.append(np.tile([0.0, 0.05], 12), 0.5)
    start[: 2 * 6] = 0.0
    task = task_of(arm, TriangleSoup.joined([]), GoalPose(np.array([1.3, -0.2, 0.1]), None), start=start)
    run = SpaceRun.from_task(task)
    from_tube = partial(run._found_from, np.zeros(25), find_by_ways)
    found = from_tube(replace(task, knots=knots[0]))
    entered = from_tube(replace(run._entering, knots=knots[1]))
    assert found is not None
    assert run._led_back_before(found, entered) is None
    whole = run._led_back_in_one_curve(found, entered, from_tube)
    assert whole is not None
    assert whole.curve.knots == max(knots)
    assert whole.configurations[0] == pytest.approx(start, abs=1e-9)
    assert np.linalg.norm(arm.joint_positions_at(whole.configurations[-1])[-1] - task.goal.position) < 1e-6
    assert len(task.stepper(whole.curve, 0.0).failing_edges(whole.unknowns)) == 0


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize(("links", "seed"), [(12, 2), (24, 0)])
def test_a_task_that_begins_deep_in_a_hole_is_solved(links: int, seed: int) -> None:
    """From one hole into another, where bends may be such that the arm is not simply drawn back."""
    problem = witness_scene("reversed", seed, links).problem
    triangle_soup = problem.workspace.triangle_soup
    task = space_task(problem, SurfaceTree.from_triangles(triangle_soup), Deadline.after(60.0), SpaceMotionSettings())
    motion = find_by_ways(task)
    assert motion.candidate.startswith("back, then")
    assert motion.configurations[0] == pytest.approx(task.start, abs=1e-9)
    assert min(least_gaps(task.arm, triangle_soup, motion.configurations, 10)) > 0.0
