"""Rows of the optimisation in space: their slopes, and what they say of the room between keyframes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.limits.limit_stack import ContactLimit, JointLimit
from ccm_opt.planning.limits.surface_rows import clearance_shortfall, motion_rows
from ccm_opt.planning.optimisation.interval_rows import Sweep
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.robot.base_axes import Feed
from tests.snakes_in_space import balls, snake, task_of

WANTED = 0.02


def random_sweep(seed: int) -> tuple[Sweep, SpaceTask]:
    """A motion of three intervals past a few balls, fed or not, and its task."""
    rng = np.random.default_rng(seed)
    arm = snake(8, feed=Feed(-0.5, 0.0, 0.0) if rng.random() < 0.5 else None)
    arm = replace(arm, mount_length=arm.link_length * rng.choice([0.4, 1.0, 1.7]))
    triangle_soup = balls(rng.uniform(-0.2, 0.8, size=(6, 3)) + np.array([0.3, 0.0, 0.0]), 0.1)
    start = np.zeros(len(arm.coordinates))
    start[2 * arm.links :] = -0.4
    task = task_of(arm, triangle_soup, GoalPose(np.array([0.5, 0.3, 0.3])), start=start)
    curve, v = CurveMap.through(arm, start)
    steps = np.cumsum(0.1 * rng.normal(size=(4, len(v))), axis=0)
    return Sweep(curve, v + steps), task


@pytest.mark.drawn(20, of="dear tests")
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_slopes_of_rows_are_their_differences(seed: int) -> None:
    """By the unknowns of the keyframe before and of the one behind, for rows at the ends and in between."""
    sweep, task = random_sweep(seed)
    finder = task.finder(0.0, 5.0 * sweep.space.nominal_length)
    contact = next(limit for limit in task.limits(finder, WANTED) if isinstance(limit, ContactLimit))
    rows = motion_rows(sweep, contact, finder)
    step = 1e-6
    for side in (0, 1):
        slopes = rows.slopes(sweep)[side]
        for unknown in (0, 5, sweep.unknowns.shape[1] - 1):
            for keyframe in range(len(sweep.unknowns)):
                moved = np.zeros_like(sweep.unknowns)
                moved[keyframe, unknown] = step
                ahead = rows.values(Sweep(sweep.space, sweep.unknowns + moved))
                behind = rows.values(Sweep(sweep.space, sweep.unknowns - moved))
                mine = np.flatnonzero(rows.interval + side == keyframe)
                expected = (ahead - behind)[mine] / (2.0 * step)
                assert slopes[mine, unknown] == pytest.approx(expected, abs=1e-6)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_what_room_is_lacking_is_that_of_the_poses(seed: int) -> None:
    """At the ends of intervals and at the times in between."""
    sweep, task = random_sweep(seed)
    proof = task.contact_certificate
    arm = sweep.space.arm
    shortfall = clearance_shortfall(sweep, task.finder(0.0, 0.0), WANTED).reshape(sweep.intervals, -1)
    first, share_in_mount = divmod(arm.mount_length / arm.link_length, 1.0)
    for k, (before, after) in enumerate(zip(sweep.unknowns[:-1], sweep.unknowns[1:], strict=True)):
        for part, share in enumerate((0.25, 0.5, 0.75, 1.0)):
            points = arm.joint_positions_at(sweep.space.configuration((1.0 - share) * before + share * after))
            axes = np.stack((points[int(first) : -1], points[int(first) + 1 :]), axis=1)
            axes[0, 0] += share_in_mount * (axes[0, 1] - axes[0, 0])
            least = float(np.min(proof.tree.distances(axes, 1.0)))
            assert shortfall[k, part] == pytest.approx(max(float(proof.kept[0]) + WANTED - least, 0.0), abs=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_bends_of_fed_arms_are_bounded_between_keyframes(seed: int) -> None:
    """There, too, rows predict each free bend's distance from its limits after a small change of both keyframes."""
    rng = np.random.default_rng(seed)
    arm = replace(snake(8, feed=Feed(0.0, 0.8, 0.8)), joint_limit=0.2)
    curve, v = CurveMap.through(arm, np.append(np.zeros(2 * arm.links), 0.4))
    sweep = Sweep(curve, v + np.cumsum(0.01 * rng.normal(size=(4, len(v))), axis=0))
    limit = JointLimit(arm, 0.99, 1.0)
    _, rows = limit.keyframe_rows(sweep, np.zeros(0))
    change = 1e-6 * rng.normal(size=sweep.unknowns.shape)
    _, moved = limit.keyframe_rows(Sweep(curve, sweep.unknowns + change), np.zeros(0))
    bends, after = (-0.5 * (each.lower + each.upper).reshape(9, -1) for each in (rows, moved))
    share = np.tile([0.25, 0.5, 0.75], 3)[:, None]
    between = (1.0 - share) * np.repeat(sweep.unknowns[:-1], 3, axis=0) + share * np.repeat(
        sweep.unknowns[1:], 3, axis=0
    )
    assert bends == pytest.approx(curve.configurations(between)[:, 2:-1], abs=1e-12)
    assert rows.before is not None
    turned = np.sum(rows.before * change[rows.keyframe - 1] + rows.slopes * change[rows.keyframe], axis=1)
    assert after == pytest.approx(bends + turned.reshape(bends.shape), abs=1e-9)
