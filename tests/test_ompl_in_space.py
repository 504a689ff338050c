"""OMPL's planner in space: what it draws stands for configurations that keep the guide tube, and it plans."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.cli.compare.ompl_peer import SampledJoints
from ccm_opt.cli.compare.space_clutter import space_clutter
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from tests.arms import held_bends
from tests.snakes_in_space import snake


@given(seed=st.integers(0, 2**32), fed=st.booleans())
def test_draws_stand_for_what_the_tube_allows(seed: int, fed: bool) -> None:
    """Along a line between draws held joints are straight from keyframe to keyframe, and no joint turns far."""
    arm = snake(links=6, feed=Feed(0.0, 0.5, 0.5) if fed else None)
    joints = SampledJoints(arm, arm.lower_limits, arm.upper_limits, 0.2)
    rng = np.random.default_rng(seed)
    before, after = rng.uniform(joints.low, joints.high, (2, len(joints.low)))
    keyframes = joints.keyframes(before, after)
    assert np.allclose(keyframes[0], joints.configuration(before))
    assert np.allclose(keyframes[-1], joints.configuration(after))
    assert np.all(keyframes >= arm.lower_limits - 1e-12)
    assert np.all(keyframes <= arm.upper_limits + 1e-12)
    for share in (0.0, 0.3, 0.9):
        between = (1.0 - share) * keyframes[:-1] + share * keyframes[1:]
        held = held_bends(arm, arm.coordinates.advance(between) + 1e-7)
        assert np.all(np.abs(between[:, :12][held]) < 1e-9)
    drawn = joints.sample(keyframes[0])
    assert drawn is not None
    assert np.allclose(joints.configuration(drawn), keyframes[0])


def test_ompl_plans_in_space() -> None:
    """In open clutter OMPL finds a motion from the start to the goal that our certificate proves."""
    pytest.importorskip("ompl.geometric")
    from ccm_opt.cli.compare.ompl_peer import OmplPlanner

    problem = space_clutter(0, 5, 12, "clutter")
    path = OmplPlanner().plan(problem)
    assert np.allclose(path.keyframes[0], problem.start.configuration(problem.arm))
    certificate = SpaceCertificate(problem.arm, SurfaceTree.from_triangles(problem.workspace.triangle_soup))
    assert len(certificate.failures(np.asarray(path.spline(np.linspace(0.0, 1.0, 2000))))) == 0
