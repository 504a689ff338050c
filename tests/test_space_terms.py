"""Users' constraints and costs in space: quantities of three components, and poses that keep them at the goal."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.contradictions import GoalRegion, contradictions
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.quantities import SpaceQuantities
from tests.space_arms import FEED_OF_TESTS, space_arm, turned_arm
from tests.space_clutter import clutter

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.booleans())
@settings(max_examples=10, deadline=None)
def test_quantities_in_space_are_those_of_the_kinematics(seed: int, fed: bool) -> None:
    """Joints, points, directions and velocities in symbols are the numbers of the arm."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 5, feed=FEED_OF_TESTS if fed else None)
    q, rate = random.uniform(-0.5, 0.5, (2, len(arm.coordinates)))
    quantities = SpaceQuantities.from_arm(arm)
    parts = (
        quantities.joint_positions,
        quantities.tip,
        quantities.tip_direction,
        quantities.point_at(0.25),
        quantities.direction_at(0.25),
        quantities.tip_velocity,
        quantities.inside(np.eye(3), np.zeros(3)),
        quantities.joint_angles,
        quantities.link_directions,
    )
    function = ca.Function("quantities", list(quantities.timed_symbols), list(parts))
    feed, feed_rate = (float(arm.coordinates.advance(row)) for row in (q, rate))
    found = [np.asarray(value) for value in function(q[:10], feed, 0.5, rate[:10], feed_rate)]
    points = arm.joint_positions_at(q)
    directions = arm.link_rotations(q)[..., 0]
    np.testing.assert_allclose(found[0], points.T, atol=1e-12)
    np.testing.assert_allclose(found[1][:, 0], points[-1], atol=1e-12)
    np.testing.assert_allclose(found[2][:, 0], directions[-1], atol=1e-12)
    np.testing.assert_allclose(found[3][:, 0], 0.5 * (points[2] + points[3]), atol=1e-12)
    np.testing.assert_allclose(found[4][:, 0], directions[2], atol=1e-12)
    moved = (arm.joint_positions_at(q + 1e-6 * rate)[-1] - arm.joint_positions_at(q - 1e-6 * rate)[-1]) / 2e-6
    np.testing.assert_allclose(found[5][:, 0], moved, atol=1e-8)
    np.testing.assert_allclose(found[6][:, 0], -points[-1], atol=1e-12)
    np.testing.assert_allclose(found[7], arm.bend_pairs(q).T)
    np.testing.assert_allclose(found[8], directions.T, atol=1e-12)


def test_terms_in_space_are_compiled_and_judged_at_configurations() -> None:
    """Residuals of bends with a feed beside them, and of whole configurations, are the same."""

    @ccm_opt.constraint(upper=0.0)
    def below(q: Any) -> Any:
        return q.tip[2] - 0.1

    arm = space_arm(4, feed=FEED_OF_TESTS)
    terms = compile_terms(arm, [below], [])
    q = np.array([[0.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2]])
    (item,) = terms.hard_at_goal
    height = arm.joint_positions_at(q[0])[-1, 2]
    assert item.residuals(q, np.ones(1))[0] == pytest.approx(height - 0.1)
    assert np.asarray(item.slopes(q[0], 1.0)).shape == (1, 9)


def test_quantities_of_the_plane_are_refused_by_what_stands_for_them() -> None:
    """The message of a constraint written for the plane names it and says what to use."""

    @ccm_opt.constraint(upper=0.0)
    def level(q: Any) -> Any:
        return q.tip_heading

    with pytest.raises(ProblemError, match=r"'level'.*use tip_direction"):
        compile_terms(space_arm(4), [level], [])
    with pytest.raises(ProblemError, match="AttributeError"):
        compile_terms(space_arm(4), [replace(level, expression=lambda q: q.nothing)], [])


@pytest.mark.drawn(20, of="dear tests")
def test_a_goal_pose_keeps_the_users_constraints_and_heeds_the_costs() -> None:
    """The elbow stays where the constraint wants it, exactly, and a cost pulls where nothing forbids."""
    scene = clutter(2, 12)
    arm = scene.problem.arm
    free = GoalPoses(scene.problem, scene.tree).best(scene.seed)
    assert free is not None
    middle = arm.joint_positions_at(free.q)[6]
    least = float(middle[2]) + 0.01

    @ccm_opt.constraint(lower=least, where="goal")
    def elbow_up(q: Any) -> Any:
        return q.joint_positions[2, 6]

    kept = GoalPoses(scene.problem, scene.tree, terms=compile_terms(arm, [elbow_up], [])).best(scene.seed)
    assert kept is not None
    assert arm.joint_positions_at(kept.q)[6, 2] >= least - 1e-6

    @ccm_opt.cost(weight=50.0, where="goal")
    def low_elbow(q: Any) -> Any:
        return q.joint_positions[2, 6]

    pulled = GoalPoses(scene.problem, scene.tree, terms=compile_terms(arm, [], [low_elbow])).best(scene.seed)
    assert pulled is not None
    assert arm.joint_positions_at(pulled.q)[6, 2] < middle[2]
    assert "user: low elbow" in pulled.answer.costs


@given(SEEDS, st.booleans())
@settings(max_examples=20, deadline=None)
def test_what_is_proved_to_contradict_a_goal_is_missed_everywhere_there(seed: int, directed: bool) -> None:
    """No place and direction that counts as the goal misses the constraint by less than is proved."""
    random = np.random.default_rng(seed)
    wanted = random.normal(size=3)
    direction = wanted / np.linalg.norm(wanted) if directed else None
    region = GoalRegion(random.uniform(-0.3, 0.3, 3), direction, 0.02, 0.1)
    linear, turned = random.normal(size=(2, 3))
    lower = random.uniform(0.0, 3.0)

    @ccm_opt.constraint(lower=lower)
    def bowl(q: Any) -> Any:
        return ca.dot(ca.DM(linear), q.tip) + ca.dot(ca.DM(turned), q.tip_direction) - ca.sumsqr(q.tip)

    terms = compile_terms(space_arm(5), [bowl], [])
    places = region.position + region.around * random.uniform(-1.0, 1.0, (500, 3)) / np.sqrt(3.0)
    pointed = random.normal(size=(500, 3))
    if direction is not None:
        pointed = direction + 0.05 * random.uniform(-1.0, 1.0, (500, 3))
    pointed /= np.linalg.norm(pointed, axis=1)[:, None]
    if direction is not None:
        pointed = pointed[np.arccos(np.clip(pointed @ direction, -1.0, 1.0)) <= region.turned]
        places = places[: len(pointed)]
    values = places @ linear + pointed @ turned - np.sum(places**2, axis=1)
    for each in contradictions(terms, region):
        assert float(np.min(lower - values)) >= each.least - 1e-12
        assert each.miss >= each.least


def test_a_constraint_on_more_than_the_tip_is_never_refused_beforehand() -> None:
    """Another pose might keep it."""

    @ccm_opt.constraint(lower=5.0)
    def middle(q: Any) -> Any:
        return q.tip[0] + q.joint_positions[0, 2]

    region = GoalRegion(np.zeros(3), None, 0.0, 0.0)
    assert contradictions(compile_terms(space_arm(5), [middle], []), region) == ()
