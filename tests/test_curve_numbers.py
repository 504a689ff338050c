"""The linear map from a curve's curvature to the bends of joints, and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from ccm_opt.ik.spline_curve import CurveNumbers, bend_matrix

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.integers(2, 30), st.integers(2, 13))
@settings(max_examples=20, deadline=None)
def test_a_bend_is_the_difference_of_mean_headings_of_the_plane(seed: int, links: int, knots: int) -> None:
    """The matrix agrees with headings integrated by scipy from scipy's natural spline of the curvature."""
    random = np.random.default_rng(seed)
    spline = CubicSpline(np.linspace(0.0, 1.0, knots), random.normal(size=knots), bc_type="natural")
    heading = spline.antiderivative()
    integral = heading.antiderivative()
    joints = np.linspace(0.0, 1.0, links + 1)
    turn = random.normal()
    means = turn + np.diff(integral(joints)) * links
    found = bend_matrix(links, knots) @ np.append(turn, spline(np.linspace(0.0, 1.0, knots)))
    np.testing.assert_allclose(found, np.diff(means, prepend=0.0), atol=1e-10)


def test_the_tip_does_not_feel_a_turn_at_its_very_end() -> None:
    """Curvature at a place of the arm counts by the triangles of the two joints beside it."""
    links, knots = 4, 7
    spline = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots)[3], bc_type="natural")
    weight = lambda s: max(0.0, 1.0 - abs(s - 0.5) * links)  # noqa: E731
    wanted = quad(lambda s: float(spline(s)) * weight(s), 0.25, 0.75, points=[1 / 3, 0.5, 2 / 3])[0]
    assert bend_matrix(links, knots)[2, 4] == pytest.approx(wanted, abs=1e-9)


@given(SEEDS, st.integers(1, 2), st.integers(1, 2))
@settings(max_examples=20, deadline=None)
def test_the_nearest_curve_of_a_curves_bends_is_that_curve(seed: int, segments: int, directions: int) -> None:
    """Turn at the base and curvatures come back where there are more joints than knots."""
    random = np.random.default_rng(seed)
    knots = 4 * segments + 1
    values = random.normal(size=(knots + 1, directions))
    near = CurveNumbers.near(bend_matrix(3 * knots, knots) @ values, segments)
    np.testing.assert_allclose(near.base_turn, values[0], atol=1e-7)
    np.testing.assert_allclose(near.curvatures, values[1:].T, atol=1e-7)


@given(SEEDS, st.integers(4, 9))
def test_the_nearest_curve_of_links_of_several_lengths_bends_no_more_than_they_do(seed: int, segments: int) -> None:
    """Where pieces are shorter than links, what bends do not tell of the curvature is not made up."""
    random = np.random.default_rng(seed)
    lengths = np.repeat(random.uniform(0.5, 2.0, 3), random.integers(5, 12, 3))
    shares = lengths / lengths.sum()
    bends = random.uniform(-0.5, 0.5, (len(shares), 1))
    near = CurveNumbers.near(bends, segments, tuple(shares.tolist()))
    assert np.max(np.abs(near.curvatures)) < 100.0 * 0.5 / shares.min()
