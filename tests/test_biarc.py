"""Biarcs that meet two poses, and frames that are carried along by the shortest turn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.robot.biarc import Biarc
from ccm_opt.robot.rigid_motions import polar, transported
from tests.space_arms import random_rotation

SEEDS = st.integers(0, 2**32 - 1)


def unit(random: np.random.Generator) -> FloatArray:
    """A direction drawn evenly."""
    vector = random.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_a_biarc_meets_both_poses(seed: int) -> None:
    """Its curve, integrated, starts and ends as asked."""
    random = np.random.default_rng(seed)
    base, frame = random.normal(size=3), random_rotation(random)
    tip, direction = base + random.normal(size=3), unit(random)
    arcs = Biarc.between(base, frame, tip, direction)
    curve = arcs.configuration()
    np.testing.assert_allclose(curve.base_frame, frame)
    position, along = curve.tip
    np.testing.assert_allclose(position, tip, atol=1e-8 * (1.0 + arcs.length))
    np.testing.assert_allclose(along, direction, atol=1e-8)
    assert curve.length == pytest.approx(arcs.length)


def test_poses_that_no_biarc_joins_are_refused() -> None:
    """A tip straight behind that points the way the base does."""
    behind = np.array([-1.0, 0.0, 0.0])
    with pytest.raises(ProblemError, match="behind"):
        Biarc.between(np.zeros(3), np.eye(3), behind, np.array([1.0, 0.0, 0.0]))


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_transport_is_the_shortest_turn(seed: int) -> None:
    """The frame points where it should, stays a rotation, and its axis of turning is across both directions."""
    random = np.random.default_rng(seed)
    frame, direction = random_rotation(random), unit(random)
    carried = transported(frame, direction)
    np.testing.assert_allclose(carried[:, 0], direction, atol=1e-12)
    np.testing.assert_allclose(carried.T @ carried, np.eye(3), atol=1e-12)
    axis = np.cross(frame[:, 0], direction)
    np.testing.assert_allclose(carried.T @ axis, frame.T @ axis, atol=1e-12)
    assert polar(frame, frame[:, 0])[0] == pytest.approx(0.0, abs=1e-12)
