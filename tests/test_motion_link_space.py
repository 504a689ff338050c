"""The link space φ = A v + φ₀: mean headings of the curve, an exact start, exact derivatives."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import KNOTS, SEGMENTS, LinkSpace, mean_heading_matrix, nearest_curves
from ccm_opt.robot.configuration import Configuration

from .scenes import make_arm, random_headings

LINK_COUNTS = (4, 6, 10, 12, 14, 22, 24, 26, 34, 48, 60, 94, 96, 100, 134, 166, 200)
seeds = st.integers(0, 2**32 - 1)


def random_coordinates(seed: int) -> FloatArray:
    """Coordinates of a curve that winds about as much as an arm may."""
    rng = np.random.default_rng(seed)
    return np.concatenate((rng.uniform(-np.pi, np.pi, 1), rng.normal(0.0, 8.0, KNOTS)))


def space_at_zero(links: int) -> LinkSpace:
    """The link space in which a curve stands for its mean headings alone."""
    arm = make_arm(links)
    slopes = np.diff(mean_heading_matrix(arm), axis=0, prepend=0.0)
    return LinkSpace(arm, slopes, arm.bends(np.zeros(links)))


def curve_of(space: LinkSpace, v: FloatArray) -> Configuration:
    """The continuous curve behind coordinates."""
    curvature = v[1 : KNOTS + 1]
    values = [curvature[4 * k : 4 * k + 5] for k in range(SEGMENTS)]
    arm = space.arm
    heading = v[0]
    if space.clamped:  # as far as its first mean heading is from that of the arm
        heading = headings_in(space, v)[0] - mean_heading_matrix(arm)[0, 1:] @ curvature
    return Configuration.chain(arm.base, float(heading), [arm.length / SEGMENTS] * SEGMENTS, values)


def headings_in(space: LinkSpace, v: FloatArray) -> FloatArray:
    """Link headings of coordinates, shape (links,) [rad]."""
    return space.arm.headings(space.configurations(v))


@pytest.mark.parametrize("links", LINK_COUNTS)
def test_headings_are_the_means_of_the_curve(links: int) -> None:
    """A v is the mean heading of the curve v over each link, by Gauss quadrature of the configuration's own heading."""
    space = space_at_zero(links)
    v = random_coordinates(links)
    curve = curve_of(space, v)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    fine = np.linspace(0.0, 1.0, 20 * links + 1)  # every link and every spline piece ends on this grid
    half = 0.5 * np.diff(fine)[:, None]
    theta = curve.heading_at(np.clip(fine[:-1, None] + half * (nodes + 1.0), 0.0, 1.0))
    means = (theta @ weights / 2.0).reshape(links, 20).mean(axis=1)
    np.testing.assert_allclose(headings_in(space, v), means, atol=1e-11)


@pytest.mark.parametrize("links", [4, 14, 96])
def test_headings_agree_with_adaptive_quadrature(links: int) -> None:
    """A v agrees with QUADPACK on the curve's heading, whose breakpoints fall inside links."""
    space = space_at_zero(links)
    v = random_coordinates(7)
    curve = curve_of(space, v)
    l = space.arm.link_length
    for j in (0, 1, links // 2, links - 1):
        inner = curve.breakpoints[(curve.breakpoints > j * l) & (curve.breakpoints < (j + 1) * l)]
        total, _ = quad(lambda s: float(curve.heading_at(np.array(s))), j * l, (j + 1) * l, points=inner, epsabs=1e-13)
        assert headings_in(space, v)[j] == pytest.approx(total / l, abs=1e-10)


@settings(max_examples=25)
@given(seed=seeds, links=st.sampled_from(LINK_COUNTS))
def test_start_is_met_exactly(seed: int, links: int) -> None:
    """Whatever headings the arm starts with, smooth or jagged, the space through them holds them to rounding."""
    arm = make_arm(links)
    rng = np.random.default_rng(seed)
    start = random_headings(rng, arm) + rng.normal(0.0, 0.3, links)
    space, v = LinkSpace.through(arm, arm.bends(start))
    np.testing.assert_allclose(headings_in(space, v), start, atol=1e-12)
    np.testing.assert_allclose(space.pose(v).points, arm.joint_positions(start), atol=1e-12)


@settings(max_examples=25)
@given(seed=seeds, links=st.sampled_from(LINK_COUNTS))
def test_start_of_a_curve_is_found_again(seed: int, links: int) -> None:
    """Headings that are means of a gentle curve need next to no offset."""
    space = space_at_zero(links)
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0.0, 2.0, 3)
    s = np.linspace(0.0, 1.0, KNOTS)
    gentle = np.append(rng.uniform(-3.0, 3.0), np.polynomial.chebyshev.chebval(2.0 * s - 1.0, coefficients))
    found, _ = LinkSpace.through(space.arm, space.configurations(gentle))
    assert np.abs(found.arm.headings(found.offset)).max() < 2e-3


@settings(max_examples=25)
@given(seed=seeds, links=st.sampled_from((4, 12, 24, 60)))
def test_blended_space_holds_both_ends(seed: int, links: int) -> None:
    """With the goal blended in, w = 0 still holds the start and w = 1 holds the goal exactly."""
    arm = make_arm(links)
    rng = np.random.default_rng(seed)
    start, goal = (random_headings(rng, arm) + rng.normal(0.0, 0.3, links) for _ in range(2))
    space, v = LinkSpace.through(arm, arm.bends(start))
    blended, end = space.blended_to(arm.bends(goal))
    assert end[-1] == 1.0
    np.testing.assert_allclose(headings_in(blended, end), goal, atol=1e-11)
    np.testing.assert_allclose(headings_in(blended, np.append(v, 0.0)), start, atol=1e-11)


@settings(max_examples=10)
@given(seed=seeds, links=st.sampled_from((4, 12, 24, 60)), blended=st.booleans())
def test_jacobians_are_the_derivatives_of_the_positions(seed: int, links: int, *, blended: bool) -> None:
    """Central differences of all joint positions agree with the Jacobians, also in the blended space."""
    arm = make_arm(links, base=np.array([0.3, -0.2]))
    rng = np.random.default_rng(seed)
    space, v = LinkSpace.through(arm, arm.bends(random_headings(rng, arm)))
    if blended:
        space, v = space.blended_to(arm.bends(random_headings(rng, arm)))
    jacobians = space.jacobians(headings_in(space, v))
    steps = 1e-6 * np.eye(len(v))
    numeric = np.stack([(space.pose(v + h).points - space.pose(v - h).points) / 2e-6 for h in steps], axis=-1)
    assert jacobians.shape == (links + 1, 2, len(v))
    np.testing.assert_allclose(jacobians, numeric, atol=1e-8)


@settings(max_examples=20)
@given(seed=seeds)
def test_curve_is_smooth_and_as_long_as_the_arm(seed: int) -> None:
    """The curve behind coordinates has five equal segments, the arm's length, and no jump of curvature."""
    space = space_at_zero(24)
    v = random_coordinates(seed)
    curve = curve_of(space, v)
    assert len(curve.segments) == SEGMENTS
    assert curve.length == pytest.approx(space.arm.length, abs=1e-12)
    assert curve.base_heading == pytest.approx(v[0])
    ends = [segment.curvature[[0, -1]] for segment in curve.segments]
    assert all(a[1] == b[0] for a, b in pairwise(ends))


def test_headings_scale_with_the_arm() -> None:
    """Stretching the arm and dividing its curvatures by the same factor leaves all headings alone."""
    v, arm = random_coordinates(3), make_arm(24)
    small = mean_heading_matrix(replace(arm, link_length=0.5 / 24))
    large = mean_heading_matrix(replace(arm, link_length=2.0 / 24))
    shrunk = np.append(v[0], v[1:] / 4.0)
    np.testing.assert_allclose(small @ v, large @ shrunk, atol=1e-12)


@settings(max_examples=40)
@given(
    seed=seeds,
    links=st.sampled_from((12, 24, 96)),
    nominal_links=st.sampled_from((24.0, 60.0, 200.0)),
    clamped=st.booleans(),
)
def test_spaces_of_every_fineness_follow_their_curve(
    seed: int, links: int, nominal_links: float, *, clamped: bool
) -> None:
    """However fine the space, clamped or not: the start is exact, and links turn as the means of the curve do."""
    arm = make_arm(links)
    rng = np.random.default_rng(seed)
    start = random_headings(rng, arm)
    space, v = LinkSpace.through(arm, arm.bends(start), nominal_links, clamped=clamped)
    np.testing.assert_allclose(headings_in(space, v), start, atol=1e-12)
    moved = v + rng.normal(0.0, 1.0, len(v))
    turned = headings_in(space, moved) - headings_in(space, v)
    expected = curve_of(space, moved).mean_headings(links) - curve_of(space, v).mean_headings(links)
    np.testing.assert_allclose(turned, expected, atol=1e-10)
    assert space.nominal_length == pytest.approx(arm.length / nominal_links)


@settings(max_examples=20)
@given(seed=seeds)
def test_a_clamped_base_keeps_its_heading(seed: int) -> None:
    """In a clamped space the first link keeps the start's heading at all coordinates, also with a goal blended in."""
    arm = make_arm(24)
    rng = np.random.default_rng(seed)
    start = random_headings(rng, arm)
    goal = random_headings(rng, arm)
    goal += start[0] - goal[0]
    space, v = LinkSpace.through(arm, arm.bends(start), clamped=True)
    blended, end = space.blended_to(arm.bends(goal))
    np.testing.assert_allclose(headings_in(blended, end), goal, atol=1e-11)
    for held, at in ((space, v), (blended, end)):
        assert headings_in(held, at + rng.normal(0.0, 3.0, len(at)))[0] == pytest.approx(start[0], abs=1e-12)


@settings(max_examples=25)
@given(seed=seeds, links=st.sampled_from((2, 12, 24, 96)))
def test_the_nearest_curves_of_many_poses_are_those_of_each(seed: int, links: int) -> None:
    """Fitted all at once, and joined without integrating, curves are those that each pose's own space gives."""
    arm = make_arm(links)
    rng = np.random.default_rng(seed)
    poses = np.array([random_headings(rng, arm) for _ in range(4)])
    arcs = np.linspace(0.0, arm.length, 57)
    for pose, curve in zip(poses, nearest_curves(arm, arm.bends(poses)), strict=True):
        alone = curve_of(*LinkSpace.through(arm, arm.bends(pose)))
        np.testing.assert_allclose(curve.heading_at(arcs), alone.heading_at(arcs), atol=1e-8)
