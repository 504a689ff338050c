"""A goal's direction in space that the last link cannot take is turned no farther than is needed."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.diagnosis.in_space.knowledge_in_space import IN_SPACE
from ccm_opt.diagnosis.in_space.turned_direction import turned_direction
from ccm_opt.diagnosis.relaxation import Trials, relaxations
from ccm_opt.errors import Diagnosis, MotionNotFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.space_kinematics import joint_positions, link_rotations
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.scene import SpaceWorkspace
from tests.scenes import later
from tests.space_arms import space_arm

LINKS = 6


def angle(one: FloatArray, other: FloatArray) -> float:
    """Between two unit vectors [rad]."""
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def asked_for(direction: FloatArray, end: FloatArray) -> SpaceProblem:
    """In an empty room, a goal where the tip is in a configuration, with another direction."""
    arm = space_arm(LINKS, 0.1, 0.01)
    ones = np.ones(3 * LINKS)
    goal = SpaceTipGoal(joint_positions(arm, end)[-1], direction)
    start = SpaceJointPose(np.zeros((LINKS, 2)))
    return SpaceProblem("turned", SpaceWorkspace(None, ()), arm, Limits(ones, ones), start, goal)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_least_turn_that_helps_is_told(seed: int) -> None:
    """A turn from which on the direction is taken is told to a twentieth, and the direction is on the way."""
    rng = np.random.default_rng(seed)
    end = rng.normal(0.0, 0.4, 2 * LINKS)
    wanted = rng.normal(size=3)
    wanted /= np.linalg.norm(wanted)
    problem = asked_for(wanted, end)
    taken = link_rotations(problem.arm, end)[-1, :, 0]
    whole = angle(wanted, taken)
    least = float(rng.uniform(0.05, 1.0)) * whole
    solved: list[FloatArray] = []

    def solve(changed: SpaceProblem) -> str:
        goal = changed.goal
        assert isinstance(goal, SpaceTipGoal)
        if goal.direction is not None:
            if angle(goal.direction, wanted) < least - 1e-7:
                raise MotionNotFound(Diagnosis("no motion was found", "motion"))
            solved.append(goal.direction)
        return "a plan"

    trials = Trials(solve, later(900.0), ended=lambda _: end)
    told = {each.key: each for each in relaxations(problem, (), trials, IN_SPACE)}["goal.direction"]
    if whole <= problem.tolerances.heading:
        assert told.words == "goal.direction left out"
        return
    assert isinstance(told.value, float)
    assert least - 1e-6 <= told.value <= 1.06 * least + 1e-6
    assert any(abs(angle(direction, wanted) - told.value) < 1e-6 for direction in solved)
    for direction in solved:
        # On the arc from what was wanted to what is taken, or beyond it by what rounding adds.
        beyond = angle(direction, wanted) + angle(direction, taken) - whole
        assert beyond < 2e-3 * whole + 1e-6
    assert told.words.startswith("goal.direction turned by ")


def test_opposite_directions_are_turned_about_some_axis() -> None:
    """There is no way from one to the other that is shorter than others."""
    end = np.zeros(2 * LINKS)
    problem = asked_for(np.array([-1.0, 0.0, 0.0]), end)
    turned = turned_direction(problem, end)
    assert turned is not None
    goal = turned.write(problem, 0.25 * np.pi).goal
    assert abs(angle(goal.direction, np.array([-1.0, 0.0, 0.0])) - 0.25 * np.pi) < 1e-9
