"""Gates with hardly any play: straight runs through them, rails, sliding out, and plans at the edge of the possible."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.polyline import leg_headings, without_repeats
from ccm_opt.planning.curve_routes import find_routes, route_room, tip_paths_along
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.limits import gate_rails
from ccm_opt.planning.limits.gate_rails import GateLines, GateRails
from ccm_opt.planning.settings import StepSettings
from ccm_opt.problem import JointPose
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.free_space_settings import FINE_FREE_SPACE
from ccm_opt.scene.narrow_gates import GateRuns
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.edge_scenes import ROOM, edge_problem
from tests.planned_runs import run
from tests.scenes import clutter, make_stepper, motion_task

RADIUS = 0.02
RUNS = GateRuns(4e-3, 0.05, np.array([-1.0, 0.0]), 0.03)
WALL_X = 0.4


def gate(middle: float, half: float, *, thick: float = 0.02) -> Workspace:
    """A wall across the room with one gate."""
    sides = (
        shapely.box(WALL_X, middle + half, WALL_X + thick, 1.4),
        shapely.box(WALL_X, -1.4, WALL_X + thick, middle - half),
    )
    return Workspace(ROOM, tuple(Obstacle(f"side {k}", PlaneShape(side)) for k, side in enumerate(sides)))


@given(
    middle=st.floats(-0.5, 0.5), play=st.floats(1e-4, 1.5e-3), y=st.floats(-0.8, 0.8), end=st.floats(-0.8, 0.8)
)  # fmt: skip
def test_paths_run_square_through_narrow_gates(middle: float, play: float, y: float, end: float) -> None:
    """A path keeps its ends and stays free; in the gate and a run before and behind it it lies square to the wall."""
    room = FreeSpace(gate(middle, RADIUS + play), RADIUS + 1e-6, gate_runs=RUNS)
    path = room.taut_path(np.array([[-0.2, y], [WALL_X + 0.01, middle], [1.0, end]]), shrink=0.016)
    np.testing.assert_allclose(path[[0, -1]], [[-0.2, y], [1.0, end]])
    line = shapely.LineString(path)
    assert room.polygons.buffer(1e-9).covers(line)
    run_on = shapely.intersection(line, shapely.box(WALL_X - RUNS.run, -2.0, WALL_X + 0.02 + RUNS.run, 2.0))
    heights = shapely.get_coordinates(run_on)[:, 1]
    np.testing.assert_allclose(heights, middle, atol=1e-6)


def test_wide_gates_leave_paths_taut() -> None:
    """Where there is play the path is the shortest, as without runs."""
    workspace = gate(0.3, RADIUS + 5e-3)
    line = np.array([[-0.2, 0.0], [WALL_X + 0.01, 0.3], [1.0, 0.0]])
    plain = FreeSpace(workspace, RADIUS).taut_path(line)
    np.testing.assert_array_equal(FreeSpace(workspace, RADIUS, gate_runs=RUNS).taut_path(line), plain)


def test_space_beside_the_base_is_no_gate() -> None:
    """Narrow space between a wall and the base, which is punctured, asks for no straight run."""
    beside = replace(RUNS, base=np.array([WALL_X, 0.3 + RADIUS]), about_base=0.1)
    workspace = gate(0.3, RADIUS + 1e-3)
    line = np.array([[-0.2, 0.0], [WALL_X + 0.01, 0.3], [1.0, 0.0]])
    plain = FreeSpace(workspace, RADIUS).taut_path(line)
    np.testing.assert_array_equal(FreeSpace(workspace, RADIUS, gate_runs=beside).taut_path(line), plain)


@given(st.floats(0.0, 2.0 * np.pi), st.floats(0.005, 0.1))
def test_fine_corners_give_next_to_nothing_away(angle: float, size: float) -> None:
    """Drawn finely, a corner keeps every place that is a thousandth of the inflation farther off than it must be."""
    corner = shapely.Polygon([(0.0, 0.0), (size, 0.4 * size), (size, -0.4 * size)])
    free = FreeSpace(Workspace(ROOM, (Obstacle("corner", PlaneShape(corner)),)), RADIUS, settings=FINE_FREE_SPACE)
    place = np.array([[np.cos(angle), np.sin(angle)]]) * 1.0
    there = shapely.shortest_line(shapely.Point(place[0]), corner).coords
    nearest = np.array(there[1])
    away = (place[0] - nearest) / np.hypot(*(place[0] - nearest))
    assert free.contains((nearest + 1.001 * RADIUS * away)[None]).all()
    assert not free.contains((nearest + 0.999 * RADIUS * away)[None]).any()


def test_rails_pull_across_and_refuse_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rail beside an arm in no gate has no rows; its pull is zero on it, and draws a joint square towards it."""
    monkeypatch.setattr(gate_rails, "_BESIDE", 0.1)
    stepper, pose = make_stepper(clutter(1))
    space = stepper.space
    along = (pose.points[8] - pose.points[7]) / space.arm.link_length
    normal = np.array([-along[1], along[0]])
    rail = np.array([pose.points[7] - 1e-3 * along, pose.points[8] + 1e-3 * along]) + 2e-3 * normal
    far = GateLines.from_rails((np.array([[-1.1, 1.0], [-1.0, 1.0], [-0.9, 1.0]]),), clutter(1).workspace)
    limit = GateRails((rail,), far, 0.0)
    rows = limit.linearised(space, pose, 0.1)
    assert len(rows.matrix) == 0
    (pull,) = rows.pulls
    np.testing.assert_allclose(pull.target, 2e-3 / space.nominal_length, rtol=1e-6)
    expected = normal @ pose.moving[7] / space.nominal_length
    assert any(np.allclose(row, expected) for row in pull.rows)
    on_it = GateRails((rail - 2e-3 * normal,), far, 0.0)
    np.testing.assert_allclose(on_it.linearised(space, pose, 0.1).pulls[0].target, 0.0, atol=1e-9)


@given(st.floats(1e-4, 1.0))
def test_steps_narrow_with_the_margin(margin: float) -> None:
    """Wide margins leave the step's numbers alone; narrower ones shorten turns by their root and push as hard."""
    usual = StepSettings()
    narrowed = usual.narrowed(margin)
    if margin >= usual.narrow_margin:
        assert narrowed is usual
        return
    share = margin / usual.narrow_margin
    assert narrowed.largest_turn == pytest.approx(usual.largest_turn * np.sqrt(share))
    assert narrowed.push_weight * margin == pytest.approx(usual.push_weight * usual.narrow_margin)


def test_gates_are_measured_wherever_they_are() -> None:
    """The gap in gates of 2 to 5 % play is that of the scene, though evenly spread places may miss thin walls."""
    for seed in (1, 2, 4, 8):
        problem = edge_problem("gate", seed)
        task = motion_task(problem)
        places = task.tip_paths[0].gate_places
        assert 0.0 < task.gap_about(places) < 0.051 * problem.arm.radius
        assert task.contact_certificate.spare < task.gap_about(places)


def test_goals_of_the_whole_arm_behind_a_gate_are_not_called_closed() -> None:
    """A pose through a gate of 2 % play has a way of the tip: nothing is said to be narrower than the arm."""
    problems = [edge_problem("gate", seed) for seed in range(40)]
    whole = [problem for problem in problems if isinstance(problem.goal, JointPose)]
    assert whole
    for problem in whole:
        ends = resolve_ends(problem)
        assert tip_paths_along(problem, ends, (), route_room(problem, ends))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [2, 3])
def test_gates_of_two_to_five_percent_play_are_passed(seed: int) -> None:
    """A gate with hardly any play is passed, and the timed motion verified."""
    assert run(edge_problem("gate", seed, 900.0), optimised=False).outcome == "verified"


@pytest.mark.drawn(2)
@pytest.mark.parametrize("seed", [0, 1, 5, 9])
def test_joints_go_to_their_limits(seed: int) -> None:
    """A goal with every joint at 0.999 of its limit is reached, and the timed motion verified."""
    assert run(edge_problem("limit-arc", seed, 900.0), optimised=False).outcome == "verified"


@pytest.mark.drawn(2)
@pytest.mark.parametrize("family", ["at-wall", "at-corner"])
@pytest.mark.parametrize("seed", [1, 3])
def test_starts_in_contact_with_a_side_or_a_corner_are_left(family: str, seed: int) -> None:
    """An arm that touches a wall with one link, flat or at a corner, comes away from it."""
    assert run(edge_problem(family, seed, 900.0), optimised=False).outcome == "verified"


def test_paths_through_doors_have_their_rails() -> None:
    """Every door on a route has one rail, straight through it, on the tip's path."""
    problem = edge_problem("doors", 3)
    ends = resolve_ends(problem)
    room = route_room(problem, ends)
    doors = len(problem.workspace.obstacles) // 2
    for path in tip_paths_along(problem, ends, find_routes(problem, ends, room), room):
        assert len(path.rails) == doors
        for rail in path.rails:
            turns = np.diff(np.unwrap(leg_headings(without_repeats(rail, 1e-9))))
            assert np.all(np.abs(turns) < 0.05)
