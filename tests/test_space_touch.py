"""What is seen of a simulated arm in space: its least gaps, and where it first touches something."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.cli.compare.space_clutter import space_clutter
from ccm_opt.driver.closed_loop import seen as seen_of
from ccm_opt.problem.solution import JointTrajectory, SimulatedMotion
from ccm_opt.robot.frames import revolute_angles
from tests.snakes_in_space import least_gaps


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_least_gaps_and_the_first_contact_are_those_of_all_samples(seed: int) -> None:
    """Although few samples are looked at far away, none is nearer than what is told, to walls and to the arm itself."""
    problem = space_clutter(seed, 6, 10, "clutter")
    arm = problem.arm
    rng = np.random.default_rng(seed)
    start = problem.start.configuration(arm)
    steps = np.linspace(0.0, 1.0, 150)[:, None]
    q = start + steps * rng.normal(0.0, rng.uniform(0.0, 0.3), start.shape)
    still = np.zeros_like(q)
    trajectory = JointTrajectory(0.005 * np.arange(len(q)), q, still, still, arm.coordinates)
    angles = revolute_angles(arm, q)
    seen = seen_of(problem, trajectory, SimulatedMotion(angles, np.zeros_like(angles), 0.0, saturated=False))
    assert seen is not None
    at_each = [least_gaps(arm, problem.workspace.triangle_soup, pose[None].repeat(2, axis=0), 1) for pose in q]
    walls, itself = np.min(at_each, axis=0)
    touching = np.flatnonzero(np.min(at_each, axis=1) <= 0.0)
    assert (seen.touch is None) == (len(touching) == 0)
    if seen.touch is not None:
        assert seen.touch.time == trajectory.time[touching[0]]
    else:
        assert abs(min(seen.walls, arm.link_length) - min(walls, arm.link_length)) < 1e-9
        assert seen.itself is not None
        assert abs(min(seen.itself, arm.length) - min(itself, arm.length)) < 1e-9
