"""A problem written out as the data of a problem file, and read again."""

import json
from dataclasses import asdict, replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.io.problem_data import problem_data, recorded_data
from ccm_opt.io.reading import load_problem, problem_from_mapping
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, SimulationOptions, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .conftest import PROBLEMS

HOLED = shapely.Polygon(
    [(0.5, 0.5), (0.9, 0.5), (0.9, 0.9), (0.5, 0.9)], [[(0.6, 0.6), (0.7, 0.6), (0.7, 0.7), (0.6, 0.7)]]
)
OBSTACLES = (
    Obstacle("frame", PlaneShape(HOLED)),
    Obstacle("disc", PlaneShape(shapely.Point(-0.5, 0.61), 0.07)),
    Obstacle("rod", PlaneShape(shapely.LineString([(-0.9, -0.5), (0.1, -0.55), (0.3, -0.7)]), 0.013)),
    Obstacle("foil", PlaneShape(shapely.LineString([(-0.9, -0.8), (0.9, -0.8)]))),
)


def mixed_problem() -> Problem:
    """A problem made in Python in which no value is a default."""
    links = 4
    each, every = np.linspace(0.1, 0.4, links), np.linspace(1.0, 2.0, 3 * links)
    arm = Arm(
        links=links,
        link_length=0.1,
        radius=0.017,
        base=np.array([0.01, -0.02]),
        base_heading=0.3,
        joint_limit=1.1,
        base_limit=2.2,
        self_collision=False,
        mount_length=0.05,
        masses=each,
        inertia_axial=each / 7e3,
        inertia_transverse=each / 3e3,
        axes="zyz",
    )
    curve = Configuration.chain(
        arm.base, 0.37, [0.15, 0.25], [np.array([0.1, -0.2, 0.3, 1.0, 0.5]), np.full(5, 0.5)], [(0.2, 0.5, 0.9)] * 2
    )
    return Problem(
        name="mixed",
        description='of "every" kind',
        workspace=Workspace(shapely.Polygon([(-1, -1), (1, -1), (1.1, 1), (-1, 1)]), OBSTACLES, 0.003),
        arm=arm,
        limits=Limits(every, 3.0 * every, 0.7 * every),
        start=JointPose.along(arm, curve, "even-joints"),
        goal=TipGoal(np.array([0.3, 0.1]), heading=-0.4),
        tolerances=Tolerances(0.002, 0.03),
        planner=PlannerOptions("nlp", "even-joints", 7.0, 3, 5, 2, "none"),
        simulation=SimulationOptions(np.array([0.1, 0.2, -9.0]), 5e-4, "pd", 40.0, 3.0, 0.01),
    )


def assert_same(first: object, second: object) -> None:
    """Equal kinds and names, numbers equal to 1e-12."""
    if isinstance(first, dict):
        assert isinstance(second, dict)
        assert first.keys() == second.keys()
        for key, value in first.items():
            assert_same(value, second[key])
    elif isinstance(first, (list, tuple)):
        assert isinstance(second, (list, tuple))
        for one, other in zip(first, second, strict=True):
            assert_same(one, other)
    elif isinstance(first, shapely.Geometry):
        assert isinstance(second, shapely.Geometry)
        assert first.geom_type == second.geom_type
        assert shapely.equals_exact(first, second, 1e-12)
    elif isinstance(first, (float, np.ndarray)):
        np.testing.assert_allclose(first, second, rtol=1e-12, atol=1e-12)
    else:
        assert first == second


def assert_rebuilt(problem: Problem) -> None:
    """The problem written out, through JSON, and read again is the same in every field but ``source``."""
    again = problem_from_mapping(json.loads(json.dumps(problem_data(problem))))
    for name in ("start", "goal"):
        assert type(getattr(problem, name)) is type(getattr(again, name))
    assert_same(asdict(replace(problem, source="")), asdict(replace(again, source="")))


@pytest.mark.parametrize("path", sorted(PROBLEMS.glob("*.toml")), ids=lambda path: path.stem)
def test_problems_of_the_project_are_rebuilt(path: Path) -> None:
    """Every shipped problem, written out, is read as the same problem; its record is the file's own data."""
    problem = load_problem(path)
    assert_rebuilt(problem)
    assert recorded_data(problem) != problem_data(problem)


@pytest.mark.parametrize("goal", ["tip", "tip without heading", "joints", "curve"])
def test_every_kind_of_value_is_rebuilt(goal: str) -> None:
    """Obstacles, limits, poses, goals and options of every kind survive."""
    problem = mixed_problem()
    assert problem.start.curve is not None
    goals = {
        "tip": problem.goal,
        "tip without heading": TipGoal(np.array([0.3, 0.1])),
        "joints": JointPose(np.array([2.2, 1.1, -1.1, 0.1])),
        "curve": problem.start,
    }
    assert_rebuilt(replace(problem, goal=goals[goal]))


def test_a_start_by_joints_without_torque_limits_is_rebuilt() -> None:
    """Bends at their limits stay within them, and no limit stays no limit."""
    problem = mixed_problem()
    limits = replace(problem.limits, torque=None)
    assert_rebuilt(replace(problem, start=JointPose(np.array([-2.2, 1.1, -1.1, 0.1])), limits=limits))


def test_jerk_limits_are_rebuilt_and_need_a_timing_that_keeps_them() -> None:
    """A jerk limit for each revolute survives, and Paul's transitions, which know none, are refused with it."""
    problem = mixed_problem()
    smooth = replace(problem, limits=replace(problem.limits, jerk=np.arange(100.0, 100.0 + 3 * problem.arm.links)))
    assert_rebuilt(smooth)
    with pytest.raises(ProblemError, match=r"limits\.jerk"):
        replace(smooth, planner=replace(smooth.planner, retiming="paul"))


@pytest.mark.parametrize(
    ("obstacle", "kind"),
    [
        (Obstacle("soft", PlaneShape(HOLED, 0.1)), "a Polygon"),
        (Obstacle("dot", PlaneShape(shapely.Point(1, 1))), "Point"),
    ],
)
def test_shapes_that_no_file_can_say_are_refused(obstacle: Obstacle, kind: str) -> None:
    """The message names the obstacle and its kind."""
    problem = mixed_problem()
    with pytest.raises(ProblemError, match=f"'{obstacle.name}'.*{kind}.* cannot be written to a problem file"):
        problem_data(replace(problem, workspace=replace(problem.workspace, obstacles=(obstacle,))))


def test_a_curve_off_the_base_and_a_holed_room_are_refused() -> None:
    """What the format has no key for is not dropped in silence."""
    problem = mixed_problem()
    with pytest.raises(ProblemError, match="expected the arm's base"):
        problem_data(replace(problem, arm=replace(problem.arm, base=np.zeros(2))))
    with pytest.raises(ProblemError, match="boundary has holes"):
        problem_data(replace(problem, workspace=Workspace(HOLED)))


@pytest.mark.parametrize("unit", ["m", "mm", "in"])
def test_problems_are_written_in_their_own_unit(unit: LengthUnit) -> None:
    """Lengths stand in the problem's unit, and are read as the same metres to the last bit or nearly."""
    assert_rebuilt(replace(mixed_problem(), length_unit=unit))


@given(st.decimals(-1e6, 1e6, places=6), st.sampled_from(["m", "mm", "in"]))
def test_lengths_that_people_write_come_back_as_written(written: Decimal, unit: LengthUnit) -> None:
    """A number read as metres and written in the same unit is the same number."""
    metres = float(written) * METRES[unit]
    assert in_unit(metres, unit) * METRES[unit] == metres
    assert in_unit(metres, unit) == pytest.approx(float(written), rel=1e-15, abs=0.0)
