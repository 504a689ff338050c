"""Inverse kinematics in space: what can be reached is, and what cannot is missed by no more than limits ask for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.curve_space import CurveSpace, chain_at
from ccm_opt.robot.tip_newton import TipNewton, TipTarget
from tests.space_arms import FEED_OF_TESTS, space_arm, turned_arm

SEEDS = st.integers(0, 2**32 - 1)


def target_of(arm: Arm, q: FloatArray) -> TipTarget:
    """Where the tip is in a configuration."""
    return TipTarget(arm.joint_positions_at(q)[-1], arm.link_rotations(q)[-1, :, 0])


@given(SEEDS, st.booleans(), st.booleans())
@settings(max_examples=30, deadline=None)
def test_what_some_pose_reaches_is_reached_from_the_straight_arm(seed: int, fed: bool, every: bool) -> None:
    """Place and direction to rounding and all limits kept, in the curve's coordinates and in all bends."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 24, feed=FEED_OF_TESTS if fed else None)
    curve = CurveSpace.of(arm)
    turned = curve.matrix @ random.normal(0.0, 0.35, curve.dimension)
    q = np.clip(turned, 0.8 * arm.lower_limits, 0.8 * arm.upper_limits)
    target = target_of(arm, q)
    space = CurveSpace.of_every_bend(arm) if every else curve
    found = TipNewton.within_limits(space).solve(np.zeros(space.dimension), target)
    assert found.met, (found.position_error, found.direction_error, found.steps)
    again = target_of(arm, found.q)
    assert np.linalg.norm(again.position - target.position) < 1e-8
    assert target.direction is not None
    assert target.angle(arm.link_rotations(found.q)[-1, :, 0]) < 1e-8
    assert np.all(found.q <= arm.upper_limits)
    assert np.all(found.q >= arm.lower_limits)


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_what_is_out_of_reach_is_missed_by_no_more_than_scipy_can_mend(seed: int) -> None:
    """With tight limits: there are several least errors, and scipy's bounded least squares finds none beside this."""
    random = np.random.default_rng(seed)
    arm = space_arm(6, 0.1, joint_limit=0.2, base_limit=0.3)
    space = CurveSpace.of_every_bend(arm)
    target = TipTarget(random.uniform(-1.0, 1.0, 3) + np.array([0.5, 0.0, 0.0]))

    def error(q: FloatArray) -> FloatArray:
        return np.asarray(arm.joint_positions_at(q)[-1] - target.position)

    found = TipNewton.within_limits(space).solve(random.normal(0.0, 0.02, space.dimension), target)
    inside = np.clip(found.q, arm.lower_limits + 1e-9, arm.upper_limits - 1e-9)
    mended = least_squares(error, inside, bounds=(arm.lower_limits, arm.upper_limits), xtol=1e-14, gtol=1e-14)
    assert found.position_error <= np.linalg.norm(mended.fun) + 2e-4 * arm.length


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_errors_of_a_target_change_as_their_rows_say(seed: int) -> None:
    """Rows are the derivatives of the tip and of the last link, by central differences."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 5, feed=FEED_OF_TESTS)
    space = CurveSpace.of(arm)
    v = random.normal(0.0, 0.4, space.dimension)
    state = chain_at(space, v)
    target = target_of(arm, state.q)
    error, rows = target.errors(state, 0.1)
    np.testing.assert_allclose(error, 0.0, atol=1e-7)
    change = random.normal(size=space.dimension)
    ahead, behind = (chain_at(space, v + sign * 1e-6 * change) for sign in (1.0, -1.0))
    moved = (ahead.positions[-1] - behind.positions[-1]) / 2e-6
    turned = (ahead.rotations[-1, :, 0] - behind.rotations[-1, :, 0]) / 2e-6
    across = state.rotations[-1, :, 1:].T @ turned
    np.testing.assert_allclose(rows @ change, np.concatenate((moved / 0.1, across)), atol=1e-6)


def test_a_held_coordinate_stays_where_it_is() -> None:
    """Joints in the guide tube and a fixed feed do not move; the others do what is needed."""
    arm = space_arm(24, 0.04, feed=FEED_OF_TESTS)
    lower, upper = arm.limits_at(0.3)
    lower[-1] = upper[-1] = 0.3
    space = CurveSpace.of_every_bend(arm)
    target = TipTarget(np.array([0.9, 0.3, 0.2]), np.array([0.0, 0.6, 0.8]))
    start = np.append(np.zeros(48), 0.3)
    found = TipNewton(space, lower, upper).solve(start, target)
    assert found.met
    np.testing.assert_array_equal(found.q[:10], 0.0)
    assert found.q[-1] == pytest.approx(0.3, abs=1e-12)
