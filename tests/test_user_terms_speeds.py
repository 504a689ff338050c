"""Users' constraints on speeds: held against the finished motion, refused where a path has none."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import MotionNotFound, ProblemError
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.functions import MotionStates
from ccm_opt.ik.terms import Constraint, Cost, Interval
from ccm_opt.problem import PointLimit, Problem
from ccm_opt.robot.points import point_at_arc_length


def slow_tip(most: float, **options: object) -> Constraint:
    """The tip is never faster."""
    return Constraint("slow tip", lambda q: ca.norm_2(q.tip_velocity), upper=most, **options)


def test_velocities_are_those_of_the_arm(small_problem: Problem) -> None:
    """The symbolic velocity of a point is that of the numeric kinematics, at random places and rates."""
    arm = small_problem.arm
    rng = np.random.default_rng(3)
    q, qd = rng.normal(size=(2, 5, arm.links))
    for s, point in (
        (arm.length, point_at_arc_length(arm, None)),
        (0.23, point_at_arc_length(arm, 0.23)),
    ):
        term = Constraint("velocity", lambda q, s=s: q.point_velocity(s), lower=0.0, upper=0.0)
        (timed,) = compile_terms(arm, [term], []).timed
        rest = np.zeros(5)
        states = MotionStates(q, rest, qd, rest)
        expected = np.max(np.abs(point.velocity(q, qd)), axis=1)
        np.testing.assert_allclose(timed.excesses(states), expected, atol=1e-12)


def test_a_motion_that_is_too_fast_is_refused_and_a_limited_one_is_not(small_problem: Problem) -> None:
    """The constraint refuses the fastest motion, and says so by name; it accepts one that a limit slows down."""
    with pytest.raises(MotionNotFound, match="constraint slow tip"):
        ccm_opt.solve(small_problem, constraints=[slow_tip(0.1)], explain=False)
    limited = replace(small_problem, limits=replace(small_problem.limits, points=(PointLimit(None, 0.1),)))
    solution = ccm_opt.solve(limited, constraints=[slow_tip(0.1)])
    check = next(check for check in solution.checks if check.name == "constraint slow tip")
    assert check.passed
    assert solution.metrics["residual_slow_tip"] <= 1e-6


def test_speeds_may_be_bounded_on_a_part_of_the_motion(small_problem: Problem) -> None:
    """In an interval of the motion the bound is held against the samples of that interval only."""
    solution = ccm_opt.solve(small_problem, constraints=[slow_tip(1e-3, where="goal"), slow_tip_late()])
    assert solution.metrics["residual_slow_tip"] <= 1e-6
    assert solution.metrics["residual_late"] == 0.0


def slow_tip_late() -> Constraint:
    """A bound that no motion of the small problem comes near, on the second half."""
    return Constraint("late", lambda q: ca.norm_2(q.tip_velocity), upper=50.0, where=Interval(0.5, 1.0))


@pytest.mark.parametrize(
    ("options", "message"), [({"soft": True}, "no speed yet"), ({"where": "keyframes"}, "no speed")]
)
def test_what_shapes_the_path_may_hold_no_speed(
    small_problem: Problem, options: dict[str, object], message: str
) -> None:
    """Soft constraints and those on keyframes are refused by name, with what to do instead."""
    with pytest.raises(ProblemError, match=f"'slow tip'.*{message}"):
        compile_terms(small_problem.arm, [slow_tip(0.1, **options)], [])


def test_a_cost_may_hold_no_speed(small_problem: Problem) -> None:
    """A cost on speed is refused, and the limits are named that slow a motion down."""
    with pytest.raises(ProblemError, match=r"cost 'speed'.*limits\.tip_velocity"):
        compile_terms(small_problem.arm, [], [Cost("speed", lambda q: ca.sumsqr(q.tip_velocity))])
