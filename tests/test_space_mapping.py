"""Mapping curves in space to arms and back: link lengths kept, the plane's own mapping in the plane, tips exact."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration, SpaceConfiguration
from ccm_opt.robot.inverse_kinematics import bends_from_directions, configuration_from_positions
from ccm_opt.robot.mapping import REGULARISATION, curve_points, map_curve, shape_error
from tests.space_arms import FEED_OF_TESTS, laid_into_space, planar_twin, space_arm, turned_arm

SEEDS = st.integers(0, 2**32 - 1)


def curve_for(random: np.random.Generator, arm: Arm, bend: float = 2.0) -> SpaceConfiguration:
    """A curve as long as an arm from its base."""
    lengths = random.uniform(0.5, 1.5, 3)
    lengths *= arm.length / lengths.sum()
    values = list(random.normal(0.0, bend / arm.length, (3, 5, 2)))
    for before, after in pairwise(values):
        after[0] = before[4]
    return SpaceConfiguration.chain(arm.base, arm.base_rotation, lengths.tolist(), values)


@given(SEEDS, st.booleans())
@settings(max_examples=30, deadline=None)
def test_joints_give_the_bends_back(seed: int, fed: bool) -> None:
    """Bends from positions, and from directions, are those that made them, within ± 90° of each first bend."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 7, base_limit=1.5, feed=FEED_OF_TESTS if fed else None)
    q = random.uniform(arm.lower_limits, arm.upper_limits, (3, len(arm.coordinates)))
    np.testing.assert_allclose(configuration_from_positions(arm, arm.joint_positions_at(q)), q, atol=1e-9)
    found = bends_from_directions(arm, arm.link_rotations(q)[..., 0])
    np.testing.assert_allclose(found, arm.bend_pairs(q), atol=1e-9)


def test_positions_that_are_no_pose_are_refused() -> None:
    """A wrong shape, another base, and links of another length."""
    arm = space_arm(3)
    points = arm.joint_positions_at(np.zeros(6))
    with pytest.raises(ProblemError, match="shape"):
        configuration_from_positions(arm, points[:-1])
    with pytest.raises(ProblemError, match="base"):
        configuration_from_positions(arm, points + 0.1)
    with pytest.raises(ProblemError, match="not"):
        configuration_from_positions(arm, 1.1 * points)


@pytest.mark.parametrize("method", ["even-joints", "least-squares"])
@given(seed=SEEDS)
@settings(max_examples=15, deadline=None)
def test_in_the_plane_the_mapping_is_the_planes(method: MappingName, seed: int) -> None:
    """A curve of the plane of direction and left is mapped as the planar arm maps it, with no second bends."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 12)
    flat_arm = planar_twin(arm)
    lengths = [arm.length / 3.0] * 3
    values = [random.normal(0.0, 2.0 / arm.length, 5) for _ in range(3)]
    flat = Configuration.chain(np.zeros(2), 0.3, lengths, values)
    curve = laid_into_space(flat, arm.base, arm.base_rotation)
    wanted = map_curve(flat_arm, flat, method)
    found = map_curve(arm, curve, method)
    np.testing.assert_allclose(found[0::2], wanted, atol=2e-6)
    np.testing.assert_allclose(found[1::2], 0.0, atol=1e-8)


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_a_mapping_does_not_care_how_the_arm_is_turned(seed: int) -> None:
    """Joints of a turned curve on a turned arm are the turned joints, by both mappings."""
    random = np.random.default_rng(seed)
    plain = space_arm(10)
    turned = turned_arm(random, 10)
    curve = curve_for(np.random.default_rng(seed), plain)
    other = curve_for(np.random.default_rng(seed), turned)
    methods: tuple[MappingName, ...] = ("even-joints", "least-squares")
    for method in methods:
        found = map_curve(turned, other, method)
        np.testing.assert_allclose(found, map_curve(plain, curve, method), atol=1e-6)


@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_even_joints_lie_on_the_curve_and_the_tip_of_the_smooth_mapping_too(seed: int) -> None:
    """What each mapping promises, and a shape error of the order that the paper's has."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 24)
    curve = curve_for(random, arm)
    points = curve_points(curve, 24)
    even = map_curve(arm, curve, "even-joints")
    np.testing.assert_allclose(arm.joint_positions_at(even)[::2], points[::2], atol=1e-9)
    smooth = map_curve(arm, curve, "least-squares")
    np.testing.assert_allclose(arm.joint_positions_at(smooth)[-1], points[-1], atol=1e-9)
    sharpest = float(np.linalg.norm(curve.curvature_at(np.linspace(0.0, curve.length, 200)), axis=1).max())
    assert shape_error(arm, curve, even) < 0.3 * sharpest * arm.link_length**2 + 1e-9
    assert shape_error(arm, curve, smooth) < 0.3 * sharpest * arm.link_length**2 + 1e-9


def test_the_smooth_mapping_is_scipys_minimum() -> None:
    """Joints near their points with the tip exact: scipy's constrained minimum over all bends has the same joints."""
    random = np.random.default_rng(4)
    arm = space_arm(6)
    curve = curve_for(random, arm, 3.0)
    points = curve_points(curve, 6)
    means = curve.mean_directions(6)
    weight = REGULARISATION * arm.link_length**2

    def cost(q: FloatArray) -> float:
        apart = arm.joint_positions_at(q) - points
        cosines = np.clip(np.sum(arm.link_rotations(q)[:, :, 0] * means, axis=1), -1.0, 1.0)
        return 1e4 * float(np.sum(apart[1:-1] ** 2) + weight * np.sum(np.arccos(cosines) ** 2))

    found = map_curve(arm, curve, "least-squares")
    tip = {"type": "eq", "fun": lambda q: 10.0 * (arm.joint_positions_at(q)[-1] - points[-1])}
    start = found + random.normal(0.0, 0.01, 12)
    best = minimize(cost, start, method="SLSQP", constraints=[tip], options={"ftol": 1e-14, "maxiter": 500})
    np.testing.assert_allclose(arm.joint_positions_at(best.x), arm.joint_positions_at(found), atol=2e-5)


def test_curves_that_do_not_fit_the_arm_are_refused() -> None:
    """Another length, and an odd number of links for even joints."""
    arm = space_arm(5)
    curve = curve_for(np.random.default_rng(0), arm)
    with pytest.raises(ProblemError, match="even number"):
        map_curve(arm, curve, "even-joints")
    with pytest.raises(ProblemError, match="m long but"):
        map_curve(space_arm(4), curve, "least-squares")
