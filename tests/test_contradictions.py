"""Constraints that contradict the goal: proved before the search, or named first after it, never wrongly refused."""

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import Diagnosis, MotionNotFound, UnreachableGoal
from ccm_opt.core.polyline import unit_vector
from ccm_opt.driver.pose_failure import with_constraint_first
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.contradictions import GoalRegion, Intervals, NotBounded, contradictions, interval_values

from .camera_room import camera_room, left_of_the_goal, valve_in_view

if TYPE_CHECKING:
    from ccm_opt.core.progress import Progress

X = ca.SX.sym("x", 2)
FORMS = {
    "sum": X[0] + X[1],
    "difference": X[0] - 2.0 * X[1],
    "product": X[0] * X[1],
    "quotient": X[0] / (X[1] + 10.0),
    "quotient through zero": X[0] / X[1],
    "square": (X[0] - 1.0) ** 2 - X[1],
    "root": ca.sqrt(X[0] + 9.0) * X[1],
    "absolute": ca.fabs(X[0]) - ca.fabs(X[1]),
    "sine": ca.sin(3.0 * X[0]) * ca.cos(X[1]),
    "exponential": ca.exp(0.3 * X[0]) - ca.atan(X[1]),
    "larger": ca.fmax(X[0], X[1] ** 2) + ca.fmin(X[0], 1.0) + ca.tanh(X[1]),
}


@given(
    st.sampled_from(sorted(FORMS)),
    st.lists(st.floats(-4.0, 4.0), min_size=2, max_size=2),
    st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2),
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2),
)
@example("quotient through zero", [0.25, 2.2e-309], [0.0, 0.0], [0.0, 0.0])
@example("quotient through zero", [0.25, -2.2e-309], [0.0, 0.0], [0.0, 0.0])
def test_intervals_hold_every_value(form: str, low: list[float], width: list[float], share: list[float]) -> None:
    """The value at any point of a box lies within the bounds for the box."""
    function = ca.Function("form", [X], [FORMS[form]])
    boxes = [Intervals(np.array([a]), np.array([a + w])) for a, w in zip(low, width, strict=True)]
    with np.errstate(all="ignore"):
        bounds = interval_values(function, boxes)[0]
    value = float(function([a + s * w for a, w, s in zip(low, width, share, strict=True)]))
    if np.isfinite(value) and not np.isnan(bounds.low[0]) and not np.isnan(bounds.high[0]):
        assert bounds.low[0] - 1e-9 * (1.0 + abs(value)) <= value <= bounds.high[0] + 1e-9 * (1.0 + abs(value))


def test_an_unknown_operation_is_said_to_be_unknown() -> None:
    """What intervals are not known for proves nothing."""
    function = ca.Function("form", [X], [ca.erf(X[0])])
    with pytest.raises(NotBounded):
        interval_values(function, [Intervals(np.zeros(1), np.ones(1))] * 2)


@settings(max_examples=30)
@given(st.floats(-2.0, 2.0), st.floats(0.0, 2.0 * np.pi), st.booleans(), st.floats(-3.0, 3.0))
def test_what_is_refused_has_no_place_at_the_goal_that_keeps_it(
    bound: float, direction: float, headed: bool, heading: float
) -> None:
    """Against a dense look at all places and headings that count as the goal: a refusal is never false."""
    c, s = float(np.cos(direction)), float(np.sin(direction))
    constraint = ccm_opt.Constraint(
        "drawn", lambda q: c * q.tip[0] + s * q.tip[1] + 0.2 * ca.sin(q.tip_heading), upper=bound
    )
    terms = compile_terms(camera_room().arm, [constraint], [])
    goal = GoalRegion(np.array([0.75, 0.2]), unit_vector(heading) if headed else None, 1e-3, 0.02)
    turns = heading + 0.02 * np.linspace(-1.0, 1.0, 21) if headed else np.linspace(0.0, 2.0 * np.pi, 721)
    least = c * 0.75 + s * 0.2 + 0.2 * np.sin(turns).min() - 1e-3
    found = contradictions(terms, goal)
    if found:
        assert least > bound
        assert found[0].least <= least - bound + 2e-3
    elif least > bound + 2e-3:
        pytest.fail("a clear contradiction was not proved")


def test_a_constraint_of_the_middle_is_left_to_the_search() -> None:
    """What is no function of the tip alone is never refused beforehand, be it impossible."""
    middle = ccm_opt.Constraint("middle too far", lambda q: q.point_at(0.6)[0], lower=5.0)
    terms = compile_terms(camera_room().arm, [middle], [])
    assert not contradictions(terms, GoalRegion(np.array([0.75, 0.2]), None, 1e-3, 0.02))


@pytest.mark.parametrize("ask", [ccm_opt.solve, ccm_opt.find_pose])
def test_a_contradiction_is_named_before_any_search(ask: object) -> None:
    """The reason names the constraint and its miss, and is proved; no stage of planning has run."""
    heard: list[Progress] = []
    with pytest.raises(UnreachableGoal) as caught:
        ask(camera_room(), constraints=[valve_in_view, left_of_the_goal], progress=heard.append)  # type: ignore[operator]
    diagnosis = caught.value.diagnosis
    assert diagnosis.reason.startswith("constraint 'left of the goal' cannot hold at the goal: violated by 0.1 ")
    assert diagnosis.findings[0].proved
    assert {progress.stage for progress in heard} <= {"dynamics model", "necessary checks"}


def test_a_soft_constraint_contradicts_nothing() -> None:
    """A soft constraint, and one that does not cover the goal, are not refused."""
    soft = ccm_opt.Constraint("soft", lambda q: q.tip[0], upper=0.65, soft=True)
    early = ccm_opt.Constraint("early", lambda q: q.tip[0], upper=0.65, where=ccm_opt.Interval(0.0, 0.5))
    terms = compile_terms(camera_room().arm, [soft, early], [])
    assert not contradictions(terms, GoalRegion(np.array([0.75, 0.2]), None, 1e-3, 0.02))


@pytest.mark.drawn(2, of="poses in vain")
def test_after_a_search_in_vain_the_constraint_that_no_pose_keeps_comes_first() -> None:
    """The old reason follows it, and it is said not to be proved; where a pose keeps all, the error is left alone."""
    middle = ccm_opt.Constraint("middle too far", lambda q: q.point_at(0.6)[0], lower=0.7)
    old = MotionNotFound(Diagnosis("no motion found in 7 candidates", "motion", ("raise planner.routes",)))
    problem = camera_room()
    named = with_constraint_first(old, problem, compile_terms(problem.arm, [middle], []))
    reason = named.diagnosis.reason
    assert isinstance(named, MotionNotFound)
    assert reason.startswith(
        "no goal pose was found that satisfies constraint 'middle too far', which the closest violates"
    )
    assert "not proved" in reason
    assert reason.endswith("no motion found in 7 candidates")
    assert with_constraint_first(old, problem, compile_terms(problem.arm, [valve_in_view], [])) is old
