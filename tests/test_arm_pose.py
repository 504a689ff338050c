"""The goal-pose NLP: its rows against independent oracles, and the poses that it finds."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.lifted_curve import LiftedCurve
from ccm_opt.ik.link_frames import PlanarFrames
from ccm_opt.ik.pose_program import HoldingLoads
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.segment import PIECES, second_derivatives
from ccm_opt.scene.workspace import Obstacle, PlaneShape

from .dynamics_arms import swan_neck
from .scenes import Scene, clutter, wall_gaps

SEGMENTS = 3
curvature_values = st.lists(st.floats(-8.0, 8.0), min_size=4 * SEGMENTS + 1, max_size=4 * SEGMENTS + 1)
piece_widths = st.lists(st.floats(0.6, 1.4), min_size=4 * SEGMENTS, max_size=4 * SEGMENTS)


def unit_curve(values: list[float], widths: list[float]) -> Configuration:
    """A curve of length 1 with continuous curvature."""
    shares = np.array(widths).reshape(SEGMENTS, PIECES) / np.sum(widths)
    lengths = shares.sum(axis=1)
    knots = [tuple((np.cumsum(row)[:-1] / row.sum()).tolist()) for row in shares]
    curvatures = [np.array(values[4 * k : 4 * k + 5]) for k in range(SEGMENTS)]
    return Configuration.chain(np.zeros(2), 0.3, lengths.tolist(), curvatures, knots)  # type: ignore[arg-type]


def lifted_values(configuration: Configuration) -> np.ndarray:
    """The symbols' values on a curve, from the continuum's own spline and integrals."""
    arcs = configuration.breakpoints
    values = np.array([segment.curvature for segment in configuration.segments])
    widths = np.diff(arcs).reshape(-1, PIECES)
    moments = np.concatenate([second_derivatives(a, c)[1:-1] for a, c in zip(widths, values, strict=True)])
    return np.concatenate(
        (
            arcs,
            np.append(values[:, :-1].ravel(), values[-1, -1]),
            configuration.heading_at(arcs),
            configuration.heading_integral_at(arcs),
            moments / LiftedCurve(SEGMENTS).moment_scale,
        )
    )


@cache
def curve_rows() -> ca.Function:
    """Spline equations, gap closing and knot spacing of a curve."""
    curve = LiftedCurve(SEGMENTS)
    return ca.Function("rows", [curve.variables], [block.expression for block in curve.rows()])


@cache
def rows_of_mapping(links: int) -> ca.Function:
    """The mapping's ties, and what keeps joints among their pieces."""
    frames = PlanarFrames(links, segments=SEGMENTS)
    _, ties = frames.link_rows()
    kept = frames.followed.joints.joint_order_rows()
    return ca.Function("rows", [frames.followed.parts[0].variables, frames.lies], [ties.expression, kept.expression])


@given(curvature_values, piece_widths)
def test_the_curve_of_the_paper_solves_the_rows_of_the_curve(values: list[float], widths: list[float]) -> None:
    """Spline equations and gap-closing rows vanish on every natural five-point spline, whatever its knots."""
    found = curve_rows()(lifted_values(unit_curve(values, widths)))
    assert np.abs(np.asarray(found[0])).max() < 1e-9
    assert np.abs(np.asarray(found[1])).max() < 1e-9
    assert np.asarray(found[2]).min() > 0.0


@given(curvature_values, piece_widths, st.sampled_from([6, 12, 24]))
def test_the_mapping_is_the_mean_heading_over_each_link(values: list[float], widths: list[float], links: int) -> None:
    """Rows of the mapping vanish where link headings are the curve's mean headings, though knots have moved."""
    configuration = unit_curve(values, widths)
    integrals = configuration.heading_integral_at(np.linspace(0.0, 1.0, links + 1))
    found = rows_of_mapping(links)(lifted_values(configuration), np.diff(integrals) * links)
    if np.asarray(found[1]).min() >= 0.0:  # every joint lies among the pieces that its row looks at
        assert np.abs(np.asarray(found[0])).max() < 1e-9


@given(curvature_values)
def test_even_knots_lie_within_the_windows(values: list[float]) -> None:
    """The rows that keep joints among their pieces hold at even knots, from which every solution starts."""
    even = unit_curve(values, [1.0] * (4 * SEGMENTS))
    assert np.asarray(rows_of_mapping(24)(lifted_values(even), np.zeros(24))[1]).min() > 0.0


@pytest.mark.parametrize("payload", [0.0, 0.4])
def test_holding_torques_are_those_of_the_inverse_dynamics_at_rest(payload: float) -> None:
    """The rows' static torques equal the Newton–Euler torques of the bends at rest, payload included."""
    arm = replace(swan_neck(8, varied=True), payload=payload)
    gravity = np.array([0.0, 0.0, -9.81])
    bends = np.random.default_rng(3).uniform(-0.4, 0.4, 8)
    angles = revolute_angles(arm, bends[None])
    wanted = InverseDynamics(arm, gravity)(angles, 0.0 * angles, 0.0 * angles)[0, 1::3]
    points = ca.DM(arm.joint_positions(arm.headings(bends)).T)
    weights = ca.DM(gravity[[0, 2]]) @ ca.DM(arm.masses).T
    forces = (ca.SX(weights), ca.SX(payload * ca.DM(gravity[[0, 2]])), ca.SX.ones(1, arm.links))
    _, shares = HoldingLoads(ca.SX(points), (ca.SX.ones(1, arm.links),), *forces).values()
    torques = ca.evalf(shares)
    # A drive bears minus what gravity does; the ball's second revolute turns against the bend.
    assert np.asarray(torques).ravel() == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_room_in_the_regions_is_room_to_the_walls(seed: int) -> None:
    """A pose has at least as much room to the walls as its links have in regions drawn about any other pose."""
    scene = clutter(90_000 + seed, 20)
    arm = scene.arm
    rng = np.random.default_rng(seed)
    regions = searched(scene).regions(arm.bends(scene.start), PoseSettings())
    shares = np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)
    for _ in range(20):
        points = arm.joint_positions(scene.start + 0.05 * rng.standard_normal(arm.links))
        inside = regions.gap(shares, points)
        if inside > 0.0:
            assert wall_gaps(arm, scene.workspace, points).min() > inside - 1e-9


def searched(scene: Scene) -> GoalPoses:
    """The search for the goal pose of a scene."""
    problem = scene.problem()
    return poses_at_goal(problem, resolve_ends(problem), resolve_ends(problem).start)


@pytest.mark.parametrize("seed", range(4))
def test_poses_are_at_the_goal_within_limits_and_have_room(seed: int) -> None:
    """What the NLP returns needs no repair: the tip at the goal, every joint within its limit, the wanted gap kept."""
    scene = clutter(91_000 + seed, 20)
    search = searched(scene)
    arm = search.problem.arm
    pose = search.best(scene.arm.bends(scene.goal))
    assert pose is not None
    assert arm.joint_positions(pose.headings)[-1] == pytest.approx(search.target.position, abs=1e-9)
    assert np.all(np.abs(arm.bends(pose.headings)) <= arm.bend_limits)
    assert search.gap(pose.q) >= pose.gap - 1e-6 * arm.length
    assert pose.gap >= min(search.wanted_gap, search.gap(scene.arm.bends(scene.goal))) - 1e-6 * arm.length
    assert sum(pose.answer.costs.values()) == pytest.approx(pose.answer.cost)


def test_parts_of_the_objective_are_what_they_are_called() -> None:
    """Distance and bending, weighted, are those of the pose, reckoned without the program."""
    scene = clutter(91_000, 20)
    search = searched(scene)
    pose = search.best(scene.arm.bends(scene.goal))
    assert pose is not None
    settings = search.settings
    assert search.near is not None
    turned = pose.q - search.near
    assert pose.answer.costs["distance"] == pytest.approx(settings.distance_weight * np.sum(turned**2))
    arcs = np.linspace(0.0, pose.curve.length, 20_001)
    bending = np.trapezoid(pose.curve.curvature_at(arcs) ** 2, arcs) * pose.curve.length
    assert pose.answer.costs["bending"] == pytest.approx(settings.bending_weight * bending, rel=1e-4)


def test_sides_that_are_left_out_follow_from_those_that_are_kept() -> None:
    """A region of the sides that are kept is, near its link, within every side that could have been drawn."""
    scene = clutter(91_004, 40)
    arm = scene.arm
    settings = PoseSettings()
    points = arm.joint_positions(scene.goal)
    regions = searched(scene).regions(arm.bends(scene.goal), settings)
    rng = np.random.default_rng(5)
    moved = points[:, None] + settings.reach * rng.uniform(-1.0, 1.0, (arm.links + 1, 4000, 2)) / np.sqrt(2.0)
    for link in range(arm.links):
        own = regions.joint == link
        inside = np.all(moved[link] @ regions.normals[own].T >= regions.offsets[own], axis=1)
        if link * arm.link_length > arm.mount_length:
            places = shapely.points(moved[link][inside])
            gaps = [shapely.distance(places, wall.core) - wall.rounding for wall in scene.workspace.walls]
            assert np.min(gaps) >= arm.radius - 1e-9


@pytest.mark.parametrize("seed", [90_600, 90_601, 90_603])
def test_links_that_stray_beyond_their_regions_touch_nothing(seed: int) -> None:
    """A wall so far away that no region knows of it is avoided all the same when the best pose would lie in it."""
    scene = clutter(seed, 0)
    free = searched(scene).best(scene.arm.bends(scene.goal))
    assert free is not None
    axis = shapely.LineString(scene.arm.joint_positions(scene.goal))
    points = scene.arm.joint_positions(free.headings)
    far = shapely.distance(shapely.points(points), axis)
    post = Obstacle("post", PlaneShape(shapely.Point(points[int(far.argmax())]), 0.01))
    walled = searched(replace(scene, workspace=replace(scene.workspace, obstacles=(post,))))
    short = replace(walled, settings=PoseSettings(reach=0.3 * float(far.max())))
    pose = short.solved(scene.arm.bends(scene.goal))
    assert short.feasible(pose)
    assert wall_gaps(scene.arm, short.problem.workspace, scene.arm.joint_positions(pose.headings)).min() > 0.0


def test_the_curve_maps_to_the_links_of_the_pose() -> None:
    """The pose's links have the mean headings of the pose's curve."""
    scene = clutter(91_000, 20)
    search = searched(scene)
    pose = search.best(scene.arm.bends(scene.goal))
    assert pose is not None
    arcs = np.linspace(0.0, pose.curve.length, len(pose.headings) + 1)
    means = np.diff(pose.curve.heading_integral_at(arcs)) / search.problem.arm.link_length
    assert means == pytest.approx(pose.headings, abs=1e-6)


def test_a_users_constraint_is_a_row_with_a_multiplier() -> None:
    """A hard constraint at the goal holds in the pose, and where it costs something its multiplier says how much."""
    scene = clutter(91_001, 20)
    problem = scene.problem()
    ends = resolve_ends(problem)
    free = poses_at_goal(problem, ends, ends.start).best(scene.arm.bends(scene.goal))
    assert free is not None
    middle = problem.arm.joint_positions(free.headings)[12]
    aside = Constraint("middle aside", lambda q: q.joint_positions[1, 12], lower=float(middle[1]) + 0.01, where="goal")
    terms = compile_terms(problem.arm, [aside], [])
    held = poses_at_goal(problem, ends, ends.start, terms).best(scene.arm.bends(scene.goal))
    assert held is not None
    assert problem.arm.joint_positions(held.headings)[12, 1] >= middle[1] + 0.01 - 1e-6
    assert held.answer.multipliers["user: middle aside"] > 0.0
    assert held.answer.cost > free.answer.cost


def test_a_users_cost_shapes_the_pose() -> None:
    """A cost at the goal is a part of the objective, and lowers what it is put on."""
    scene = clutter(91_002, 20)
    problem = scene.problem()
    ends = resolve_ends(problem)
    free = poses_at_goal(problem, ends, ends.start).best(scene.arm.bends(scene.goal))
    cost = Cost("low middle", lambda q: q.joint_positions[1, 12], weight=100.0, where="goal")
    terms = compile_terms(problem.arm, [], [cost])
    costly = poses_at_goal(problem, ends, ends.start, terms).best(scene.arm.bends(scene.goal))
    assert free is not None
    assert costly is not None
    height = problem.arm.joint_positions(free.headings)[12, 1]
    assert problem.arm.joint_positions(costly.headings)[12, 1] < height - 1e-3
    assert "user: low middle" in costly.answer.costs


def test_a_contradiction_names_the_row() -> None:
    """A constraint that no pose can keep leaves a solution that is not feasible and names a row that is broken."""
    scene = clutter(91_003, 20)
    problem = scene.problem()
    far = Constraint("tip far away", lambda q: q.tip[0], lower=100.0, where="goal")
    search = poses_at_goal(
        problem, resolve_ends(problem), scene.arm.bends(scene.start), compile_terms(problem.arm, [far], [])
    )
    assert search.best(scene.arm.bends(scene.goal)) is None
    assert search.improved(scene.arm.bends(scene.goal))[0].answer.worst_row == "user: tip far away"
