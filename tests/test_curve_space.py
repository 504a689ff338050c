"""Coordinates of the curve in space: linear, exact at the start, the plane's own in the plane, with true Jacobians."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from ccm_opt.robot.curve_space import CurveSpace, bend_matrix, chain_at
from tests.oracles.chains import ChainByNumpy
from tests.space_arms import FEED_OF_TESTS, space_arm, turned_arm

SEEDS = st.integers(0, 2**32 - 1)


def random_space(seed: int, links: int, *, fed: bool, knots: int = 11) -> tuple[CurveSpace, np.random.Generator]:
    """A space through a configuration at random."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, links, feed=FEED_OF_TESTS if fed else None)
    q = random.uniform(0.5 * arm.lower_limits, 0.5 * arm.upper_limits)
    return CurveSpace.through(arm, q, knots), random


@given(SEEDS, st.integers(2, 30), st.integers(2, 13))
@settings(max_examples=20, deadline=None)
def test_a_bend_is_the_difference_of_mean_headings_of_the_plane(seed: int, links: int, knots: int) -> None:
    """The matrix agrees with headings integrated by scipy from scipy's natural spline of the curvature."""
    random = np.random.default_rng(seed)
    length = 1.7
    spline = CubicSpline(np.linspace(0.0, length, knots), random.normal(size=knots), bc_type="natural")
    heading = spline.antiderivative()
    integral = heading.antiderivative()
    joints = np.linspace(0.0, length, links + 1)
    turn = random.normal()
    means = turn + np.diff(integral(joints)) * links / length
    found = bend_matrix(links, length, knots) @ np.append(turn, spline(np.linspace(0.0, length, knots)))
    np.testing.assert_allclose(found, np.diff(means, prepend=0.0), atol=1e-10)


def test_the_tip_does_not_feel_a_turn_at_its_very_end() -> None:
    """Curvature at a place of the arm counts by the triangles of the two joints beside it."""
    links, length, knots = 4, 1.0, 7
    spline = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots)[3], bc_type="natural")
    weight = lambda s: max(0.0, 1.0 - abs(s - 0.5) * links)  # noqa: E731
    wanted = quad(lambda s: float(spline(s)) * weight(s), 0.25, 0.75, points=[1 / 3, 0.5, 2 / 3])[0]
    assert bend_matrix(links, length, knots)[2, 4] == pytest.approx(wanted, abs=1e-9)


@given(SEEDS, st.integers(2, 40), st.booleans())
@settings(max_examples=25, deadline=None)
def test_the_space_holds_its_start_and_has_columns_of_norm_one(seed: int, links: int, fed: bool) -> None:
    """The start is exact, and every coordinate changes the configuration by one unit."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, links, feed=FEED_OF_TESTS if fed else None)
    q = random.uniform(arm.lower_limits, arm.upper_limits)
    space = CurveSpace.through(arm, q)
    np.testing.assert_allclose(space.configurations(space.nearest(q)), q, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(space.matrix, axis=0), 1.0, atol=1e-12)
    assert space.dimension == 24 + fed
    if fed:
        np.testing.assert_array_equal(space.matrix[:, -1], np.eye(len(q))[-1])


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_curvature_rows_give_the_values_behind_the_bends(seed: int) -> None:
    """The rows' values at knots, put through the plain matrix again, are the bends, upward turns being about −y."""
    random = np.random.default_rng(seed)
    space = CurveSpace.of(space_arm(12), 9)
    v = random.normal(size=space.dimension)
    v[[0, 10]] = 0.0
    left, up = (space.curvature_rows @ v).reshape(2, 9)
    turns = bend_matrix(12, space.arm.length, 9)[:, 1:]
    q = space.configurations(v)
    np.testing.assert_allclose(q[0::2], turns @ left, atol=1e-12)
    np.testing.assert_allclose(q[1::2], -turns @ up, atol=1e-12)


@given(SEEDS, st.integers(2, 30), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_chain_agrees_with_kinematics_and_finite_differences(seed: int, links: int, fed: bool) -> None:
    """Positions and rotations are those of the kinematics, Jacobians those of central differences."""
    space, random = random_space(seed, links, fed=fed)
    v = space.nearest(space.offset) + random.normal(0.0, 0.3, space.dimension)
    state = chain_at(space, v)
    np.testing.assert_allclose(state.q, space.configurations(v), atol=1e-12)
    np.testing.assert_allclose(state.positions, space.arm.joint_positions_at(state.q), atol=1e-12)
    np.testing.assert_allclose(state.rotations, space.arm.link_rotations(state.q), atol=1e-12)
    direction = random.normal(size=space.dimension)
    h = 1e-6
    ahead, behind = (space.configurations(v + sign * h * direction) for sign in (1.0, -1.0))
    moved = (space.arm.joint_positions_at(ahead) - space.arm.joint_positions_at(behind)) / (2.0 * h)
    np.testing.assert_allclose(state.jacobian @ direction, moved, atol=1e-7 * links)
    turned = (space.arm.link_rotations(ahead) - space.arm.link_rotations(behind)) / (2.0 * h)
    spin = turned @ np.swapaxes(state.rotations, 1, 2)
    np.testing.assert_allclose(
        state.omega @ direction, np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1), atol=1e-7 * links
    )


@given(SEEDS, st.integers(2, 100), st.booleans())
@settings(max_examples=20, deadline=None)
def test_compiled_chains_agree_with_numpy(seed: int, links: int, fed: bool) -> None:
    """C and numpy differ by rounding alone, and results of one call outlive the next."""
    space, random = random_space(seed, links, fed=fed)
    plain = ChainByNumpy(space.arm, space.matrix, space.offset)
    places = random.normal(0.0, 0.3, (2, space.dimension))
    states = [chain_at(space, v) for v in places]
    for v, state in zip(places, states, strict=True):
        for found, wanted in zip(state, plain.at(v), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)


def test_coordinates_of_one_curve_carry_over_to_another_number_of_links() -> None:
    """The same curve on 24 and on 96 links has nearly the same tip; two bends at a joint do not quite commute."""
    random = np.random.default_rng(3)
    coarse = CurveSpace.of(space_arm(24, 0.04))
    fine = CurveSpace.of(space_arm(96, 0.01))
    v = random.normal(0.0, 0.15, coarse.dimension)
    lifted = fine.coordinates_like(coarse, v)
    np.testing.assert_allclose(fine.curvature_rows @ lifted, coarse.curvature_rows @ v, atol=1e-12)
    assert np.linalg.norm(chain_at(fine, lifted).positions[-1] - chain_at(coarse, v).positions[-1]) < 0.02
