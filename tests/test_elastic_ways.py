"""Elastic bands: given ends, bends and gaps of links that slide along them, in pipes and round boxes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.elastic_ways import ElasticBand, ElasticWay
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.link_chains import LinkChains
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.planning.tip_ways import SpaceTipWays
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.biarc import free_before
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from tests.snakes_in_space import boxes, task_of
from tests.test_slid_along import LENGTH, fed_arm
from tests.witness_scenes import witness_scene

UNIT = LENGTH / NOMINAL_LINKS
KEPT = 0.01
WANTED = 0.01
PLATES = SurfaceTree.from_triangles(
    boxes([([0.2, -0.5, -0.5], [0.22, 0.03, 0.5]), ([0.45, 0.03, -0.5], [0.47, 0.5, 0.5])])
)


def band_of(arm: Arm) -> ElasticBand:
    """A band among two plates across the way with their gaps on different sides."""
    return ElasticBand(arm, PLATES, UNIT, KEPT, WANTED)


def in_the_open(feed: float, links: int = 12, seconds: float = 60.0) -> tuple[SpaceTask, SpaceTipWays]:
    """The task of a straight arm fed out to a place in the open, and the ways of its tip."""
    arm = replace(fed_arm(links), feed=Feed(0.0, 0.85, LENGTH))
    start = np.zeros(len(arm.coordinates))
    start[-1] = feed
    block = boxes([([0.4, 0.3, -0.1], [0.5, 0.4, 0.1])])
    task = task_of(arm, block, GoalPose(np.array([0.7, 0.1, 0.0])), start=start, seconds=seconds)
    return task, SpaceRun.from_task(task).ways()


def drawn(band: ElasticBand, goal: FloatArray, direction: FloatArray | None) -> ElasticWay:
    """The band from a start beyond the hole, by corners that hug the plates."""
    arm = band.arm
    out = arm.link_length + free_before(arm)
    behind = np.array([[out - k * band.piece, 0.0, 0.0] for k in range(band.pieces, 0, -1)])
    corners = np.array(
        [[out, 0.0, 0.0], [0.19, 0.045, 0.0], [0.24, 0.045, 0.0], [0.44, 0.015, 0.0], [0.48, 0.015, 0.0]]
    )
    way = band.along(behind, np.vstack((corners, goal)), out, direction)
    assert way is not None
    return way


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=20, deadline=None)
@given(st.sampled_from([12, 16, 24, 36]), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.booleans())
def test_links_on_a_band_keep_their_distance_and_bends(links: int, y: float, z: float, directed: bool) -> None:
    """Its ends are those given, and every link that slides along it is as clear and as little bent as is said."""
    band = band_of(fed_arm(links))
    goal = np.array([0.7, y, z])
    direction = np.array([1.0, 0.0, 0.0]) if directed else None
    way = drawn(band, goal, direction)
    assert way.places[-1] == pytest.approx(goal, abs=1e-12)
    if directed:
        last = way.places[-1] - way.places[-1 - band.pieces]
        assert last / np.linalg.norm(last) == pytest.approx(direction, abs=1e-9)
    assert way.gap > 0.0
    assert way.bend < 1.0
    # A track from before the tube on: a straight joint at the mouth, then links on chords of the band.
    track = ArmTrack.behind(np.array([[-LENGTH, 0.0, 0.0], way.places[0]]), way.places)
    link = band.arm.link_length
    for tip in np.linspace(track.start + link, track.length, 40):
        joints = track.at(track.joints_behind(float(tip), np.full(links, link)))
        segments = np.stack((joints[:-1], joints[1:]), axis=1)
        # Pieces may be a little longer or shorter than an even part of a link.
        assert PLATES.distances(segments, 1.0).min() > KEPT + way.gap - 0.05 * UNIT


def test_a_band_that_cannot_be_followed_says_where() -> None:
    """Between plates nearer to each other than the arm can bend, it is the bend there."""
    arm = fed_arm(8)
    walls = boxes([([0.2, -0.5, -0.5], [0.22, 0.2, 0.5]), ([0.27, -0.2, -0.5], [0.29, 0.5, 0.5])])
    band = ElasticBand(arm, SurfaceTree.from_triangles(walls), UNIT, KEPT, WANTED)
    out = arm.link_length
    behind = np.array([[out - k * band.piece, 0.0, 0.0] for k in range(band.pieces, 0, -1)])
    corners = np.array(
        [[out, 0, 0], [0.17, 0.22, 0], [0.245, 0.22, 0], [0.245, -0.22, 0], [0.32, -0.22, 0], [0.7, 0, 0]]
    )
    way = band.along(behind, corners, out, None)
    assert way is not None
    assert way.bend > 1.0 or way.gap < 0.0
    assert 0.1 < way.worst[0] < 0.4


def test_no_band_is_shorter_than_its_straight_end() -> None:
    """There is none where the goal is nearer than a link."""
    band = band_of(fed_arm(8))
    behind = np.array([[-k * band.piece, 0.0, 0.0] for k in range(band.pieces, 0, -1)])
    assert band.along(behind, np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]]), 0.2, None) is None


@pytest.mark.drawn(1, of="long links")
@pytest.mark.planning
@pytest.mark.parametrize(("family", "seed"), [("helix", 3), ("pipes", 2), ("ribs", 4)])
def test_an_arm_of_long_links_slides_through_what_bends_right_after_the_hole(family: str, seed: int) -> None:
    """One of the first bands suffices, though the goal lies in a bend and shorter ways turn off too sharply."""
    problem = witness_scene(family, seed, 12).problem
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    motion = find_by_ways(space_task(problem, tree, Deadline.after(60.0), SpaceMotionSettings()))
    assert motion.candidate == "on the track of the tip"


@pytest.mark.parametrize("feed", [0.0, 0.3])
def test_bands_begin_where_the_tip_may_leave_its_straight_path(monkeypatch: pytest.MonkeyPatch, feed: float) -> None:
    """Whether the tip is in the guide tube or out of it, bands from grids and from chains begin at that place."""
    task, ways = in_the_open(feed)
    begins = []

    def noted(self: ElasticBand, behind: FloatArray, way: FloatArray, *others: object) -> None:
        del self, behind, others
        begins.append(way[0])

    monkeypatch.setattr(ElasticBand, "along", noted)
    for bands in (ways._elastic(20_000), ways._chained(range(1))):
        begins.clear()
        assert list(bands) == []
        assert len(begins) > 0
        np.testing.assert_allclose(begins, np.broadcast_to(ways.start, (len(begins), 3)), atol=1e-9)
    assert (ways.straight > 0.0) == (feed == 0.0)
    assert not task.deadline.passed()


def test_no_chains_grow_after_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even where no chain has been found yet."""
    _, ways = in_the_open(0.0, seconds=0.0)
    monkeypatch.setattr(LinkChains, "grown", lambda *_: pytest.fail("chains were grown"))
    assert list(ways._chained(range(8))) == []


@pytest.mark.parametrize(("links", "times"), [(24, 2), (48, 1)])
def test_no_first_way_is_tried_twice(monkeypatch: pytest.MonkeyPatch, links: int, times: int) -> None:
    """Ways that bend earlier follow only if the joints of an arm may bend earlier."""
    task, _ = in_the_open(0.0, links=links)
    for kind in ("_elastic", "_chained", "_behind_the_tip"):
        monkeypatch.setattr(SpaceTipWays, kind, lambda *_: iter(()))
    found = list(SpaceRun.from_task(task).first_ways())
    assert [way.name for way in found] == times * ["straight"]
    assert len({way.corners[1, 0] for way in found}) == times
