"""Links proved clear of walls: C against shapely, and what no proof may miss."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.certificate import MotionParts, WallProofs
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .oracles.wall_proofs import InterpretedWallProofs
from .scenes import ROOM, clutter, make_arm, mixed_walls, random_headings

seeds = st.integers(0, 2**32 - 1)
HAIR = 1e-10
"""By which distances that decide may differ from rounding [m]; less than the proofs keep for it."""


def with_a_court(seed: int) -> Workspace:
    """A block with a court in its middle, among other things."""
    outside = shapely.box(-0.6, -0.6, 0.7, 0.5).exterior.coords
    court = shapely.box(-0.3, -0.25, 0.45, 0.2).exterior.coords
    rng = np.random.default_rng(seed)
    posts = [Obstacle(f"post {k}", PlaneShape(shapely.Point(rng.uniform(-1.0, 1.0, 2)), 0.02)) for k in range(3)]
    return Workspace(
        ROOM, (posts[0], Obstacle("block", PlaneShape(shapely.Polygon(outside, [court]))), *posts[1:]), 0.002
    )


def walls_of_all_kinds(seed: int) -> Workspace:
    """One of several rooms."""
    kinds = (clutter(seed % 7, 30).workspace, mixed_walls(), with_a_court(seed), Workspace(ROOM))
    return kinds[seed % len(kinds)]


def asked_of(arm: Arm, workspace: Workspace, more: float = 0.0) -> WallProofs:
    """A question with numbers that are all of some account."""
    room = 1e-3 / arm.links * np.arange(arm.links)
    whole = arm.mount_length / arm.link_length
    return WallProofs(workspace, arm.radius + room + 1e-9 + more, (int(whole), whole - int(whole)))


def pairs(columns: tuple[IntArray, IntArray]) -> set[tuple[int, int]]:
    """Stretches and links as a set."""
    return set(zip(columns[0].tolist(), columns[1].tolist(), strict=True))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(
    seed=seeds,
    links=st.sampled_from((2, 7, 24)),
    radius=st.sampled_from((0.0, 0.01)),
    mount=st.sampled_from((0.0, 0.6, 1.0, 1.6)),
    turn=st.sampled_from((0.0, 0.02, 0.2, 1.0)),
)
@settings(max_examples=150, deadline=None)
def test_compiled_proofs_are_those_of_shapely(seed: int, links: int, radius: float, mount: float, turn: float) -> None:
    """Whatever the motion and the walls, C and shapely leave the same links unproved, at once and when asked again."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links, radius, mount_length=mount / links)
    workspace = walls_of_all_kinds(seed)
    start = arm.bends(np.array([random_headings(rng, arm, 5.0) for _ in range(3)]))
    motion = MotionParts(arm, start, start + arm.bends(turn * rng.standard_normal(start.shape)), np.arange(3))
    proofs = asked_of(arm, workspace)
    found, touched = proofs.unproved(motion, None)

    # A distance within rounding of the limit may fall either way.
    fewer, more = (InterpretedWallProofs(asked_of(arm, workspace, by)).unproved(motion, None) for by in (-HAIR, HAIR))
    assert pairs(fewer[0]) <= pairs(found) <= pairs(more[0])
    assert set(fewer[1].tolist()) <= set(touched.tolist()) <= set(more[1].tolist())

    some = rng.random(len(found[0])) < 0.7
    again, touched = proofs.unproved(motion, (found[0][some], found[1][some]))
    assert pairs(again) == pairs((found[0][some], found[1][some]))
    assert set(touched.tolist()) <= set(more[1].tolist())


@given(seed=seeds, links=st.sampled_from((6, 24)), turn=st.sampled_from((0.02, 0.3)))
@settings(max_examples=60, deadline=None)
def test_the_hull_of_a_proved_link_is_apart(seed: int, links: int, turn: float) -> None:
    """No link is proved whose hull comes as near to a wall as it may not, by a distance that shapely measures."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links, 0.005)
    workspace = walls_of_all_kinds(seed)
    start = arm.bends(random_headings(rng, arm, 5.0)[None])
    motion = MotionParts(arm, start, start + arm.bends(turn * rng.standard_normal(start.shape)), np.arange(1))
    question = asked_of(arm, workspace)
    left = pairs(question.unproved(motion, None)[0])
    for link in range(links):
        hull = shapely.MultiPoint(np.vstack((motion.a[0, link : link + 2], motion.b[0, link : link + 2]))).convex_hull
        gap = min(shapely.distance(hull, wall.core) - wall.rounding for wall in workspace.walls)
        need = question.least[link] + motion.chord_deviation[0, link]
        assert gap > need - HAIR or (0, link) in left
        assert gap < need + HAIR or (0, link) not in left


@pytest.mark.parametrize("inside", [True, False])
def test_a_court_is_free_and_its_block_is_not(*, inside: bool) -> None:
    """Far from every edge a link is in the way inside the block, and clear in the court."""
    big = Obstacle("block", PlaneShape(shapely.Polygon(shapely.box(-9.0, -9.0, 9.0, 9.0).exterior.coords, _court(4.0))))
    arm = replace(make_arm(12, 0.01), base=np.array([6.0 if inside else 0.0, 0.3]))
    still = np.zeros((1, 12))
    left, touched = asked_of(arm, Workspace(shapely.box(-20, -20, 20, 20), (big,))).unproved(
        MotionParts(arm, still, still + 0.01 * np.eye(1, 12), np.arange(1)), None
    )
    assert len(left[0]) == (12 if inside else 0)
    assert len(touched) == len(left[0])


def _court(half: float) -> list[shapely.Geometry]:
    return [shapely.box(-half, -half, half, half).exterior.coords]


def test_what_is_no_number_is_not_proved() -> None:
    """A link with a heading that is NaN is refused, and so are those that it carries."""
    arm = make_arm(6, 0.01)
    start = np.zeros((1, 6))
    end = start.copy()
    end[0, 2] = np.nan
    left, _ = asked_of(arm, Workspace(ROOM)).unproved(MotionParts(arm, start, end, np.arange(1)), None)
    assert {2, 3, 4, 5} <= set(left[1].tolist())
