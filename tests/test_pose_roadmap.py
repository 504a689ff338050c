"""Roadmaps of poses: ways over certified straight motions only, and only where there are any."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import floyd_warshall

from ccm_opt.driver.pose_roadmap import PoseRoadmap


@given(
    places=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=3, max_size=12, unique=True),
    wall=st.floats(0.5, 8.5),
    gap=st.integers(0, 9),
)
@settings(max_examples=30, deadline=None)
def test_ways_lead_over_motions_that_are_safe_and_are_the_fastest(
    places: list[tuple[int, int]], wall: float, gap: int
) -> None:
    """Every way has the ends asked for and only safe steps, none is faster, and none is missing."""
    pace = np.array([1.0, 2.0])

    def safe(first: np.ndarray, last: np.ndarray) -> bool:
        """A wall between columns may be crossed along one row only."""
        crosses = (first[0] - wall) * (last[0] - wall) < 0.0
        return bool(not crosses or first[1] == last[1] == gap)

    poses = [np.array(place, dtype=np.float64) for place in places]
    roadmap = PoseRoadmap(safe, pace, np.array(poses[:-1]))
    roadmap.add(np.array(poses[-1:]))
    roadmap.find_neighbours()
    roadmap.join()
    graph = np.full((len(poses), len(poses)), np.inf)
    for pair, time in (roadmap.times | roadmap.untried).items():
        np.testing.assert_allclose(time, np.max(np.abs(np.diff(roadmap.poses[list(pair)], axis=0)) / pace))
        if safe(*roadmap.poses[list(pair)]):
            graph[pair] = graph[pair[::-1]] = time
    least = floyd_warshall(graph)
    np.testing.assert_array_equal(roadmap.joined, np.isfinite(least[0]) | (np.arange(len(poses)) == 0))
    assert np.all(roadmap.estimates(len(poses)) <= least + 1e-9)
    for k, q in enumerate(poses):
        chain = roadmap.chain(poses[0], q)
        if chain is None:
            assert not np.isfinite(least[0, k])
            continue
        np.testing.assert_array_equal(chain[[0, -1]], [poses[0], q])
        steps = list(itertools.pairwise(chain))
        assert all(safe(*step) for step in steps)
        time = sum(float(np.max(np.abs(one - other) / pace)) for one, other in steps)
        np.testing.assert_allclose(time, least[0, k] if k else 0.0, atol=1e-9)
    assert roadmap.chain(poses[0], np.array([0.5, 0.5])) is None
    # A known motion needs no further certificate, wherever it leads.
    roadmap.add_motion(0, len(poses) - 1, np.stack((poses[0], np.array([20.0, 20.0]), poses[-1])))
    assert roadmap.chain(poses[0], poses[-1]) is not None
