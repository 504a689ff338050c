"""Rows of the optimisation in space: their slopes, and what they say of the room between keyframes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.planning.space_sweep import BETWEEN, SpaceSweep, motion_rows, room_lacking, room_lacking_on_the_way
from ccm_opt.robot.arm import Feed
from tests.snakes_in_space import balls, snake, task_of

WANTED = 0.02


def random_sweep(seed: int) -> tuple[SpaceSweep, SpaceCertificate]:
    """A motion of three intervals past a few balls, fed or not, and the proof of contact there."""
    rng = np.random.default_rng(seed)
    arm = snake(8, feed=Feed(-0.5, 0.0, 0.0) if rng.random() < 0.5 else None)
    soup = balls(rng.uniform(-0.2, 0.8, size=(6, 3)) + np.array([0.3, 0.0, 0.0]), 0.1)
    start = np.zeros(len(arm.coordinates))
    start[2 * arm.links :] = -0.4
    task = task_of(arm, soup, GoalPose(np.array([0.5, 0.3, 0.3])), start=start)
    curve, v = CurveMap.through(arm, start)
    steps = np.cumsum(0.1 * rng.normal(size=(4, len(v))), axis=0)
    return SpaceSweep(curve, v + steps), task.contact_certificate


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_slopes_of_rows_are_their_differences(seed: int) -> None:
    """By the unknowns of the keyframe before and of the one behind, for rows at the ends and in between."""
    sweep, proof = random_sweep(seed)
    rows = motion_rows(sweep, proof, WANTED, 5.0 * sweep.space.nominal_length)
    step = 1e-6
    for side in (0, 1):
        slopes = rows.slopes(sweep)[side]
        for unknown in (0, 5, sweep.unknowns.shape[1] - 1):
            for keyframe in range(len(sweep.unknowns)):
                moved = np.zeros_like(sweep.unknowns)
                moved[keyframe, unknown] = step
                ahead = rows.values(SpaceSweep(sweep.space, sweep.unknowns + moved))
                behind = rows.values(SpaceSweep(sweep.space, sweep.unknowns - moved))
                mine = np.flatnonzero(rows.interval + side == keyframe)
                expected = (ahead - behind)[mine] / (2.0 * step)
                assert slopes[mine, unknown] == pytest.approx(expected, abs=1e-6)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_what_room_is_lacking_is_that_of_the_poses(seed: int) -> None:
    """At the ends of intervals and at the times in between."""
    sweep, proof = random_sweep(seed)
    arm = sweep.space.arm
    lacking = room_lacking(sweep, proof, WANTED)
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    for k, (before, after) in enumerate(zip(sweep.unknowns[:-1], sweep.unknowns[1:], strict=True)):
        least = np.inf
        for share in (0.5, 1.0, *BETWEEN):
            points = arm.joint_positions_at(sweep.space.configuration((1.0 - share) * before + share * after))
            axes = np.stack((points[first:-1], points[first + 1 :]), axis=1)
            least = min(least, float(np.min(proof.tree.distances(axes, 1.0))))
        assert lacking[k] == pytest.approx(max(proof.kept + WANTED - least, 0.0), abs=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_what_is_lacking_at_the_ends_is_not_lacking_on_the_way(seed: int) -> None:
    """A motion that stands still lacks nothing; one that begins and ends elsewhere what its least gap lacks more."""
    sweep, proof = random_sweep(seed)
    whole = float(np.max(room_lacking(sweep, proof, WANTED)))
    ends = np.stack((sweep.unknowns[:-1], sweep.unknowns[:-1]), axis=1)
    stills = [SpaceSweep(sweep.space, still) for still in (*ends, np.stack((sweep.unknowns[-1],) * 2))]
    assert [room_lacking_on_the_way(still, proof, WANTED) for still in stills] == pytest.approx(np.zeros(4), abs=1e-9)
    at_ends = max(float(np.max(room_lacking(still, proof, WANTED))) for still in (stills[0], stills[-1]))
    assert room_lacking_on_the_way(sweep, proof, WANTED) == pytest.approx(whole - at_ends, abs=1e-9)
