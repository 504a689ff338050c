"""A problem in space that is built in Python is checked as one of the plane is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import BoxBody, CapsuleBody, MeshBody, SphereBody
from ccm_opt.scene.workspace import Obstacle

from .space_plans import true_plan

Change = Callable[[Problem], Problem]


def of_arm(**changes: object) -> Change:
    """Another arm."""
    return lambda problem: replace(problem, arm=replace(problem.arm, **changes))  # type: ignore[arg-type]


def with_body(body: object) -> Change:
    """One obstacle more."""

    def changed(problem: Problem) -> Problem:
        bodies = (*problem.workspace.obstacles, Obstacle("new", body))  # type: ignore[arg-type]
        return replace(problem, workspace=replace(problem.workspace, obstacles=bodies))

    return changed


def to(goal: object) -> Change:
    """Another goal."""
    return lambda problem: replace(problem, goal=goal)  # type: ignore[arg-type]


NOWHERE = np.array([0.0, np.nan, 0.0])
PLACE = np.array([0.1, 0.2, 0.3])
MESH = MeshBody.of_arrays(np.eye(3), [[0, 1, 2]])
MISTAKES: dict[str, tuple[Change, str]] = {
    "odd links": (of_arm(links=5), "arm.links must be at least 2, and even"),
    "no length": (of_arm(link_length=0.0), "arm.link_length must be positive"),
    "a long direction": (of_arm(direction=np.array([2.0, 0.0, 0.0])), "arm.direction must be a unit vector"),
    "up aslant": (of_arm(up=np.array([0.6, 0.0, 0.8])), "perpendicular"),
    "base of two": (of_arm(base=np.zeros(2)), r"arm.base must have shape \(3,\)"),
    "another order": (of_arm(axes="zyz"), 'arm.axes must be "zyx"'),
    "no joint limit": (of_arm(joint_limit=0.0), "arm.joint_limit must be positive"),
    "no mass": (of_arm(masses=np.zeros(8)), "arm.masses must"),
    "a feed backwards": (of_arm(feed=Feed(0.5, 0.0, 0.0)), "arm.feed must have low < high"),
    "no arm": (lambda problem: replace(problem, arm=None), "arm must be a Arm"),  # type: ignore[arg-type]
    "a box inside out": (with_body(BoxBody(PLACE, np.zeros(3))), "obstacle 'new': low must be below high"),
    "a ball nowhere": (with_body(SphereBody(NOWHERE, 0.1)), "obstacle 'new': center must be finite"),
    "a ball of nothing": (with_body(SphereBody(PLACE, 0.0)), "obstacle 'new': radius must be a positive number"),
    "a bar of no length": (with_body(CapsuleBody(PLACE, PLACE, 0.1)), "start and end must differ"),
    "a mesh nowhere": (with_body(replace(MESH, vertices=np.full((3, 3), np.nan))), "vertices must be finite"),
    "a mesh without corners": (with_body(replace(MESH, faces=np.array([[0, 1, 3]]))), "a vertex that does not exist"),
    "no clearance": (
        lambda problem: replace(problem, workspace=replace(problem.workspace, clearance=-1.0)),
        "workspace.clearance must not be negative",
    ),
    "a room inside out": (
        lambda problem: replace(problem, workspace=replace(problem.workspace, bounds=np.zeros((2, 3)))),
        "workspace.bounds must have a lower corner",
    ),
    "a goal in the plane": (to(TipGoal(np.zeros(2))), r"goal.position must have shape \(3,\)"),
    "a goal without a direction": (to(TipGoal(PLACE, np.zeros(3))), "goal.direction must be a unit vector"),
    "a way nowhere": (to(TipGoal(PLACE, via=(NOWHERE,))), "goal.via 1 must be finite"),
    "a goal of one bend": (to(JointPose(np.zeros((1, 2)))), "goal.bends must have shape"),
    "too much effort": (
        lambda problem: replace(problem, planner=replace(problem.planner, effort_share=2.0)),
        "planner.effort_share must be above 0",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name: str) -> None:
    """A problem with a mistake cannot be made, and the reason names what is wrong."""
    change, said = MISTAKES[name]
    with pytest.raises(ProblemError, match=said):
        change(true_plan().problem)


def test_all_mistakes_are_named_together() -> None:
    """Mistakes in several parts are told at once."""
    problem = true_plan().problem
    wrong = replace(problem.workspace, clearance=-1.0, obstacles=(Obstacle("ball", SphereBody(PLACE, -0.1)),))
    with pytest.raises(ProblemError, match=r"(?s)clearance.*'ball'.*goal.position"):
        replace(problem, workspace=wrong, goal=TipGoal(np.zeros(2)))
