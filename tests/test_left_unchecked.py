"""What no check looks at is said: mounts, links that are not kept apart, and near links that cross."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.selfcollision import far_along_arm
from ccm_opt.verification.verifier import left_unchecked

from .arms import plain_arm
from .space_arms import space_arm

ROOM = Workspace(shapely.box(-9.0, -9.0, 9.0, 9.0))


def remarks(arm: Arm, bends: Any) -> tuple[str, ...]:
    """What is said of a motion with given poses as samples."""
    positions = np.asarray(bends, dtype=np.float64)
    one = np.ones(3 * arm.links)
    room = ROOM if arm.dimension == 2 else Workspace()
    poses = (JointPose(bends.reshape(arm.links, -1).squeeze()) for bends in positions[[0, -1]])
    problem = Problem("said", room, arm, Limits(one, one), *poses)
    still = np.zeros_like(positions)
    return left_unchecked(problem, JointTrajectory(0.005 * np.arange(len(positions)), positions, still, still))


def test_nothing_is_said_where_everything_is_checked() -> None:
    """An arm with a short mount, whose links are kept apart and bend a little."""
    assert remarks(plain_arm(6, mount_length=0.02), np.full((2, 6), 0.2)) == ()


@pytest.mark.parametrize(
    ("mount", "said"),
    [
        (0.6, "the whole arm counts as its mount"),
        (9.0, "the whole arm"),
        (0.25, "not checked for links 1 to 2"),
        (0.1, "not checked for link 1, which belongs to the mount"),
    ],
)
def test_a_mount_that_covers_links_is_named(mount: float, said: str) -> None:
    """A mount as long as the arm leaves nothing to be held against walls, and that is said."""
    (remark,) = remarks(plain_arm(6, mount_length=mount), np.zeros((2, 6)))
    assert said in remark


def test_links_that_are_not_kept_apart_are_named() -> None:
    """Because nobody asked for it, or because all of them are near each other."""
    arm = plain_arm(6)
    (remark,) = remarks(replace(arm, self_collision=False), np.zeros((2, 6)))
    assert "self_collision is false" in remark
    (remark,) = remarks(plain_arm(2), np.zeros((2, 2)))
    assert "all are close to each other" in remark


def test_links_that_cross_though_they_are_near_are_named() -> None:
    """Links i and i + 2 may cross between two samples; both are named, with the time."""
    arm = plain_arm(6, joint_limit=2.6)
    bent = np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0])
    assert remarks(arm, [bent, bent]) == ()
    crossed = np.array([0.0, 0.0, 2.4, 2.4, 0.0, 0.0])
    (remark,) = remarks(arm, [bent, crossed])
    assert "link 2 crosses link 4 at t = 0.00" in remark


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ()),
        ({"mount_length": 0.6}, ("the whole arm counts as its mount",)),
        ({"mount_length": 0.25}, ("not checked for links 1 to 2",)),
        ({"self_collision": False}, ("self_collision is false",)),
        ({"links": 2}, ("all are close to each other",)),
        ({"links": 2, "mount_length": 0.2}, ("the whole arm counts", "all are close to each other")),
    ],
)
def test_arms_in_space_say_the_same(changes: dict[str, Any], said: tuple[str, ...]) -> None:
    """All that follows from the arm alone."""
    arm = space_arm(**changes)
    told = remarks(arm, np.zeros((2, 2 * arm.links)))
    assert len(told) == len(said)
    assert all(words in clause for words, clause in zip(said, told, strict=True))


def test_the_record_of_a_plan_in_space_says_it() -> None:
    """A plan of two links, which nothing keeps apart."""
    arm = space_arm(2)
    ones = np.ones(3 * arm.links)
    rest, bent = (JointPose(np.full((2, 2), bend)) for bend in (0.0, 0.2))
    problem = Problem("two links", Workspace(bounds=None, obstacles=()), arm, Limits(ones, ones), rest, bent)
    (remark,) = ccm_opt.solve(problem).not_checked
    assert "all are close to each other" in remark


@given(st.integers(0, 2**32 - 1))
def test_axes_that_cross_bend_by_half_a_turn(seed: int) -> None:
    """Theorem 6: where two links cross that share no joint, the bends between them add up to π at least."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(6, radius=0.1)
    assert not far_along_arm(arm)[0, 3]
    bends = rng.uniform(-1.0, 1.0, 6) * rng.uniform(0.5, 2.8)
    points = arm.joint_positions(arm.headings(bends))
    links = [shapely.LineString(points[k : k + 2]) for k in range(6)]
    for i in range(6):
        for j in range(i + 2, 6):
            if links[i].intersects(links[j]):
                assert np.sum(np.abs(bends[i + 1 : j + 1])) >= np.pi - 1e-9
