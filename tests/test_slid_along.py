"""Arms that are slid along the track of their tip: joints on it, bends that the tube allows, and few links in pipes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.followable_ways import feeds_to_end, slid_along
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.biarc import FREE_AFTER
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from tests.arms import held_bends
from tests.space_arms import space_arm

from .space_sites import site_problem

LENGTH = 0.9


def fed_arm(links: int) -> Arm:
    """An arm along x, whose tube ends at the origin, and which can be fed out of it whole."""
    outside = 0.86
    return space_arm(
        links,
        link_length=LENGTH / links,
        base=np.array([-outside, 0.0, 0.0]),
        feed=Feed(0.0, 0.85, outside),
        joint_limit=0.5 * np.pi,
    )


def bent_way(radius: float, turn: float, azimuth: float) -> FloatArray:
    """Straight on from where the tip is, then an arc, then straight on again, shape (m, 3) [m]."""
    straight = np.linspace(0.04, 0.2, 30)[:, None] * np.array([1.0, 0.0, 0.0])
    angles = np.linspace(0.0, turn, 60)[1:]
    across = np.array([0.0, np.cos(azimuth), np.sin(azimuth)])
    along = straight[-1] + radius * np.sin(angles)[:, None] * np.array([1.0, 0.0, 0.0])
    arc = along + radius * (1.0 - np.cos(angles))[:, None] * across
    last = np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * across
    return np.vstack((straight, arc, arc[-1] + np.linspace(0.01, 0.2, 20)[:, None] * last))


def off_track(track: ArmTrack, points: FloatArray) -> FloatArray:
    """Distances of points from a track that goes straight on beyond its end, shape (k,) [m]."""
    last = track.points[-1] - track.points[-2]
    beyond = track.points[-1] + np.linspace(0.0, 0.2, 4000)[:, None] * last / np.linalg.norm(last)
    fine = np.vstack((track.at(np.linspace(0.0, track.length, 20_000)), beyond))
    return np.array([float(np.min(np.linalg.norm(fine - point, axis=1))) for point in points])


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=10, deadline=None)
@given(
    st.sampled_from([6, 8, 12, 24, 40]),
    st.floats(0.1, 0.2),
    st.floats(0.2, 1.4),
    st.floats(-np.pi, np.pi),
)
def test_joints_lie_on_the_track_and_bend_only_outside_the_tube(
    links: int, radius: float, turn: float, azimuth: float
) -> None:
    """All joints beyond where bends are free are on it; those in the tube are straight; the tip reaches its end."""
    arm = fed_arm(links)
    start = arm.joint_positions_at(np.zeros(2 * links + 1))
    track = ArmTrack.behind(start, bent_way(radius, turn, azimuth))
    feeds = feeds_to_end(arm, track, 0.0, 0.02)
    configurations = slid_along(arm, track, feeds)
    assert configurations[0] == pytest.approx(np.zeros(2 * links + 1), abs=1e-9)
    for q in configurations:
        held = held_bends(arm, float(q[-1]))
        assert np.max(np.abs(q[:-1][held]), initial=0.0) < 1e-9
        points = arm.joint_positions_at(q)
        places = float(q[-1]) + arm.link_length * np.arange(links + 1) - arm.hole
        free = FREE_AFTER * arm.length / NOMINAL_LINKS + arm.link_length
        assert np.max(off_track(track, points[places > free]), initial=0.0) < 2e-3
    tip = arm.joint_positions_at(configurations[-1])[-1]
    assert np.linalg.norm(tip - track.points[-1]) < 0.01


@pytest.mark.drawn(1, of="long links")
@pytest.mark.planning
def test_few_long_links_pass_a_bent_pipe_with_room() -> None:
    """Links that steps towards the tip's target wedge in the bends slide through on the track of the tip."""
    problem = site_problem("pipe-two-bends", 64002, 12, "pipe")
    solution = ccm_opt.solve(problem, explain=False)
    assert "on the track of the tip" in solution.path.candidate
    assert solution.room.nearest is not None
    assert solution.room.nearest.gap > 0.5 * problem.wanted_gap


@pytest.mark.drawn(1, of="long links")
@pytest.mark.planning
def test_a_motion_that_lacks_room_is_made_of_more_keyframes() -> None:
    """One run of the optimisation leaves a fifth less than is wanted in the bends of this pipe."""
    problem = site_problem("pipe-two-bends", 71002, 16, "pipe")
    solution = ccm_opt.solve(problem, explain=False)
    assert solution.room.nearest is not None
    assert solution.room.nearest.gap > 0.95 * problem.wanted_gap
