"""Near pairs in C against numpy, and the index under them against plain comparison."""

import gc
import weakref

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.scene.contact_finder import Contacts
from ccm_opt.scene.walls import BoxTree
from ccm_opt.scene.workspace import Workspace

from .oracles.neighbour_pairs import NeighbourPairs, PairQuestion
from .scenes import clutter, make_arm, mixed_walls, random_headings

seeds = st.integers(0, 2**32 - 1)


def asked(links: int, mount: float, reach: float, workspace: Workspace) -> PairQuestion:
    """A question with numbers that are all of some account."""
    arm = make_arm(links, 0.012, mount_length=mount / links)
    return PairQuestion(arm, workspace.flat_walls, 2e-3, 3e-3, reach)


def assert_same(one: Contacts, other: Contacts) -> None:
    """Both lists hold the same pairs in the same order, with the same numbers to rounding."""
    for name in ("first", "second", "wall"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("first_at", "second_at", "normal", "gap", "margin"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)


@settings(max_examples=60)
@given(
    seed=seeds,
    links=st.sampled_from((2, 8, 24, 50)),
    mount=st.sampled_from((0.0, 0.6, 1.0, 1.6)),
    reach=st.sampled_from((0.01, 0.1, 0.6)),
    bend=st.sampled_from((2.0, 6.0, 12.0)),
)
def test_compiled_pairs_are_those_of_numpy(seed: int, links: int, mount: float, reach: float, bend: float) -> None:
    """Whatever the links, the mount, the reach and the pose, C and numpy report the same pairs and crossings."""
    question = asked(links, mount, reach, mixed_walls())
    compiled = question.finder
    by_numpy = NeighbourPairs(question)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        points = question.arm.joint_positions(random_headings(rng, question.arm, bend))
        # A pair within rounding of the reach, or a foot within rounding of a corner, may fall on either side.
        assert_same(compiled.find(points), by_numpy.contacts(points))
        assert compiled.crosses(points) == by_numpy.crosses(points)


def test_what_c_looks_at_lives_as_long_as_the_search() -> None:
    """The arrays behind its bare addresses are kept, also when whoever asked forgets the walls."""
    question = asked(8, 0.0, 0.1, clutter(3, 8).workspace)
    trees = (question.walls.edge_tree, question.walls.vertex_tree)
    arrays = [weakref.ref(array) for tree in trees for array in (tree.items, tree.boxes, tree.offsets)]
    compiled = question.finder
    del question, trees
    gc.collect()
    assert all(array() is not None for array in arrays)
    del compiled
    gc.collect()
    assert all(array() is None for array in arrays)


def test_more_pairs_than_room_are_all_reported() -> None:
    """A reach over the whole room makes more pairs than results have room for at first."""
    question = asked(24, 0.0, 2.0, clutter(3, 60).workspace)
    compiled = question.finder
    points = question.arm.joint_positions(random_headings(np.random.default_rng(1), question.arm, 4.0))
    found = compiled.find(points)
    assert len(found) > 1000
    assert_same(found, NeighbourPairs(question).contacts(points))


@settings(max_examples=60)
@given(seed=seeds, count=st.integers(0, 70))
def test_a_box_tree_finds_what_comparison_finds(seed: int, count: int) -> None:
    """For any number of items the tree names exactly those whose boxes meet a box."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1.0, 1.0, (count, 2))
    high = low + rng.exponential(0.1, (count, 2))
    tree = BoxTree.over(low, high)
    corner = rng.uniform(-1.2, 1.0, 2)
    far = corner + rng.exponential(0.3, 2)
    meeting = np.flatnonzero(np.all((low <= far) & (high >= corner), axis=1))
    np.testing.assert_array_equal(tree.meeting(corner, far), meeting)
