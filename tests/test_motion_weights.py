"""Weights of objectives: each moves its own measure the right way, and what they lead to is certified."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.planning.curve_routes import configuration_task, find_routes, route_room
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.objective import JointSlowness, WallNearness
from ccm_opt.planning.optimisation.optimise import optimise, thinned
from ccm_opt.planning.strategies import find_motion
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import TipGoal, Weights
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.oracles.interior_point import nearness_cost
from tests.scenes import ROOM, Scene, clutter, later, make_arm, motion_task, rows_of, sweep_gaps, wall_gaps

SEED = 50_019
INTERVALS = 20


@cache
def found() -> tuple[Scene, MotionTask, Motion]:
    """A scene of clutter, its task, and the motion before optimisation."""
    scene = clutter(SEED, 20)
    task = replace(motion_task(scene.problem()), optimiser="none")
    return scene, task, find_motion(task)


def optimised(weights: Weights, slowness: JointSlowness | None = None) -> FloatArray:
    """Link headings at evenly spread places of the optimised motion."""
    _, task, motion = found()
    task = replace(task, optimiser="sequential-convex", weights=weights, slowness=slowness, deadline=later())
    result = optimise(motion, task)
    assert len(task.certificate.failures(result.configurations)) == 0
    headings = task.arm.headings(result.configurations)
    at = np.linspace(0.0, len(headings) - 1.0, 400)
    return np.stack([np.interp(at, np.arange(len(headings)), column) for column in headings.T], axis=1)


def travel(headings: FloatArray) -> float:
    """Length of the joint path [rad]."""
    return float(np.linalg.norm(np.diff(np.diff(headings, axis=1), axis=0), axis=1).sum())


def unevenness(headings: FloatArray) -> float:
    """Sum of squared second differences of the joint path [rad²]."""
    bends = np.diff(headings[:: len(headings) // INTERVALS], axis=1)
    return float((np.diff(bends, 2, axis=0) ** 2).sum())


def bending(headings: FloatArray) -> float:
    """Mean squared bend along the motion [rad²]."""
    return float((np.diff(headings, axis=1) ** 2).mean())


def gap(headings: FloatArray) -> float:
    """Mean over the motion of the least gap to a wall, at most 3 % of the arm [m]."""
    scene = found()[0]
    gaps = wall_gaps(scene.arm, scene.workspace, scene.arm.joint_positions(headings))
    return float(np.minimum(gaps.min(axis=1), 0.03).mean())


def test_path_length_weighs_the_joint_path() -> None:
    """With little but its length to make small the joint path is shorter."""
    plain = optimised(Weights())
    assert travel(optimised(Weights(path_length=30.0))) < 0.99 * travel(plain)


def test_smoothness_weighs_second_differences() -> None:
    """A hundred times the smoothness gives a motion of smaller second differences."""
    assert unevenness(optimised(Weights(smoothness=100.0))) < 0.9 * unevenness(optimised(Weights()))


def test_bending_weighs_the_curvature_on_the_way() -> None:
    """A heavy weight on bending leads the arm through straighter shapes."""
    assert bending(optimised(Weights(bending=1e4))) < 0.97 * bending(optimised(Weights()))


def test_clearance_keeps_off_the_walls_and_is_never_less_than_asked() -> None:
    """A weight on clearance widens the mean gap; no motion touches, whatever the weights are."""
    scene = found()[0]
    plain = optimised(Weights())
    wide = optimised(Weights(clearance=10.0))
    assert gap(wide) > 1.3 * gap(plain)
    for headings in (plain, wide):
        assert min(sweep_gaps(scene.arm, scene.workspace, headings)) >= 0.0


def test_duration_spares_slow_joints() -> None:
    """With a weight on the duration joints of a tenth of the speed turn less than without."""
    links = found()[0].arm.links
    slow = np.arange(links) % 2 == 0
    limits = np.where(slow, 0.1, 1.0)
    slowness = JointSlowness.from_limits(limits, limits)

    def slow_turns(headings: FloatArray) -> float:
        bends = np.diff(headings, axis=1, prepend=0.0)[:, slow]
        return float(np.abs(np.diff(bends, axis=0)).sum(axis=0).max())

    assert slow_turns(optimised(Weights(duration=10.0), slowness)) < slow_turns(optimised(Weights(), slowness))


def test_interior_point_weighs_the_same() -> None:
    """The cost of nearness that IPOPT sees has the value that the sequential programming sees."""
    _, task, motion = found()
    sweep = PlanarSweep(motion.curve, thinned(motion, task)[0])
    near = nearness(sweep)
    l = motion.curve.arm.link_length
    points = sweep.points[..., 0].T, sweep.points[..., 1].T
    seen = nearness_cost((near,), tuple(map(ca.DM, points)), ca.DM(sweep.headings.T), l)
    assert float(seen) == pytest.approx(near.value(sweep))


def nearness(sweep: PlanarSweep) -> WallNearness:
    """What nearness to walls costs along a motion."""
    workspace = found()[0].workspace
    rows = rows_of(sweep, workspace, 1e-3, 0.08)
    return WallNearness(rows.take(rows.against_walls), 2.0, 0.04, 1.0)


def test_model_of_nearness_matches_differences() -> None:
    """The gradient of the cost of nearness agrees with central differences of its value."""
    _, task, motion = found()
    sweep = PlanarSweep(motion.curve, thinned(motion, task)[0])
    near = nearness(sweep)
    model = near.model(sweep)
    change = np.random.default_rng(3).normal(size=sweep.unknowns.shape)
    step = 1e-6
    ahead, behind = (near.value(PlanarSweep(motion.curve, sweep.unknowns + s * step * change)) for s in (1.0, -1.0))
    assert np.vdot(model.gradient, change) == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-5)
    assert near.predicted(sweep, np.zeros_like(change)) == pytest.approx(near.value(sweep))


def over_a_box(weights: Weights) -> tuple[FloatArray, float]:
    """Gaps of points of the goal configuration over a box in the arm's way, up to 60 mm [m], and its mean κ² [1/m²]."""
    box = Obstacle("box", PlaneShape(shapely.box(0.3, -0.5, 0.7, 0.08)))
    scene = Scene(make_arm(), Workspace(ROOM, (box,)), np.full(24, 2.0), np.full(24, 0.0))
    problem = scene.problem(TipGoal(np.array([0.955, 0.0])))
    problem = replace(problem, planner=replace(problem.planner, weights=weights))
    ends = resolve_ends(problem)
    room = FreeSpace(problem.workspace, route_room(problem, ends).inflation)
    route = find_routes(problem, ends, room)[0]
    curve = find_configuration(configuration_task(problem, ends, room, route))
    s = np.linspace(0.0, scene.arm.length, 400)
    points = np.asarray(shapely.points(curve.positions_at(s)))
    return np.minimum(shapely.distance(points, box.core), 0.06), float((curve.curvature_at(s) ** 2).mean())


def test_weights_shape_the_goal_configuration() -> None:
    """More weight on bending lowers the energy of the goal configuration, weight on clearance widens its least gap."""
    (gaps, energy), (_, less), (wider, _) = map(
        over_a_box, (Weights(), Weights(bending=100.0), Weights(clearance=10.0))
    )
    assert less < energy
    assert wider.min() > 1.2 * gaps.min()
    assert min(gaps.min(), wider.min()) >= 0.015


def test_negative_weights_are_refused() -> None:
    """A weight below 0 is a ProblemError that names it."""
    problem = found()[0].problem()
    with pytest.raises(ProblemError, match=r"planner\.weights\.clearance"):
        replace(problem, planner=replace(problem.planner, weights=Weights(clearance=-1.0)))
