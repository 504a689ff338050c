"""Plans of arms whose sections bend evenly, swept as true arcs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import ccm_opt
from ccm_opt.cli.compare.space_clutter import RADIUS
from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.section_map import SectionMap
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.coordinates import PointLimit
from tests.oracles.true_arcs import centre_lines, distances, least_own_distance, section_bends
from tests.section_scenes import section_arm, section_clutter

STEP = 0.004
"""Greatest distance of points along the swept arms [m]."""


def swept(problem: Problem, positions: FloatArray) -> tuple[float, float]:
    """Least gaps of the body of true arcs to obstacles and room and to itself, over configurations (T, c) [m]."""
    sections = problem.arm.sections
    assert sections is not None
    between = 0.5 * (positions[1:] + positions[:-1])
    joints = np.vstack((positions, between))[:, : 2 * problem.arm.links].reshape(-1, problem.arm.links, 2)
    bends = section_bends(sections.counts.tolist(), joints)
    points, at = centre_lines(problem.arm.base, problem.arm.base_rotation, sections.lengths, bends, STEP)
    gaps = [float(np.min(distances(obstacle.body, points))) for obstacle in problem.workspace.obstacles]
    assert problem.workspace.bounds is not None
    low, high = problem.workspace.bounds
    gaps.append(float(np.min(np.minimum(points - low, high - points))))
    apart = np.pi * RADIUS + 3.0 * problem.arm.link_length
    return min(gaps) - RADIUS, least_own_distance(points[::4, ::3], at[::3], apart) - 2.0 * RADIUS


@pytest.mark.drawn(1)
@pytest.mark.parametrize(("sections", "seed"), [(3, 1), (4, 2), (6, 3)])
def test_body_of_true_arcs_touches_nothing(sections: int, seed: int) -> None:
    """A plan among 40 bodies keeps the true arcs clear of them, and their tip ends at the goal."""
    problem = section_clutter(seed, 40, sections)
    solution = ccm_opt.solve(problem, explain=False)
    positions = solution.trajectory.positions
    walls, own = swept(problem, positions)
    assert min(walls, own) > 0.0
    assert problem.arm.sections is not None
    last = section_bends(problem.arm.sections.counts.tolist(), positions[-1:].reshape(1, -1, 2))
    tip = centre_lines(problem.arm.base, problem.arm.base_rotation, problem.arm.sections.lengths, last, STEP)[0][0, -1]
    np.testing.assert_allclose(tip, problem.goal.tip(problem.arm), atol=1e-6)
    assert problem.arm.sections.misfit(positions) < 1e-9


def test_map_reproduces_every_configuration_of_the_sections() -> None:
    """Unknowns of a configuration give it back, and random ones respect the limits."""
    arm = section_arm(3)
    assert arm.sections is not None
    rng = np.random.default_rng(0)
    space, v = SectionMap.of_drives(arm, arm.sections, arm.sections.coupling @ rng.normal(size=6))
    np.testing.assert_allclose(space.fitted(space.configuration(v)), v, atol=1e-12)
    assert np.all(np.abs(space.configurations(space.drawn(rng, 50))) <= arm.bend_limits + 1e-12)


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("limits of points", {"points": (PointLimit(None, 1.0),)}),
    ],
)
def test_what_sections_do_not_support_is_refused(words: str, changes: dict[str, Any]) -> None:
    """A limit that needs points of single links is refused by name."""
    problem = section_clutter(0, 3, 3)
    with pytest.raises(ccm_opt.ProblemError, match=words):
        replace(problem, limits=replace(problem.limits, **changes))


def test_pose_that_sections_cannot_take_is_refused() -> None:
    """The message gives the size of the misfit in degrees."""
    problem = section_clutter(0, 3, 3)
    bends = problem.start.bends.copy()
    bends[3, 0] += np.deg2rad(2.0)
    with pytest.raises(ccm_opt.ProblemError, match=r"start.bends differ by up to 1\.\d+° from"):
        replace(problem, start=JointPose(bends))
