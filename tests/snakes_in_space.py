"""Small arms and scenes in space for tests, and clearances of motions at dense samples."""

from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.grid_ways import GridDistances, TipGrid, WaysBetween
from ccm_opt.planning.space_task import SpaceTask, tip_box
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import BOX_FACES, box_corners
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup


def snake(
    links: int = 12, length: float = 1.0, radius: float = 0.015, feed: Feed | None = None, limit_deg: float = 45.0
) -> Arm:
    """Return an arm in space with its base at the origin, straight along x.

    Args:
        links: number of links.
        length: length of the arm [m].
        radius: radius of the arm [m].
        feed: feed axis, or None for a fixed base.
        limit_deg: joint limit [°].
    """
    masses = np.full(links, 0.05)
    inertia = np.full(links, 1e-5)
    return Arm(
        links=links,
        link_length=length / links,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        up=np.array([0.0, 0.0, 1.0]),
        joint_limit=np.deg2rad(limit_deg),
        base_limit=np.deg2rad(limit_deg if feed else 180.0),
        self_collision=True,
        mount_length=0.0 if feed else radius,
        masses=masses,
        inertia_axial=inertia,
        inertia_transverse=inertia,
        feed=feed,
    )


def balls(centres: FloatArray, radius: float) -> TriangleSoup:
    """Return balls with given centres, shape (n, 3) [m], and radius [m], as degenerate triangles with a rounding."""
    return TriangleSoup.joined(
        (f"ball {k + 1}", np.repeat(centre[None], 3, axis=0)[None], radius) for k, centre in enumerate(centres)
    )


def boxes(corners: list[tuple[list[float], list[float]]]) -> TriangleSoup:
    """Return the surfaces of boxes, each between two opposite corners [m]."""
    return TriangleSoup.joined(
        (f"box {k + 1}", box_corners(np.array(low), np.array(high))[BOX_FACES], 0.0)
        for k, (low, high) in enumerate(corners)
    )


def task_of(
    arm: Arm,
    triangle_soup: TriangleSoup,
    goal: GoalPose | None,
    *,
    goal_pose: FloatArray | None = None,
    via: tuple[FloatArray, ...] = (),
    start: FloatArray | None = None,
    seconds: float = 60.0,
) -> SpaceTask:
    """Return the task of the motion search in space, from a straight arm or another configuration to a goal."""
    width = len(arm.coordinates)
    slowness = np.append(np.ones(2 * arm.links), np.full(len(arm.base_axes), 10.0))
    return SpaceTask(
        arm=arm,
        tree=SurfaceTree.from_triangles(triangle_soup),
        start=np.zeros(width) if start is None else start,
        goal=goal or GoalPose(np.zeros(3)),
        goal_pose=goal_pose,
        via=via,
        via_reach=arm.link_length,
        clearance=0.0,
        wanted_gap=0.25 * arm.radius,
        box=tip_box(arm, None),
        scene=triangle_soup.triangles.reshape(-1, 3),
        names=triangle_soup.names,
        slowness=slowness,
        deadline=Deadline.after(seconds),
    )


def least_gaps(arm: Arm, triangle_soup: TriangleSoup, keyframes: FloatArray, samples: int = 40) -> tuple[float, float]:
    """Return the minimum clearances from obstacles and between links at samples of a piecewise-linear motion [m].

    Args:
        arm: the arm.
        triangle_soup: surfaces of the obstacles.
        keyframes: vertices of the motion, shape (K, c) [rad, m].
        samples: number of samples per piece.
    """
    share = np.linspace(0.0, 1.0, samples, endpoint=False)[:, None]
    q = np.concatenate([a + share * (b - a) for a, b in pairwise(keyframes)])
    q = np.concatenate((q, keyframes[-1:]))
    points = arm.joint_positions_at(q)
    # The mount may touch walls: the link that leaves it counts from there.
    hidden = np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)
    begins = points[:, :-1] + hidden[:, None] * (points[:, 1:] - points[:, :-1])
    segments = np.stack((begins, points[:, 1:]), axis=2)[:, hidden < 1.0].reshape(-1, 2, 3)
    walls = SurfaceTree.from_triangles(triangle_soup).distances(segments, 2.0 * arm.length)
    i, j = arm.self_pairs
    apart = segment_distances(
        points[:, i].reshape(-1, 3),
        points[:, i + 1].reshape(-1, 3),
        points[:, j].reshape(-1, 3),
        points[:, j + 1].reshape(-1, 3),
    )[2]
    return float(walls.min()) - arm.radius, float(apart.min(initial=np.inf)) - 2.0 * arm.radius


def tip_grid(
    tree: SurfaceTree,
    box: tuple[FloatArray, FloatArray],
    cells: int,
    kept: float,
    far: float,
    *,
    deadline: Deadline | None = None,
    ways: WaysBetween | None = None,
) -> TipGrid:
    """Return the grid of collision-free tip positions, as ``GridDistances.over`` and ``TipGrid.from_distances``."""
    distances = GridDistances.over(tree, box, cells, kept + far, deadline=deadline, ways=ways)
    return TipGrid.from_distances(distances, kept, far, deadline)
