"""Where motions in space end: in the pose of the curve's NLP, where it has room and the arm can move there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.deadline import Deadline
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.planning.ending import IN_NLP_POSE, ended_by_nlp
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal
from ccm_opt.scene.bodies import SphereBody
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.arms import held_bends
from tests.space_arms import space_arm

PROBLEMS = Path(__file__).parents[1] / "problems" / "space"


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["elbow", "wing-box", "blade-row"])
def test_an_end_that_is_moved_has_more_room(name: str) -> None:
    """It is at the goal, has no less room than the search's or nearly all that is wanted, and is reached safely."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    assert problem.dimension == 3
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    task = space_task(problem, tree, Deadline.after(60.0), SpaceMotionSettings())
    found = find_by_ways(task)
    ending = ended_by_nlp(problem, task, found)
    motion = ending.motion
    assert ending.record is not None
    assert ending.record.reached
    assert ending.record.reason == ""
    assert motion.candidate.endswith(IN_NLP_POSE)
    # Not nearly, but in the very pose that the NLP found.
    assert motion.configurations[-1] == pytest.approx(ending.record.configuration, abs=1e-6)
    assert ending.record.cost == pytest.approx(sum(ending.record.costs.values()))
    # The optimisation leaves that end where it is.
    assert ending.task.goal_pose is not None
    poses = GoalPoses(problem, tree)
    before = poses.gap(found.configurations[-1])
    after = poses.gap(motion.configurations[-1])
    assert after >= min(before, 0.9 * problem.wanted_gap)
    tip = problem.arm.joint_positions_at(motion.configurations[-1])[-1]
    assert tip == pytest.approx(problem.goal.position, abs=1e-7)
    assert len(task.certificate.failures(motion.configurations)) == 0
    held = held_bends(problem.arm, motion.configurations[:, -1])
    assert np.all(motion.configurations[:, : 2 * problem.arm.links][held] == 0.0)


def test_a_link_that_lies_along_a_ball_turns_away_about_the_goal() -> None:
    """No plane beside the ball leaves it more room than the tip has, which does not move: yet all that is wanted."""
    arm = space_arm(4, radius=0.015, joint_limit=0.5 * np.pi, mount_length=0.015)
    ball = Obstacle("ball", SphereBody(np.array([0.2, 0.0, 0.15]), 0.06))
    problem = Problem(
        "ball",
        Workspace(bounds=None, obstacles=(ball,)),
        arm,
        Limits(np.ones(12), 4.0 * np.ones(12)),
        JointPose.from_configuration(np.zeros(8), arm.coordinates),
        TipGoal(np.array([0.25, 0.05, 0.2]), None),
    )
    gap = GoalPoses(problem, SurfaceTree.from_triangles(problem.workspace.triangle_soup)).gap
    path = MotionPlanner().plan(problem)
    room = [gap(q) for q in path.spline(np.linspace(0.0, 1.0, 200))]
    assert min(room) >= 0.9 * problem.wanted_gap
    assert path.goal_pose is not None
    assert path.goal_pose.reached


def test_a_goal_of_the_whole_arm_is_left_alone() -> None:
    """There is nothing to choose."""
    problem = ccm_opt.load_problem(PROBLEMS / "blade-row.toml")
    assert problem.dimension == 3
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    task = space_task(problem, tree, Deadline.after(60.0), SpaceMotionSettings())
    found = find_by_ways(task)
    whole = replace(task, goal_pose=found.configurations[-1])
    ending = ended_by_nlp(problem, whole, found)
    assert (ending.task, ending.motion, ending.record) == (whole, found, None)
