"""Problems, arms, goals and obstacles made in Python: in the unit that suits, and checked as closely as files."""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.problem import SimulationOptions, VerificationOptions
from ccm_opt.robot.base_axes import Feed

from .conftest import PROBLEMS
from .test_problem_data import assert_same

TEXT = (PROBLEMS / "swan-neck.toml").read_text()
PLAIN: Mapping[str, Any] = {
    "unit": "mm",
    "arm": {"links": 12, "link_length": 50, "radius": 20, "base": (0, 0), "joint_limit_deg": 60},
    "room": (-300, -400, 800, 600),
    "limits": {"velocity": 1.0, "acceleration": 4.0},
    "goal": (430, 230),
}


def made(**changes: Any) -> ccm_opt.Problem:
    """A plain problem with other parts."""
    return ccm_opt.make_problem("mine", **{**PLAIN, **changes})


def refused(**changes: Any) -> str:
    """What is said of a plain problem with other parts."""
    with pytest.raises(ProblemFileError) as caught:
        made(**changes)
    return str(caught.value)


@given(st.floats(1.0, 1e4), st.integers(1, 40), st.floats(0.0, 10.0), st.sampled_from(["m", "mm", "in"]))
def test_an_arm_is_as_long_as_was_asked_in_its_unit(length: float, pairs: int, radius: float, unit: LengthUnit) -> None:
    """Lengths are in the unit of the call, and the links share the length; its table makes the same arm."""
    arm = ccm_opt.Arm.snake(length=length, links=2 * pairs, radius=radius, unit=unit)
    assert arm.length == pytest.approx(length * METRES[unit], rel=1e-12)
    assert arm.radius == radius * METRES[unit] == arm.mount_length
    assert len(arm.masses) == arm.links == 2 * pairs


def test_a_fed_arm_in_millimetres_is_that_of_a_file() -> None:
    """Every argument lands where the key of a file does."""
    arm = ccm_opt.Arm.snake(
        length=480,
        links=8,
        radius=15,
        unit="mm",
        base=[10, -20],
        heading_deg=30,
        joint_limit_deg=50,
        base_limit_deg=70,
        mount_length=40,
        self_collision=False,
        link_mass=0.2,
        payload=0.3,
        axes="zyz",
        feed=(-500, 0),
        hole=-10,
    )
    table = """
        links = 8
        link_length = 60
        radius = 15
        base = [10, -20]
        base_heading_deg = 30
        joint_limit_deg = 50
        base_limit_deg = 70
        mount_length = 40
        self_collision = false
        link_mass = 0.2
        payload = 0.3
        axes = "zyz"
        feed = {range = [-500, 0], hole = -10}
    """
    limits = {"velocity": 1.0, "acceleration": 4.0, "feed_velocity": 0.1, "feed_acceleration": 0.5}
    problem = made(arm=tomllib.loads(table), limits=limits, room=(-2000, -2000, 2000, 2000))
    assert arm.feed == Feed(-0.5, 0.0, -0.01)
    assert_same(vars(problem.arm), vars(arm))


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"length": "600"}, "length: expected a number greater than 0, got str '600'"),
        ({"length": True}, "length: expected a number greater than 0, got bool True"),
        ({"links": 7}, "links: expected an even number, got 7"),
        ({"links": 6.0}, "links: expected a whole number of at least 2, got float 6.0"),
        ({"radius": -1}, "radius: expected a number of at least 0, got int -1"),
        ({"unit": "cm"}, "unit: expected one of m, mm, in, got str 'cm'"),
        ({"base": 3}, "base: expected 2 numbers"),
        ({"joint_limit_deg": 190}, "joint_limit_deg: expected at most 180"),
        ({"link_mass": [0.1, 0.2]}, "link_mass: expected 6 numbers"),
        ({"link_mass": 0}, "link_mass: expected a number greater than 0"),
        ({"feed": (2, 1)}, "feed: expected .least, greatest."),
        ({"hole": 1.0}, "hole: only allowed together with feed"),
        ({"self_collision": "yes"}, "self_collision: expected True or False"),
        ({"axes": "xyz"}, "axes: expected one of zyx, zyz"),
    ],
)
def test_what_is_no_arm_is_refused(wrong: Mapping[str, Any], line: str) -> None:
    """The message names the argument, what was expected, and what was given."""
    with pytest.raises(ccm_opt.CcmError, match=line):
        ccm_opt.Arm.snake(**({"length": 0.6, "links": 6, "radius": 0.02} | wrong))


def test_all_that_is_wrong_with_an_arm_is_told_at_once() -> None:
    """One line for each argument."""
    with pytest.raises(ccm_opt.ProblemError) as caught:
        ccm_opt.Arm.snake(length=0, links="6", radius=None)  # type: ignore[arg-type]
    assert len(str(caught.value).splitlines()) == 4


def test_a_problem_of_tables_is_the_one_of_the_file() -> None:
    """The tables of a file, handed over as they are, make the problem of that file."""
    data = tomllib.loads(TEXT)
    workspace = data["workspace"]
    problem = ccm_opt.make_problem(
        data["name"],
        arm=data["arm"],
        room=workspace["bounds"],
        obstacles=workspace["obstacles"],
        clearance=workspace.get("clearance"),
        start=data["start"],
        goal=data["goal"],
        limits=data["limits"],
        planner=data.get("planner"),
        simulation=data.get("simulation"),
        description=data.get("description", ""),
    )
    assert_same(problem_data(problem), problem_data(parse_problem(TEXT)))


@pytest.mark.parametrize("unit", ["m", "mm", "in"])
def test_a_problem_of_objects_is_the_same_in_every_unit(unit: LengthUnit) -> None:
    """Objects are in metres whatever the unit of the call is, and stay as they are to the last bit."""
    problem = parse_problem(TEXT)
    again = ccm_opt.make_problem(
        problem.name,
        description=problem.description,
        arm=problem.arm,
        room=problem.workspace,
        start=problem.start,
        goal=problem.goal,
        limits=problem.limits,
        planner=problem.planner,
        simulation=problem.simulation,
        verification=VerificationOptions(1e-6),
        unit=unit,
    )
    assert again.arm is problem.arm
    assert again.goal is problem.goal
    assert again.length_unit == unit
    assert_same(
        problem_data(replace(again, length_unit="m")),
        problem_data(replace(problem, tolerances=again.tolerances, verification=VerificationOptions(1e-6))),
    )


def test_several_goals_are_reached_in_sequence() -> None:
    """Places, tables and objects may be mixed; a place alone is one goal."""
    pose = ccm_opt.JointPose.of_degrees([10.0] * 12)
    problem = made(goal=[(430, 230), {"position": [400, 100], "heading_deg": 30, "pause": 0.5}, pose])
    assert [stop.pause for stop in problem.stops] == [0.0, 0.5]
    assert isinstance(problem.goal, ccm_opt.JointPose)
    np.testing.assert_allclose(problem.goal.bends, np.deg2rad(10.0))
    assert not made().stops


def test_goals_in_the_unit_that_suits() -> None:
    """Positions in millimetres, angles in degrees, feed likewise."""
    goal = ccm_opt.TipGoal.at((430, 230), 60, unit="mm")
    np.testing.assert_allclose(goal.position, (0.43, 0.23))
    assert goal.heading == pytest.approx(np.pi / 3.0)
    assert ccm_opt.TipGoal.at([0.1, 0.2]).heading is None
    assert ccm_opt.JointPose.of_degrees([0, 90], feed=20, unit="mm").feed == pytest.approx(0.02)
    with pytest.raises(ccm_opt.ProblemError, match="position: expected 2 numbers"):
        ccm_opt.TipGoal.at((1, 2, 3, 4))
    above = ccm_opt.TipGoal.at((1, 2, 3), direction=(0, 0, 2), unit="mm")
    np.testing.assert_allclose((*above.position, *np.asarray(above.direction)), (1e-3, 2e-3, 3e-3, 0.0, 0.0, 1.0))
    with pytest.raises(ccm_opt.ProblemError, match="heading_deg: only allowed in the plane"):
        ccm_opt.TipGoal.at((1, 2, 3), 60)
    with pytest.raises(ccm_opt.ProblemError, match="direction: only allowed in space"):
        ccm_opt.TipGoal.at((1, 2), direction=(1, 0))
    with pytest.raises(ccm_opt.ProblemError, match="bends_deg: expected a list of numbers"):
        ccm_opt.JointPose.of_degrees("straight")  # type: ignore[arg-type]


def test_shapes_are_obstacles() -> None:
    """Holes stay free, several parts are several obstacles, lines are walls, buffered ones are polygons; z is none."""
    ring = shapely.box(100, 200, 200, 300).difference(shapely.box(120, 220, 180, 280))
    other = shapely.MultiPolygon([shapely.box(20, 300, 30, 310)])
    both = shapely.GeometryCollection([shapely.box(0, 300, 10, 310), other])
    line = shapely.LineString([(300, -300, 7), (500, -300, 9)])
    found = ccm_opt.obstacles_of({"ring": ring, "both": both, "wire": line, "rod": line.buffer(5)}, unit="mm")
    assert [obstacle.name for obstacle in found] == ["ring", "both 1", "both 2", "wire", "rod"]
    assert found[0].core.area == pytest.approx((100**2 - 60**2) * 1e-6)
    assert found[3].core.length == pytest.approx(0.2)
    assert not shapely.has_z(found[3].core)
    assert [each.core.geom_type for each in made(obstacles=[ring, line, line.buffer(5)]).workspace.obstacles] == [
        "Polygon",
        "LineString",
        "Polygon",
    ]


def test_holes_of_a_room_are_obstacles() -> None:
    """A room with a pillar keeps it."""
    room = shapely.box(-300, -400, 800, 600).difference(shapely.box(500, -300, 600, -200))
    problem = made(room=room, obstacles=[shapely.box(100, 300, 150, 350)])
    assert [obstacle.name for obstacle in problem.workspace.obstacles] == ["hole 1", "obstacle 2"]
    assert not problem.workspace.boundary.interiors


@pytest.mark.parametrize(
    ("shape", "line"),
    [
        (shapely.Point(1, 2), "'obstacle 1': a Point has no size"),
        (shapely.Polygon(), "the Polygon is empty"),
        (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), "not valid: Self-intersection"),
        (shapely.LineString([(0, 0), (float("inf"), 1)]), "coordinate that is not finite"),
        ("wall", "expected a geometry, a list of them, or names with them, got str 'wall'"),
        ([None], "'obstacle 1': expected a geometry of shapely"),
        (7, "got int 7"),
    ],
)
def test_what_is_no_obstacle_is_refused(shape: Any, line: str) -> None:
    """By itself and within a problem, in the same words."""
    with pytest.raises(ccm_opt.ProblemError, match=line):
        ccm_opt.obstacles_of(shape)
    assert line in refused(obstacles=shape)


def test_every_defect_is_told_at_once_under_its_key_in_the_unit_of_the_call() -> None:
    """The list is that of a file: keys, values as they were given, rules between parts."""
    said = refused(
        arm={"links": 3, "link_length": 50, "radius": -4, "base": (0, 0), "joint_limit_deg": 60, "colour": "red"},
        obstacles=[{"circle": {"center": (900, 900), "radius": 0}}, None],
        start="bent",
        limits={"velocity": 1.0},
        planner=3,
    )
    for line in (
        "arm.links: expected an even number of links",
        "arm.radius: expected a number of at least 0, got -4",
        "arm.colour: unknown key 'colour'",
        "workspace.obstacles[0].circle.radius: expected a number greater than 0",
        "'obstacle 2': expected a geometry",
        "start.shape: expected 'straight' or 'folded', got 'bent'",
        "limits.acceleration: missing",
        "planner: expected a table, got 3",
    ):
        assert line in said
    post = {"circle": {"center": (0, 0), "radius": 50}}
    assert "the base is 50 mm inside 'post'" in refused(obstacles={"post": post})


def test_parts_of_a_wrong_type_are_refused_in_words() -> None:
    """A list where an arm is meant, nothing where a goal is, a unit that nobody knows."""
    with pytest.raises(ccm_opt.ProblemError, match="one of m, mm, in for unit=, got str 'cm'"):
        made(unit="cm")
    with pytest.raises(ccm_opt.ProblemError, match=r"ccm_opt\.Arm\.snake"):
        made(arm=[1])
    assert "goal: missing" in refused(goal=None)
    assert "workspace.bounds: expected" in refused(room="everywhere")
    assert "goal: expected" in refused(goal=4)


def test_a_made_problem_is_written_and_read_in_its_unit() -> None:
    """The record of a made problem is a problem file in the same unit that makes the same problem."""
    problem = made(obstacles=[shapely.box(100, 300, 150, 350)], simulation=SimulationOptions(bandwidth=40.0))
    data = problem_data(problem)
    assert data["units"] == "mm"
    assert data["arm"]["radius"] == 20.0  # type: ignore[index]
    assert_same(problem_data(problem_from_mapping(data)), data)
