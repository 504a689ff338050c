"""Arms in space whose base stands flush on a floor, a wall or a ceiling: they bend beyond it, and touch no deeper."""

from dataclasses import replace

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.clamped_base import clamped_joints, with_clamped_base
from ccm_opt.problem import Problem
from ccm_opt.scene.bodies import RigidPlacement
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def standing(
    links: int, radius: float = 0.02, above: float = 0.0, turned: tuple[float, float, float] = (0, 0, 0), **arm: object
) -> Problem:
    """An arm on a slab with a box beside it, all of it turned about the fixed axes [deg]."""
    place = RigidPlacement.turned(np.zeros(3), np.radians(turned))
    axes = place.rotation
    pose = {"position": (0.0, 0.0, 0.0), "rotation_deg": turned}
    return ccm_opt.make_problem(
        "standing",
        arm={
            "links": links,
            "link_length": 1.0 / links,
            "radius": radius,
            "base": {"position": above * axes[:, 2], "direction": axes[:, 2], "up": -axes[:, 0]},
            "joint_limit_deg": min(100.0, 900.0 / links + 10.0),
            **arm,
        },
        obstacles={
            "slab": {"box": [[-0.7, -0.7, -0.1], [0.7, 0.7, 0.0]], "pose": pose},
            "box": {"box": [[0.3, -0.2, 0.0], [0.4, 0.2, 0.6]], "pose": pose},
        },
        limits={"velocity": 1.0, "acceleration": 5.0},
        goal={"position": axes @ np.array([0.5, 0.1, 0.5])},
        simulation={"step": 0.005},
    )


@pytest.mark.drawn(1)
@pytest.mark.parametrize(
    ("links", "radius", "turned"), [(8, 0.02, (0, 0, 0)), (14, 0.03, (180, 0, 30)), (60, 0.02, (40, 65, 10))]
)
def test_an_arm_on_a_wall_bends_beyond_its_mount(links: int, radius: float, turned: tuple[float, float, float]) -> None:
    """Its first joints, any turn of which would press the mount into the wall, stay as they are."""
    problem = standing(links, radius, turned=turned)
    solution = ccm_opt.solve(problem)
    count = clamped_joints(problem, SurfaceTree.from_triangles(problem.workspace.triangle_soup))
    assert count >= 1
    assert np.abs(solution.trajectory.positions[:, : 2 * count]).max() < 1e-9


def test_only_what_stands_flush_is_clamped() -> None:
    """A base that is farther from the slab, has a longer mount or looks aside turns as it may."""
    for problem in (standing(8, above=0.002), standing(8, mount_length=0.06)):
        assert clamped_joints(problem, SurfaceTree.from_triangles(problem.workspace.triangle_soup)) == 0
    aside = standing(8, base={"position": (0.0, 0.0, 0.02), "direction": (0, 1, 0)})
    assert clamped_joints(aside, SurfaceTree.from_triangles(aside.workspace.triangle_soup)) == 0


@pytest.mark.drawn(20, of="dear tests")
def test_the_least_mount_that_frees_the_base_is_told() -> None:
    """An arm of two links cannot go round the box with its first one still; the advice says why that stands still."""
    problem = standing(2)
    problem = replace(problem, planner=replace(problem.planner, time_limit=3.0))
    with pytest.raises(NoPlanFound) as caught:
        ccm_opt.solve(problem, explain=False)
    assert any("raise arm.mount_length" in advice for advice in caught.value.diagnosis.advice)


def test_the_clamped_arm_is_the_same_elsewhere() -> None:
    """What belongs to the mount, and bends no more, is all that is changed."""
    problem = standing(8)
    arm = with_clamped_base(problem, SurfaceTree.from_triangles(problem.workspace.triangle_soup)).arm
    assert arm.mount_length == pytest.approx(problem.arm.link_length)
    assert arm.bend_limits[:2] == pytest.approx(0.0)
    assert arm.bend_limits[2:] == pytest.approx(problem.arm.bend_limits[2:])
