"""Bends of arms in space from where their joints are, and from where their links point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.errors import ProblemError
from ccm_opt.robot.inverse_kinematics import bends_from_directions, configuration_from_positions
from ccm_opt.robot.space_arm import joint_positions, link_rotations
from tests.space_arms import FEED_OF_TESTS, space_arm, turned_arm

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.booleans())
@settings(max_examples=30, deadline=None)
def test_joints_give_the_bends_back(seed: int, fed: bool) -> None:
    """Bends from positions, and from directions, are those that made them, within ± 90° of each first bend."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 7, base_limit=1.5, feed=FEED_OF_TESTS if fed else None)
    q = random.uniform(arm.lower_limits, arm.upper_limits, (3, len(arm.coordinates)))
    np.testing.assert_allclose(configuration_from_positions(arm, joint_positions(arm, q)), q, atol=1e-9)
    found = bends_from_directions(arm, link_rotations(arm, q)[..., 0])
    np.testing.assert_allclose(found, arm.bend_pairs(q), atol=1e-9)


def test_positions_that_are_no_pose_are_refused() -> None:
    """A wrong shape, another base, and links of another length."""
    arm = space_arm(3)
    points = joint_positions(arm, np.zeros(6))
    with pytest.raises(ProblemError, match="shape"):
        configuration_from_positions(arm, points[:-1])
    with pytest.raises(ProblemError, match="base"):
        configuration_from_positions(arm, points + 0.1)
    with pytest.raises(ProblemError, match="longer or shorter"):
        configuration_from_positions(arm, 1.1 * points)
