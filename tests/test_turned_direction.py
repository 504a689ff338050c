"""A goal's direction in space that the last link cannot take is turned no farther than is needed."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, VerificationError
from ccm_opt.diagnosis.moved_goal import turned_direction, turned_roll
from ccm_opt.diagnosis.relaxation import Trials, relaxations
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.tool import Tool
from ccm_opt.scene.workspace import Workspace
from tests.scenes import later
from tests.space_arms import space_arm

LINKS = 6
ROUNDED = 1.5e-4
"""What rounding to four decimals may turn a direction by, and a little more [rad]."""


def angle(one: FloatArray, other: FloatArray) -> float:
    """Between two unit vectors [rad]."""
    return float(2.0 * np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other)))


def named(words: str) -> FloatArray:
    """The direction in what is told, as a unit vector."""
    direction = np.array([float(each) for each in words[words.index("(") + 1 : -1].split(", ")])
    return np.asarray(direction / np.linalg.norm(direction))


def direction_of(problem: Problem) -> FloatArray | None:
    """The direction of a problem's goal."""
    assert isinstance(problem.goal, TipGoal)
    return problem.goal.direction


def asked_for(direction: FloatArray, end: FloatArray) -> Problem:
    """In an empty room, a goal where the tip is in a configuration, with another direction."""
    arm = space_arm(LINKS, 0.1, 0.01)
    ones = np.ones(3 * LINKS)
    goal = TipGoal(arm.joint_positions_at(end)[-1], direction)
    start = JointPose(np.zeros((LINKS, 2)))
    return Problem("turned", Workspace(bounds=None, obstacles=()), arm, Limits(ones, ones), start, goal)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_least_turn_that_helps_is_told(seed: int) -> None:
    """A turn from which on the direction is taken is told to a twentieth, and the direction is on the way."""
    rng = np.random.default_rng(seed)
    end = rng.normal(0.0, 0.4, 2 * LINKS)
    wanted = rng.normal(size=3)
    wanted /= np.linalg.norm(wanted)
    problem = asked_for(wanted, end)
    taken = problem.arm.link_rotations(end)[-1, :, 0]
    whole = angle(wanted, taken)
    least = float(rng.uniform(0.05, 1.0)) * whole
    solved: list[FloatArray] = []

    def solve(changed: Problem) -> str:
        direction = direction_of(changed)
        if direction is not None:
            if angle(direction, wanted) < least - 1e-7:
                raise MotionNotFound(Diagnosis("no motion was found", "motion"))
            solved.append(direction)
        return "a plan"

    trials = Trials(solve, later(900.0), ended=lambda _: end)
    told = {each.key: each for each in relaxations(problem, (), trials)}["goal.direction"]
    if whole <= problem.tolerances.heading:
        assert told.words == "goal.direction left out"
        return
    assert isinstance(told.value, float)
    assert least - ROUNDED <= told.value <= 1.06 * least + ROUNDED
    assert told.words.startswith("goal.direction turned by ")
    solution = named(told.words)
    assert any(angle(direction, solution) < 1e-9 for direction in solved)
    assert abs(angle(solution, wanted) - told.value) < ROUNDED
    for direction in solved:
        # On the arc from what was wanted to what is taken, or beyond it by what rounding adds.
        beyond = angle(direction, wanted) + angle(direction, taken) - whole
        assert beyond < 2e-3 * whole + 2.0 * ROUNDED


def test_a_plan_without_a_direction_is_one_with_that_of_its_end() -> None:
    """Where no direction is found by searching anew, the one that the plan without any ends in is told all the same."""
    end = np.random.default_rng(7).normal(0.0, 0.4, 2 * LINKS)
    problem = asked_for(np.array([0.0, 0.0, 1.0]), end)
    taken = problem.arm.link_rotations(end)[-1, :, 0]

    def solve(changed: Problem) -> str:
        if direction_of(changed) is not None:
            raise MotionNotFound(Diagnosis("no motion was found", "motion"))
        return "a plan"

    def hold_again(changed: Problem, plan: object) -> str:
        assert plan == "a plan"
        direction = direction_of(changed)
        if direction is None or angle(direction, taken) > changed.tolerances.heading:
            raise VerificationError(["it ends otherwise"])
        return "a plan"

    trials = Trials(solve, later(900.0), hold_again=hold_again, ended=lambda _: end)
    told = {each.key: each for each in relaxations(problem, (), trials)}["goal.direction"]
    assert told.words.startswith("goal.direction turned by ")
    assert angle(named(told.words), taken) < 2e-3


@given(seed=st.integers(0, 2**32 - 1), whole=st.floats(0.1, 3.0))
def test_direction_and_roll_of_a_tool_are_turned_to_those_it_takes(seed: int, whole: float) -> None:
    """What is tried first is the direction in which the tool points, or the roll that it has, told by its angle."""
    rng = np.random.default_rng(seed)
    axes = Rotation.random(2, rng=rng).as_matrix()
    tool = Tool(tip=np.zeros(3), direction=axes[0][0], up=axes[0][2])
    end = rng.normal(0.0, 0.4, 2 * LINKS)
    problem = asked_for(axes[1][0], end)
    problem = replace(problem, arm=replace(problem.arm, tool=tool))
    last = problem.arm.link_rotations(end)[-1]
    turned = turned_direction(problem, end)
    assert turned is not None
    direction = direction_of(turned.write(problem, turned.tried[0]))
    assert direction is not None
    assert angle(direction, last @ tool.direction) < ROUNDED

    direction = last @ tool.direction
    up = Rotation.from_rotvec(rng.choice((-1.0, 1.0)) * whole * direction).apply(last @ tool.up_axis)
    rolled = replace(problem, goal=TipGoal(problem.goal.tip(problem.arm), direction, up=up))
    by = turned_roll(rolled, end)
    assert by is not None
    assert abs(by.tried[0] - whole) < 1e-7
    changed = by.write(rolled, by.tried[0]).goal
    assert isinstance(changed, TipGoal)
    assert abs(changed.roll_of(last @ tool.up_axis)) < 2.0 * ROUNDED
    named_up = named(by.words(rolled, by.tried[0]))
    assert changed.up is not None
    assert angle(named_up, changed.up) < 1e-9
    assert turned_roll(by.write(rolled, by.tried[0]), end) is None


def test_opposite_directions_are_turned_about_some_axis() -> None:
    """There is no way from one to the other that is shorter than others."""
    end = np.zeros(2 * LINKS)
    problem = asked_for(np.array([-1.0, 0.0, 0.0]), end)
    turned = turned_direction(problem, end)
    assert turned is not None
    direction = direction_of(turned.write(problem, 0.25 * np.pi))
    assert direction is not None
    assert abs(angle(direction, np.array([-1.0, 0.0, 0.0])) - 0.25 * np.pi) < ROUNDED
