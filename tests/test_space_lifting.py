"""Motions of nominal links laid under arms of many: the same places all along, the same feed, the goal at the end."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.refinement import nominal_task, refine_space_motion
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from tests.snakes_in_space import balls, snake, task_of

NOTHING_NEAR = balls(np.array([[0.0, 0.0, 9.0]]), 0.01)
FEED = Feed(0.0, 0.6, 0.6)
NEAR = 0.5 / NOMINAL_LINKS
"""Half of a nominal link of an arm of a metre [m]; most are within a millimetre or two."""


def begun(random: np.random.Generator, links: int, *, fed: bool) -> SpaceTask:
    """A task of an arm of a metre: in its guide tube, or on a base that is turned by up to 2.5 rad, a little bent."""
    # Links may cross, so that nothing but its limits can be in the way of a shape that is drawn.
    arm = replace(snake(links, feed=FEED if fed else None), self_collision=False)
    start = np.zeros(len(arm.coordinates))
    if not fed:
        curve, _ = CurveMap.through(arm, start)
        v = np.concatenate((random.uniform(-2.5, 2.5, 2), random.normal(0.0, 0.1, curve.dimension - 2)))
        start = curve.configuration(v)
    tip = arm.joint_positions_at(start)[-1]
    return task_of(arm, NOTHING_NEAR, GoalPose(tip, near_enough=(1e-3, 1e-2)), start=start)


def coarse_motion(random: np.random.Generator, few: SpaceTask, *, fed: bool) -> SpaceMotion:
    """A motion of the coarse arm to another shape, of which its curve does not show everything; not certified."""
    curve, v = CurveMap.through(few.arm, few.start)
    end = v + random.normal(0.0, 0.25, len(v))
    if fed:
        end[curve.feed_column] = 0.5 / curve.scale[curve.feed_column]
    rough = curve.configuration(end)
    bent = np.arange(2 * NOMINAL_LINKS) >= (NOMINAL_LINKS if fed else 0)
    rough[: 2 * NOMINAL_LINKS] += random.normal(0.0, 0.02, 2 * NOMINAL_LINKS) * bent
    blended, end = curve.blended_to(rough)
    shares = np.linspace(0.0, 1.0, 8)[:, None]
    unknowns = (1.0 - shares) * np.append(v, 0.0) + shares * end
    # The blend rises and falls on the way, as an optimised one does.
    unknowns[1:-1, -1] += random.normal(0.0, 0.3, 6)
    return SpaceMotion(blended, unknowns, blended.configurations(unknowns), "drawn")


def places_along(points: FloatArray) -> FloatArray:
    """Places of an arm at the coarse joints and the tip, linear along its links, shape (25, 3) [m]."""
    along = np.linspace(0.0, len(points) - 1.0, NOMINAL_LINKS + 1)
    return np.stack([np.interp(along, np.arange(len(points)), column) for column in points.T], axis=1)


@pytest.mark.drawn(20, of="dear tests")
@given(st.integers(0, 2**32 - 1), st.sampled_from([37, 48, 60, 96]), st.booleans())
@settings(max_examples=6, deadline=None)
def test_the_arm_lies_where_the_coarse_one_does(seed: int, links: int, fed: bool) -> None:
    """At every keyframe, to half a link, fed as far, and the tip ends on its goal; some shape may not be met."""
    random = np.random.default_rng(seed)
    met = [lies_along(random, begun(random, links, fed=fed), fed=fed) for _ in range(6)]
    assert sum(met) >= 4


def lies_along(random: np.random.Generator, task: SpaceTask, *, fed: bool) -> bool:
    """Whether an arm can be laid along a motion that is drawn for a coarse one."""
    links = task.arm.links
    few = nominal_task(task)
    assert few is not None
    np.testing.assert_array_equal(few.start[2 * NOMINAL_LINKS :], task.start[2 * links :])
    at_start = few.arm.joint_positions_at(few.start) - places_along(task.arm.joint_positions_at(task.start))
    found = coarse_motion(random, few, fed=fed)
    last = found.configurations[-1]
    tip, direction = few.arm.joint_positions_at(last)[-1], few.arm.link_rotations(last)[-1, :, 0]
    goal = GoalPose(tip, direction, near_enough=(1e-3, 1e-2))
    refined = refine_space_motion(task_of(task.arm, NOTHING_NEAR, goal, start=task.start), found)
    if refined is None:
        return False
    own = refined.curve.configurations(refined.unknowns)
    pairs = zip(own, found.configurations, strict=True)
    apart = [places_along(task.arm.joint_positions_at(fine)) - few.arm.joint_positions_at(q) for fine, q in pairs]
    # The last pose is moved onto the goal, by the feed too.
    np.testing.assert_allclose(own[:-1, 2 * links :], found.configurations[:-1, 2 * NOMINAL_LINKS :], atol=1e-12)
    assert np.linalg.norm(task.arm.joint_positions_at(refined.configurations[-1])[-1] - tip) < 1e-6
    return bool(np.max(np.linalg.norm([at_start, *apart], axis=-1)) < NEAR)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_arm_that_the_fit_overbends_is_fitted_within_its_limit(seed: int) -> None:
    """With a limit just below the bends of the first fit, another fit stays within the limit, and is certified."""
    random = np.random.default_rng(seed)
    task = begun(random, 48, fed=True)
    few = nominal_task(task)
    assert few is not None
    found = coarse_motion(random, few, fed=True)
    tip = few.arm.joint_positions_at(found.configurations[-1])[-1]
    goal = GoalPose(tip, None, near_enough=(1e-3, 1e-2))
    free = refine_space_motion(task_of(task.arm, NOTHING_NEAR, goal, start=task.start), found)
    assert free is not None
    most = 0.99 * float(np.max(np.abs(free.configurations[:, : 2 * task.arm.links])))
    stiffer = task_of(replace(task.arm, joint_limit=most), NOTHING_NEAR, goal, start=task.start)
    fitted = refine_space_motion(stiffer, found)
    assert fitted is not None
    assert np.max(np.abs(fitted.configurations[:, : 2 * task.arm.links])) <= most + 1e-9
    assert len(stiffer.certificate.failures(fitted.configurations)) == 0
