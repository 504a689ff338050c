"""The map from curvature to configurations: exact where it is asked to be, its slopes, and joints in a guide tube."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import CurveMap, feed_to_next_stop
from ccm_opt.planning.limits.limit_stack import AtRest, FeedLimit, JointLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import Term
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.biarc import bend_shares, free_before, straight_at_exit
from ccm_opt.robot.link_layout import Proportions
from tests.arms import held_bends
from tests.oracles.chains import space_chain_by_numpy
from tests.oracles.curve_shapes import shapes_by_numpy
from tests.snakes_in_space import snake

seeds = st.integers(0, 2**32 - 1)
fed = Feed(0.0, 0.8, 0.8)


@given(seeds, st.integers(4, 40), st.booleans())
@settings(max_examples=40, deadline=None)
def test_the_start_is_held_exactly(seed: int, links: int, carried: bool) -> None:
    """Whatever configuration it is, and a goal that is blended in too."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed if carried else None)
    q = np.append(rng.normal(size=2 * links) * 0.3, [0.7] * carried)
    if carried:
        # Joints that are just outside the tube are straight too: they bend no sooner than they are further out.
        q[: 2 * links][held_bends(arm, 0.699)] = 0.0
    curve, v = CurveMap.through(arm, q)
    assert curve.configuration(v) == pytest.approx(q, abs=1e-12)
    goal = np.append(rng.normal(size=2 * links) * 0.3, [0.8] * carried)
    if carried:
        goal[: 2 * links][held_bends(arm, 0.799)] = 0.0
    blended, end = curve.blended_to(goal)
    assert blended.configuration(end) == pytest.approx(goal, abs=1e-9)
    assert blended.configuration(np.append(v, 0.0)) == pytest.approx(q, abs=1e-9)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(seeds, st.integers(4, 30), st.booleans())
@settings(max_examples=15, deadline=None)
def test_slopes_and_chains_are_derivatives(seed: int, links: int, carried: bool) -> None:
    """By differences, and in C as in numpy."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed if carried else None)
    curve, v = CurveMap.through(arm, np.zeros(len(arm.coordinates)))
    v = v + rng.normal(size=len(v)) * 0.2
    if carried:
        v[curve.feed_column] = rng.uniform(0.2, 0.7) / curve.scale[curve.feed_column]
    q = curve.configuration(v)
    slopes = curve.slopes(v)
    chain = curve.pose(v)
    step = 1e-6
    for k in range(len(v)):
        ahead = curve.configuration(v + step * np.eye(len(v))[k])
        behind = curve.configuration(v - step * np.eye(len(v))[k])
        assert slopes[:, k] == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-6)
        moved = (arm.joint_positions_at(ahead) - arm.joint_positions_at(behind)) / (2.0 * step)
        assert chain.moving[:, :, k] == pytest.approx(moved, abs=1e-6)
    other = space_chain_by_numpy(arm, q, slopes)
    for name in ("q", "slopes", "points", "frames", "turning", "moving"):
        assert getattr(chain, name) == pytest.approx(getattr(other, name), abs=1e-12)
    assert chain.points == pytest.approx(arm.joint_positions_at(q), abs=1e-12)


@given(seeds, st.integers(4, 40))
@settings(max_examples=40, deadline=None)
def test_shapes_by_c_and_by_numpy_agree(seed: int, links: int) -> None:
    """Turns of joints by unit curvature."""
    rng = np.random.default_rng(seed)
    curve, _ = CurveMap.through(snake(links, feed=fed), np.zeros(2 * links + 1))
    places = rng.uniform(-0.5, 1.2, size=links)
    expected = shapes_by_numpy(curve, places) * bend_shares(curve.arm, places)[:, None]
    assert curve._shapes(places) == pytest.approx(expected, abs=1e-12)


@given(seeds, st.floats(0.0, 0.8))
@settings(max_examples=40, deadline=None)
def test_joints_in_the_guide_tube_are_straight(seed: int, feed: float) -> None:
    """For all unknowns."""
    rng = np.random.default_rng(seed)
    arm = snake(24, feed=fed)
    curve, v = CurveMap.through(arm, np.zeros(49))
    v = rng.normal(size=len(v))
    v[curve.feed_column] = feed / curve.scale[curve.feed_column]
    q = curve.configuration(v)
    assert np.all(q[:48][held_bends(arm, feed)] == 0.0)


@given(st.integers(4, 30), st.floats(0.02, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_joint_bent_close_to_the_tube_is_straight_before_it_is_held(links: int, near: float) -> None:
    """On its way back from where a start bends it, a joint is straight on half of that way, not at the end alone."""
    arm = snake(links, feed=fed)
    usual = free_before(arm)
    # The last joint but one is outside the tube, by a share of what is usual.
    feed = arm.hole - arm.link_length * (links - 2) + near * usual
    q = np.zeros(2 * links + 1)
    q[-1] = feed
    q[2 * (links - 2)] = 0.3
    curve, v = CurveMap.through(arm, q)
    assert curve.configuration(v) == pytest.approx(q, abs=1e-12)
    straight = curve.straight_before
    assert 0.4 * near * usual < straight <= 0.5 * near * usual + 1e-12
    for share in (0.0, 0.5, 0.99):
        back = v.copy()
        back[curve.feed_column] -= (near * usual - share * straight) / curve.scale[curve.feed_column]
        assert np.all(curve.configuration(back)[: 2 * (links - 1)] == 0.0)
    # Carried back in pieces it stops where it is straight already.
    room = feed_to_next_stop(curve, feed, forward=False)
    assert 0.0 < near * usual - room < straight


@given(seeds, st.integers(4, 40), st.floats(0.05, 0.8), st.floats(0.05, 0.8))
@settings(max_examples=40, deadline=None)
def test_between_two_poses_joints_stay_straight_as_far_as_in_either(
    seed: int, links: int, begin: float, end: float
) -> None:
    """Wherever joints of the one lie between those of the other, of which the tube holds some."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed)
    usual = free_before(arm)
    start, goal = (np.append(rng.normal(size=2 * links) * 0.3, feed) for feed in (begin, end))
    for q in (start, goal):
        q[: 2 * links][held_bends(arm, float(q[-1]) - 1.01 * usual)] = 0.0
    curve, first = CurveMap.through(arm, start)
    blended, last = curve.blended_to(goal)
    assert blended.straight_before == pytest.approx(usual)
    for share in rng.uniform(size=8):
        v = np.append(first, 0.0) + share * (last - np.append(first, 0.0))
        q = blended.configuration(v)
        assert np.all(q[: 2 * links][held_bends(arm, float(q[-1]) - 0.99 * usual)] == 0.0)


def test_a_fed_arm_follows_its_own_shape() -> None:
    """Beyond the tube, where joints bend as they like."""
    # Four links farther out a joint takes the bend of the one four before it: those that are free of the tube in both.
    arm = snake(24, feed=fed)
    curve, v = CurveMap.through(arm, np.zeros(49))
    v = v + 0.3 * np.random.default_rng(1).normal(size=len(v))
    scale = curve.scale[curve.feed_column]
    v[curve.feed_column] = 0.5 / scale
    before = curve.configuration(v)
    v[curve.feed_column] = (0.5 + 4.0 * arm.link_length) / scale
    after = curve.configuration(v)
    assert after[:40] == pytest.approx(before[8:48], abs=1e-12)
    assert arm.joint_positions_at(after)[:-4] == pytest.approx(arm.joint_positions_at(before)[4:], abs=1e-9)


@given(seeds, st.integers(4, 40), st.floats(0.0, 0.8))
@settings(max_examples=40, deadline=None)
def test_joints_at_the_exit_are_made_straight_and_no_others(seed: int, links: int, feed: float) -> None:
    """So that between it and any other pose joints stay straight as far as usual; a fixed arm has no such joints."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed)
    q = np.append(rng.normal(size=2 * links) * 0.3, feed)
    straight = straight_at_exit(arm, q)
    near = feed + arm.link_length * np.arange(links) - fed.hole <= free_before(arm)
    assert np.all(straight[:-1].reshape(links, 2)[near] == 0.0)
    assert np.array_equal(straight[:-1].reshape(links, 2)[~near], q[:-1].reshape(links, 2)[~near])
    assert straight[-1] == feed
    curve, _ = CurveMap.through(arm, np.zeros(2 * links + 1))
    blended, _ = curve.blended_to(straight)
    assert blended.straight_before == pytest.approx(free_before(arm))
    fixed = snake(links)
    assert np.array_equal(straight_at_exit(fixed, q[:-1]), q[:-1])


@given(seeds, st.integers(16, 40))
@settings(max_examples=30, deadline=None)
def test_what_is_blended_in_counts_as_the_curvature_that_shows_it(seed: int, links: int) -> None:
    """The same bends change the curve by about as much, whether its knots show them or they are blended in."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed)
    curve, start = CurveMap.through(arm, np.zeros(2 * links + 1))
    v = start.copy()
    v[curve.feed_column] = 0.8 / curve.scale[curve.feed_column]
    along = np.linspace(0.0, 1.0, curve.knots)
    curvature = np.sin(np.pi * along) * (1.0 + rng.uniform(-0.5, 0.5) * along)
    v[: curve.knots] = curvature / curve.scale[: curve.knots]
    shown = np.sum((curve.change_rows @ (v - start)) ** 2)
    bends = curve.configuration(v)[: 2 * links].reshape(links, 2)
    places = curve.places(0.8)
    blended = replace(curve, offset_at=places, offset=np.zeros((links, 2)), blends=bends[None])
    change = np.append(np.zeros(len(v)), 1.0)
    assert np.sum((blended.change_rows @ change) ** 2) == pytest.approx(shown, rel=0.25)


@given(seeds, st.integers(8, 40))
@settings(max_examples=30, deadline=None)
def test_several_blends_each_reproduce_their_configuration(seed: int, links: int) -> None:
    """A map blended to two shapes of a fed arm gives either with its own unknown at 1 and the other at 0."""
    arm = snake(links, feed=fed)
    shapes = [bent_configuration(arm, seed + k) for k in (0, 1)]
    curve, _ = CurveMap.through(arm, np.zeros(2 * links + 1))
    first, v = curve.blended_to(shapes[0])
    both, w = first.blended_to(shapes[1])
    assert both.dimension == curve.dimension + 2
    np.testing.assert_allclose(both.configuration(np.append(v, 0.0)), shapes[0], atol=1e-9)
    np.testing.assert_allclose(both.configuration(w), shapes[1], atol=1e-9)
    np.testing.assert_allclose(both.slopes(w)[:, -1], _difference(both, w), atol=1e-6)


@given(seeds, st.integers(4, 40), st.floats(0.0, 0.85), st.floats(0.0, 0.85))
@settings(max_examples=30, deadline=None)
def test_a_further_blend_leaves_configurations_at_all_feeds_as_they_are(
    seed: int, links: int, begin: float, end: float
) -> None:
    """Not only in the poses that the map is made of: what is certified stays certified."""
    rng = np.random.default_rng(seed)
    arm = snake(links, feed=fed)
    start, goal = (np.append(0.3 * rng.normal(size=2 * links), feed) for feed in (begin, end))
    for q in (start, goal):
        q[: 2 * links][held_bends(arm, float(q[-1]))] = 0.0
    curve, v = CurveMap.through(arm, start)
    blended, _ = curve.blended_to(goal)
    unknowns = np.tile(v, (8, 1))
    unknowns[:, curve.feed_column] = rng.uniform(0.0, 0.85, 8) / curve.scale[curve.feed_column]
    padded = np.pad(unknowns, ((0, 0), (0, 1)))
    np.testing.assert_allclose(blended.configurations(padded), curve.configurations(unknowns), atol=1e-9)


def test_configurations_between_keyframes_leave_path_parameters_as_they_are() -> None:
    """Optimised motions of fed arms have them, and are optimised again."""
    curve, v = CurveMap.through(snake(24, feed=fed), np.zeros(49))
    unknowns = v + np.random.default_rng(2).uniform(size=(5, 1)) * np.eye(len(v))[curve.feed_column]
    plain = SpaceMotion(curve, unknowns, curve.configurations(unknowns), "any")
    between = replace(plain, configurations=curve.configurations(curve.in_pieces(unknowns)))
    assert len(between.configurations) > len(unknowns)
    np.testing.assert_array_equal(between.path_parameters, plain.path_parameters)


@given(seeds, st.integers(8, 40))
@settings(max_examples=30, deadline=None)
def test_the_blends_of_two_maps_together_keep_the_configurations_of_both(seed: int, links: int) -> None:
    """Unknowns of either map are still the same configurations in the map that has the blends of both."""
    arm = snake(links, feed=fed)
    curve, _ = CurveMap.through(arm, np.zeros(2 * links + 1))
    (one, v), (other, w) = (curve.blended_to(bent_configuration(arm, seed + k)) for k in (0, 1))
    both, own, others = one.with_blends_of(other, v[None], w[None])
    np.testing.assert_allclose(both.configurations(own)[0], one.configuration(v), atol=1e-9)
    np.testing.assert_allclose(both.configurations(others)[0], other.configuration(w), atol=1e-9)


def bent_configuration(arm: Arm, seed: int) -> FloatArray:
    """A configuration of a fed arm, bent at random where it is well outside its tube."""
    rng = np.random.default_rng(seed)
    feed = float(rng.uniform(0.4, 0.8))
    bends = rng.uniform(-0.2, 0.2, (arm.links, 2))
    bends[feed + arm.link_length * np.arange(arm.links) < arm.hole + arm.link_length] = 0.0
    return np.append(bends.ravel(), feed)


def _difference(curve: CurveMap, v: FloatArray) -> FloatArray:
    """The derivative of the configuration by the last unknown, by central differences."""
    step = np.append(np.zeros(len(v) - 1), 1e-5)
    return (curve.configuration(v + step) - curve.configuration(v - step)) / 2e-5


@given(st.floats(0.1, 0.9), st.floats(0.0, 0.2), st.sampled_from([11, 16, 22]), st.integers(0, 3))
@settings(max_examples=30, deadline=None)
def test_an_arm_that_never_leaves_its_tube_wholly_is_fed(travel: float, inside: float, knots: int, locked: int) -> None:
    """A step of the tip straight ahead feeds it, also where the last joints are locked, as those of tools are."""
    arm = snake(24, feed=Feed(0.0, travel, 1.0 + inside))
    limits = np.ones(48)
    limits[48 - 2 * locked :] = 0.0
    arm = replace(arm, proportions=Proportions(np.ones(24), np.ones(24), limits))
    q = np.zeros(len(arm.coordinates))
    curve, v = CurveMap.through(arm, q, knots)
    pose = curve.pose(v)
    stepper = SpaceStepper(curve, (AtRest(), JointLimit(arm, 1.0, 1.0), FeedLimit()), SpaceMotionSettings())
    ahead = stepper.step(pose, [Term(pose.moving[-1], np.array([0.02, 0.0, 0.0]), 1e4)])
    assert ahead.q[-1] > 0.005  # of 20 mm; steps are bounded
    assert ahead.q[:-1] == pytest.approx(q[:-1], abs=1e-9)
