"""Mapping a curve to the jointed arm (paper, section 5.3)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.mapping import REGULARISATION, MappingName, curve_points, map_curve, shape_error

from .arms import plain_arm

METHODS = ("least-squares", "even-joints")


def arm_of(links: int, base: tuple[float, float] = (0.0, 0.0)) -> Arm:
    """An arm of unit length."""
    return plain_arm(links, 1.0 / links, base=np.array(base), joint_limit=1.0, mount_length=0.02)


def random_curve(seed: int, segments: int = 2, bend: float = 4.0) -> Configuration:
    """A curve of unit length with continuous curvature."""
    rng = np.random.default_rng(seed)
    values = rng.normal(0.0, bend, 4 * segments + 1)
    pieces = [values[4 * k : 4 * k + 5] for k in range(segments)]
    return Configuration.chain(np.zeros(2), rng.uniform(-3, 3), [1.0 / segments] * segments, pieces)


@pytest.mark.parametrize("method", METHODS)
@given(seed=st.integers(0, 10_000), links=st.sampled_from([12, 24, 48]))
@settings(max_examples=25, deadline=None)
def test_links_keep_their_length_and_the_tip_is_exact(method: MappingName, seed: int, links: int) -> None:
    """Every mapped link has its length to 1e-12 and the tip of the arm is the tip of the curve."""
    arm, curve = arm_of(links), random_curve(seed)
    joints = arm.joint_positions_at(map_curve(arm, curve, method))
    np.testing.assert_allclose(np.linalg.norm(np.diff(joints, axis=0), axis=1), arm.link_length, atol=1e-12)
    np.testing.assert_allclose(joints[-1], curve.tip[0], atol=1e-11)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_even_joints_lie_on_the_curve(seed: int) -> None:
    """Section 5.3: even joints are on the curve, equidistant along it, and elbows lie on the side it bulges to."""
    arm, curve = arm_of(24), random_curve(seed)
    joints = arm.joint_positions_at(map_curve(arm, curve, "even-joints"))
    points = curve_points(curve, 24)
    np.testing.assert_allclose(joints[::2], points[::2], atol=1e-11)
    chords = np.diff(points[::2], axis=0)
    elbow, bulge = ((p[1::2] - points[:-1:2]) @ [[0.0, -1.0], [1.0, 0.0]] for p in (joints, points))
    assert np.all((chords * elbow).sum(axis=1) * (chords * bulge).sum(axis=1) >= -1e-12)


@pytest.mark.parametrize("curvature", [0.5, 2.0, -3.0])
def test_even_joint_shape_error_of_a_circle(curvature: float) -> None:
    """On a circle the even-joint mapping errs by 0.077 κ l², l κ small: (1/√3 - 1/2) κ l²."""
    arm, curve = arm_of(48), Configuration.chain(np.zeros(2), 0.0, [1.0], [np.full(5, curvature)])
    error = shape_error(arm, curve, map_curve(arm, curve, "even-joints"))
    assert error == pytest.approx((1.0 / np.sqrt(3.0) - 0.5) * abs(curvature) * arm.link_length**2, rel=5e-3)


@pytest.mark.parametrize("seed", range(4))
def test_least_squares_minimises_its_objective(seed: int) -> None:
    """A general constrained minimiser (SLSQP) finds no better headings than the mapping's own iteration."""
    arm, curve = arm_of(12), random_curve(seed, 1)
    points, mean = curve_points(curve, 12), curve.mean_headings(12)

    def cost(headings: FloatArray) -> float:
        inner = (arm.joint_positions(headings) - points)[1:-1] / arm.link_length
        return float((inner**2).sum() + REGULARISATION * ((headings - mean) ** 2).sum())

    def miss(headings: FloatArray) -> FloatArray:
        return (arm.joint_positions(headings)[-1] - points[-1]) / arm.link_length

    ours = arm.headings(map_curve(arm, curve, "least-squares"))
    oracle = minimize(cost, mean, constraints={"type": "eq", "fun": miss}, method="SLSQP", options={"ftol": 1e-12})
    assert oracle.success
    assert cost(ours) <= oracle.fun * (1.0 + 1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_straight_curve_maps_to_the_straight_arm(method: MappingName) -> None:
    """A straight curve gives equal link headings, although a straight arm cannot shorten to first order."""
    curve = Configuration.chain(np.zeros(2), 0.4, [1.0], [np.zeros(5)])
    arm = arm_of(24)
    np.testing.assert_allclose(arm.headings(map_curve(arm, curve, method)), 0.4, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_nearly_straight_curve_maps(method: MappingName) -> None:
    """A curve bent by a millionth still maps, with its tip exact."""
    curve = Configuration.chain(np.zeros(2), 0.0, [1.0], [np.array([1e-6, 2e-6, -1e-6, 0.0, 1e-6])])
    arm = arm_of(24)
    joints = arm.joint_positions_at(map_curve(arm, curve, method))
    np.testing.assert_allclose(joints[-1], curve.tip[0], atol=1e-8)


@given(st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5), st.floats(-9.0, -2.0), st.sampled_from([2, 9, 24, 96]))
@settings(max_examples=60, deadline=None)
def test_least_squares_settles_on_nearly_straight_curves(values: list[float], exponent: float, links: int) -> None:
    """However little a curve bends, the iteration ends with the tip on it; rounding decides where steps end."""
    curve = Configuration.chain(np.zeros(2), 2.9, [1.0], [10.0**exponent * np.array(values)])
    arm = arm_of(links)
    joints = arm.joint_positions_at(map_curve(arm, curve, "least-squares"))
    np.testing.assert_allclose(joints[-1], curve.tip[0], atol=1e-8)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_least_squares_is_smooth(seed: int) -> None:
    """A small change of the curve is a small change of the links: no jumps along a motion."""
    arm, curve = arm_of(24), random_curve(seed)
    nudged = Configuration.chain(
        curve.base,
        curve.base_heading + 1e-6,
        [s.length for s in curve.segments],
        [s.curvature + 1e-6 for s in curve.segments],
    )
    change = map_curve(arm, nudged, "least-squares") - map_curve(arm, curve, "least-squares")
    assert np.abs(change).max() < 1e-4


def test_mean_headings_are_exact_means() -> None:
    """The mean heading of a link is the integral of the curve's heading over it, divided by its length."""
    curve = random_curve(3)
    means = curve.mean_headings(12)
    for link in (0, 5, 11):
        ends = (link / 12, (link + 1) / 12)
        oracle = quad(lambda s: float(curve.heading_at(np.array([s]))[0]), *ends, limit=100)[0] * 12
        assert means[link] == pytest.approx(oracle, abs=1e-9)


def test_curve_of_another_length_is_refused() -> None:
    """A curve that is longer than the arm is a ProblemError that gives both lengths."""
    curve = Configuration.chain(np.zeros(2), 0.0, [1.01], [np.zeros(5)])
    with pytest.raises(ProblemError, match=r"1\.01 m long but the arm 1 m"):
        map_curve(arm_of(12), curve, "even-joints")


def test_coinciding_even_joints_are_refused() -> None:
    """A curve that closes a circle within two links leaves the elbow undetermined."""
    circles = Configuration.chain(np.zeros(2), 0.0, [1.0], [np.full(5, 24.0 * np.pi)])
    with pytest.raises(ProblemError, match="coincide"):
        map_curve(arm_of(24), circles, "even-joints")
