"""Motions under own constraints and costs: what is asked holds at 1 kHz, what is soft is told, what is dear avoided."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import MotionNotFound, NoPlanFound
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.quantities import Quantities
from ccm_opt.ik.terms import Constraint, Cost, Interval
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.limits.user_motion_rows import UserCosts
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.path_on_limits import moved_onto
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import Check, JointPath, JointTrajectory, Solution
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration

from .conftest import PROBLEMS

ALLOWED = 1e-6


def reaching(x: float, y: float) -> Problem:
    """The open space with another goal for the tip."""
    problem = ccm_opt.load_problem(PROBLEMS / "open-space.toml")
    return replace(problem, goal=TipGoal(np.array([x, y])), planner=replace(problem.planner, time_limit=900.0))


def start_tip(problem: Problem) -> tuple[FloatArray, float]:
    """Position and heading of the tip at the start."""
    headings = problem.start.headings(problem.arm)
    return problem.arm.joint_positions(headings)[-1], float(headings[-1])


def tips(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Tip positions and headings at 1 kHz, by an interpolation that shares nothing with the package's check."""
    trajectory, arm = solution.trajectory, solution.problem.arm
    time = np.linspace(0.0, trajectory.duration, int(1000 * trajectory.duration) + 1)
    bends = CubicHermiteSpline(trajectory.time, trajectory.bend_angles, trajectory.bend_velocities)(time)
    headings = arm.headings(bends)
    return arm.joint_positions(headings)[:, -1], headings[:, -1]


def check_of(solution: Solution, name: str) -> Check:
    """One check by name."""
    return next(check for check in solution.checks if check.name == name)


@pytest.mark.drawn(3, of="terms of a motion")
def test_an_equation_holds_all_the_way() -> None:
    """A camera at the tip looks at one point from the start to the goal."""
    problem = reaching(0.4, 0.7)
    tip, heading = start_tip(problem)
    seen = tip + 0.5 * np.array([np.cos(heading), np.sin(heading)])

    def aside(q: Quantities) -> object:
        way = ca.DM(seen) - q.tip
        return way[0] * ca.sin(q.tip_heading) - way[1] * ca.cos(q.tip_heading)

    solution = ccm_opt.solve(problem, constraints=[Constraint("look at it", aside, lower=0.0, upper=0.0)])
    positions, headings = tips(solution)
    off = (seen - positions)[:, 0] * np.sin(headings) - (seen - positions)[:, 1] * np.cos(headings)
    assert np.abs(off).max() <= 1.2 * ALLOWED  # the oracle's interpolation adds to it
    assert check_of(solution, "constraint look at it").worst <= ALLOWED
    assert np.hypot(*(positions[-1] - problem.goal.position)) < 1e-6


@pytest.mark.drawn(3, of="terms of a motion")
def test_a_given_tip_path_is_followed() -> None:
    """The tip runs along a curve that is given over the path parameter."""
    goal = np.array([0.7, 0.25])
    problem = reaching(*goal)
    tip, _ = start_tip(problem)

    def off(q: Quantities) -> object:
        u = q.path_parameter
        return q.tip - (ca.DM(tip) + u * ca.DM(goal - tip) + 0.05 * ca.sin(2.0 * np.pi * u) * ca.DM([1.0, 0.0]))

    solution = ccm_opt.solve(problem, constraints=[Constraint("tip path", off, lower=0.0, upper=0.0)])
    positions, _ = tips(solution)
    u = np.linspace(0.0, 1.0, 20001)
    curve = tip + u[:, None] * (goal - tip) + 0.05 * np.sin(2.0 * np.pi * u)[:, None] * np.array([1.0, 0.0])
    legs = np.linalg.norm(positions[:, None] - curve[None, ::50], axis=2).argmin(axis=1) * 50
    near = [
        np.linalg.norm(curve[max(0, k - 60) : k + 61] - p, axis=1).min() for k, p in zip(legs, positions, strict=True)
    ]
    assert max(near) < 3e-5  # the curve's own samples are 4e-5 apart
    assert check_of(solution, "constraint tip path").worst <= ALLOWED


@pytest.mark.drawn(3, of="terms of a motion")
def test_an_interval_binds_only_inside() -> None:
    """A bound over a part of the motion holds there and is not asked for elsewhere."""
    problem = reaching(0.8, 0.1)
    high = Constraint("high", lambda q: q.joint_positions[1, 12], lower=0.42, where=Interval(0.3, 0.6))
    solution = ccm_opt.solve(problem, constraints=[high])
    assert check_of(solution, "constraint high").worst <= ALLOWED
    heights = solution.joint_positions[:, 12, 1]
    assert heights.max() > 0.42
    assert heights[-1] < 0.35


@pytest.mark.drawn(3, of="terms of a motion")
def test_a_goal_constraint_chooses_the_goal_pose() -> None:
    """The tip's heading at the goal becomes what the constraint says, without saying so in the problem."""
    problem = reaching(0.8, 0.1)
    turned = Constraint("turned", lambda q: q.tip_heading, lower=-1.0, upper=-1.0, where="goal")
    solution = ccm_opt.solve(problem, constraints=[turned])
    assert problem.arm.headings(solution.trajectory.bend_angles[-1])[-1] == pytest.approx(-1.0, abs=1e-7)


@pytest.mark.drawn(3, of="terms of a motion")
def test_soft_constraints_are_pulled_at_and_reported() -> None:
    """A heavier weight misses less; what is missed is in the checks and the metrics, and refuses nothing."""
    problem = reaching(0.8, 0.1)
    missed = []
    for weight in (0.0, 200.0):
        soft = Constraint("high", lambda q: q.joint_positions[1, 12], lower=0.4, soft=True, weight=weight)
        solution = ccm_opt.solve(problem, constraints=[soft])
        check = check_of(solution, "soft constraint high")
        expected = (0.4 - solution.joint_positions[:, 12, 1]).max()
        assert check.passed
        assert check.worst == pytest.approx(expected, abs=1e-4)
        assert solution.metrics["residual_high"] == max(check.worst, 0.0)
        missed.append(check.worst)
    assert missed[1] < 0.9 * missed[0]


@pytest.mark.drawn(3, of="terms of a motion")
def test_costs_are_made_small() -> None:
    """The mean of a cost over the motion falls when it is asked for, and stands in the metrics."""
    problem = reaching(0.8, 0.1)
    plain = ccm_opt.solve(problem)
    low = ccm_opt.solve(problem, costs=[Cost("height", lambda q: q.joint_positions[1, 12] ** 2, weight=300.0)])
    mean = [float(np.mean(s.joint_positions[:, 12, 1] ** 2)) for s in (plain, low)]
    assert mean[1] < 0.8 * mean[0]
    assert low.metrics["cost_height"] == pytest.approx(mean[1], rel=0.02)


@pytest.mark.drawn(3, of="terms of a motion")
def test_an_impossible_constraint_is_named_in_the_diagnosis() -> None:
    """Where no motion is found, the diagnosis names the constraint that stood in the way."""
    problem = reaching(0.8, 0.1)
    problem = replace(problem, planner=replace(problem.planner, time_limit=2.0))
    high = Constraint("stay high", lambda q: q.joint_positions[1, 8:17], lower=0.3)
    with pytest.raises(NoPlanFound, match="constraint 'stay high'"):
        ccm_opt.solve(problem, constraints=[high], explain=False)
    apart = Constraint("apart", lambda q: q.tip[0], lower=5.0, upper=5.0, where=Interval(0.5, 0.9))
    with pytest.raises(NoPlanFound, match="constraint 'apart' could not be met"):
        ccm_opt.solve(problem, constraints=[apart], explain=False)
    # What holds at the goal too is refuted before any search.
    to_the_end = replace(apart, where=Interval(0.5, 1.0))
    with pytest.raises(NoPlanFound, match="constraint 'apart' cannot hold at the goal"):
        ccm_opt.solve(problem, constraints=[to_the_end], explain=False)


@dataclass(frozen=True)
class Straight:
    """A planner that interpolates joint angles."""

    end: FloatArray

    def plan(self, problem: Problem) -> JointPath:
        """Straight through joint space."""
        arm = problem.arm
        u = np.linspace(0.0, 1.0, 5)
        start = resolve_ends(problem).start
        keyframes = start + u[:, None] * (self.end - start)
        curve = Configuration.chain(arm.base, arm.base_heading, [arm.length], [np.zeros(5)])
        return JointPath(make_interp_spline(u, keyframes, k=3), keyframes, (curve,) * 5, "straight")


@dataclass(frozen=True)
class Slow:
    """Times a path by a fifth-degree polynomial over ten seconds."""

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """From rest to rest."""
        del problem
        time = np.linspace(0.0, 10.0, 2501)
        t = np.polynomial.Polynomial([0, 0.1])
        s = 10 * t**3 - 15 * t**4 + 6 * t**5
        u, v, a = (p(time)[:, None] for p in (s, s.deriv(), s.deriv(2)))
        q, slope, curve = (path.spline(u[:, 0], nu) for nu in range(3))
        return JointTrajectory(time, q, slope * v, curve * v**2 + slope * a)


@pytest.mark.drawn(3, of="terms of a motion")
def test_own_stages_are_held_against_own_constraints() -> None:
    """Another planner and another timing are used, and their plan is refused where it breaks a constraint."""
    problem = reaching(0.8, 0.1)
    end = ccm_opt.solve(problem).trajectory.bend_angles[-1]
    solution = ccm_opt.solve(problem, planner=Straight(end), retimer=Slow())
    assert solution.trajectory.duration == pytest.approx(10.0)
    assert solution.path.candidate == "straight"
    high = Constraint("high", lambda q: q.joint_positions[1, 12], lower=0.31)
    with pytest.raises(MotionNotFound, match="constraint high"):
        ccm_opt.solve(problem, planner=Straight(end), retimer=Slow(), constraints=[high], explain=False)


def arm() -> Arm:
    """The arm of the open space."""
    return reaching(0.8, 0.1).arm


def test_points_are_moved_onto_equations_by_the_least_change() -> None:
    """The result lies on the equation, and its change is along the equation's slope."""
    terms = compile_terms(arm(), [Constraint("x", lambda q: q.tip[0], lower=0.5, upper=0.5)], [])
    q = arm().bends(np.linspace(0.3, 1.2, arm().links))
    moved = moved_onto((UserLimit(terms),), arm().bend_limits, np.ones_like, q, 0.0)
    assert moved is not None
    assert arm().joint_positions_at(moved)[-1, 0] == pytest.approx(0.5, abs=1e-9)
    slope = terms.motion_rows.at(0.5 * (q + moved)).equation_slopes[0]
    change = moved - q
    assert abs(slope @ change) > 0.999 * np.linalg.norm(slope) * np.linalg.norm(change)


def test_models_of_costs_are_those_of_differences() -> None:
    """Gradient and Hessian of own costs over the keyframes agree with finite differences where they are convex."""
    space, v = LinkSpace.through(arm(), arm().bends(np.linspace(1.4, 0.6, arm().links)))
    soft = Constraint("right", lambda q: q.tip, lower=[0.9, 0.0], upper=[1.0, 2.0], soft=True, weight=3.0)
    cost = Cost("turn", lambda q: q.path_parameter * q.tip_heading**2, weight=0.7, where=Interval(0.4, 1.0))
    costs = UserCosts(compile_terms(arm(), [soft], [cost]), np.linspace(0.0, 1.0, 4))
    rng = np.random.default_rng(5)
    coordinates = v + 0.02 * rng.normal(size=(4, len(v)))
    step = 1e-5 * rng.normal(size=coordinates.shape)
    step[0] = 0.0
    sweeps = [PlanarSweep(space, coordinates + sign * step) for sign in (-1, 0, 1)]
    before, at, after = (costs.value(sweep) for sweep in sweeps)
    model = costs.model(sweeps[1])
    assert float(np.vdot(model.gradient, step)) == pytest.approx(0.5 * (after - before), rel=1e-5)
    assert at > 0.0
    assert costs.predicted(sweeps[1], step) == pytest.approx(after, rel=1e-7)
