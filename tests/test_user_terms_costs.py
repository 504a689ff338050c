"""No cost makes a problem fail that is solved without it."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import Diagnosis, UnreachableGoal, VerificationError
from ccm_opt.driver.pipeline import with_lowered_costs
from ccm_opt.ik.compiled_terms import UserTerms, compile_terms
from ccm_opt.ik.terms import Expression
from ccm_opt.problem import Problem

from .camera_room import camera_room, high_tip, valve_in_view, weighted
from .conftest import PROBLEMS


def _shaken(q: ccm_opt.Quantities) -> ca.SX:
    return ca.sin(20.0 * q.tip[0]) + ca.cos(15.0 * q.tip[1])


SHAPES: dict[str, Expression] = {
    "parabola": lambda q: (q.tip[1] - 0.9) ** 2,
    "without a bound": lambda q: -q.point_at(0.6)[0],
    "with a corner": lambda q: ca.fabs(q.tip[1] - 0.5),
    "with waves": _shaken,
    "not finite everywhere": lambda q: ca.sqrt(q.tip[1] - 0.3),
    "of curvature": lambda q: -(q.curvature_at(0.9) ** 2),
    "of the path": lambda q: q.path_parameter * (q.tip[0] - 1.0) ** 2,
}


@pytest.mark.drawn(2, of="costs")
@pytest.mark.planning
@pytest.mark.parametrize("weight", [2.0, 20.0])
def test_a_camera_that_should_be_high_still_finds_its_way(weight: float) -> None:
    """With the valve in view a motion is found whatever the tip's height costs."""
    solution = ccm_opt.solve(
        camera_room(), constraints=[valve_in_view], costs=[weighted(high_tip, weight)], explain=False
    )
    assert solution.metrics["residual_valve_in_view"] <= 1e-6
    assert solution.metrics["cost_share"] == 1.0


@pytest.mark.planning
# A failure would be shrunk for minutes, each of its tries being a whole solve.
@pytest.mark.drawn(2, of="costs")
@settings(
    max_examples=4, suppress_health_check=[HealthCheck.too_slow], phases=(Phase.explicit, Phase.reuse, Phase.generate)
)
@given(st.sampled_from(sorted(SHAPES)), st.floats(-2.0, 4.0), st.sampled_from(["motion", "goal"]))
def test_no_cost_makes_a_solvable_problem_fail(shape: str, exponent: float, where: str) -> None:
    """Whatever its form and its weight, a cost leaves a verified plan that keeps the constraint."""
    cost = ccm_opt.Cost(shape, SHAPES[shape], weight=10.0**exponent, where=where)  # type: ignore[arg-type]
    solution = ccm_opt.solve(camera_room(), constraints=[valve_in_view], costs=[cost], explain=False)
    assert solution.metrics["residual_valve_in_view"] <= 1e-6
    assert all(check.passed for check in solution.checks)


@pytest.mark.drawn(2, of="costs")
@pytest.mark.planning
@pytest.mark.parametrize("name", ["swan-neck", "space/elbow"])
def test_heavy_costs_shape_the_pose_at_the_goal_without_contact(name: str) -> None:
    """However much the user's cost weighs, a pose is found, and one that costs no more than with less weight."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    bends = []
    for weight in (0.0, 1e2, 1e6):
        cost = ccm_opt.Cost("bends", lambda q: ca.sumsqr(q.joint_angles), weight=weight, where="goal")
        bends.append(
            float(np.sum(ccm_opt.find_pose(problem, costs=[cost]).configuration[: len(problem.arm.bend_limits)] ** 2))
        )
    assert bends[2] <= 1.02 * bends[1]
    assert bends[1] < bends[0]


@pytest.mark.drawn(2, of="costs")
@pytest.mark.planning
@pytest.mark.parametrize("weight", [1e4, 1e8])
def test_heavy_costs_are_lowered_along_the_motion(weight: float) -> None:
    """The mean over the motion is less than without the cost."""
    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    found = [
        ccm_opt.solve(problem, costs=[ccm_opt.Cost("bends", lambda q: ca.sumsqr(q.joint_angles), weight=heavy)])
        for heavy in (0.0, weight)
    ]
    assert found[1].metrics["cost_bends"] < 0.9 * found[0].metrics["cost_bends"]


@pytest.mark.drawn(2, of="costs")
def test_costs_of_another_part_of_the_motion_leave_the_goal_pose_as_it_is() -> None:
    """However much they weigh."""
    problem = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")
    early = ccm_opt.Cost("bends", lambda q: ca.sumsqr(q.joint_angles), weight=1e6, where=ccm_opt.Interval(0.0, 0.5))
    found = ccm_opt.find_pose(problem, costs=[early]).configuration
    np.testing.assert_allclose(found, ccm_opt.find_pose(problem).configuration, atol=1e-9)


def terms_with_cost() -> UserTerms:
    """A hard constraint, a soft one and a cost."""
    soft = ccm_opt.Constraint("soft", lambda q: q.tip[0], upper=0.5, soft=True, weight=4.0)
    return compile_terms(camera_room().arm, [valve_in_view, soft], [weighted(high_tip, 20.0)])


def test_costs_are_lowered_until_a_plan_is_found() -> None:
    """Shares are tried from all to none; the first with a plan decides, and hard constraints stay as they are."""
    seen: list[tuple[list[float], int]] = []

    def attempt(problem: Problem, terms: UserTerms | None) -> Any:
        assert terms is not None
        assert problem.planner.time_limit <= camera_room().planner.time_limit
        seen.append(([item.cost.weight for item in terms.all_costs], len(terms.hard)))
        if terms.all_costs:
            raise VerificationError(["wall clearance"])
        return "plan"

    assert with_lowered_costs(camera_room(), terms_with_cost(), attempt) == ("plan", 0.0)
    assert seen == [([20.0, 4.0], 1), ([pytest.approx(2.0), pytest.approx(0.4)], 1), ([], 1)]


def test_with_a_goal_out_of_reach_nothing_is_tried_again() -> None:
    """There is one attempt where no cost can be to blame."""
    calls = 0

    def attempt(*_: object) -> Any:
        nonlocal calls
        calls += 1
        raise UnreachableGoal(Diagnosis("no", "motion"))

    with pytest.raises(UnreachableGoal):
        with_lowered_costs(camera_room(), terms_with_cost(), attempt)
    assert calls == 1


def test_a_cost_that_is_not_finite_somewhere_makes_no_model_there() -> None:
    """Where derivatives are not finite, the model of the costs is that of the others, and stays finite."""
    from ccm_opt.planning.limits.user_motion_rows import UserCosts
    from ccm_opt.planning.link_space import LinkSpace
    from ccm_opt.planning.swept_motion import PlanarSweep

    arm = camera_room().arm
    root = ccm_opt.Cost("root", lambda q: ca.sqrt(q.tip[1] - 0.3), weight=1.0)
    start = np.full(arm.links, -0.1)
    space, v = LinkSpace.through(arm, start)
    sweep = PlanarSweep(space, np.stack((v, v, v)))
    u = np.linspace(0.0, 1.0, 3)
    both = UserCosts(compile_terms(arm, [], [root, high_tip]), u).model(sweep)
    one = UserCosts(compile_terms(arm, [], [high_tip]), u).model(sweep)
    assert arm.joint_positions(start)[-1, 1] < 0.3
    assert np.array_equal(both.gradient, one.gradient)
    assert np.array_equal(both.diagonal, one.diagonal)
