"""Arms of sections that bend evenly, for tests."""

import numpy as np

from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import RigidBody, Tool, ToolBody

CAMERA = Tool(
    bodies=(
        ToolBody(np.zeros(3), np.array([0.04, 0.0, 0.0]), 0.012),
        ToolBody(np.array([0.03, 0.01, 0.0]), np.array([0.03, 0.04, 0.01]), 0.006),
    ),
    mass=0.2,
    centre=np.array([0.03, 0.01, -0.02]),
    inertia=np.array([[3e-4, 1e-5, -2e-5], [1e-5, 2e-4, 3e-5], [-2e-5, 3e-5, 4e-4]]),
    tip=np.array([0.05, 0.02, 0.0]),
    direction=np.array([0.0, 0.6, 0.8]),
)
"""A camera that looks aside, on the last link of an arm."""


def lamp(link: int) -> RigidBody:
    """Return a lamp beside the end of a link."""
    bodies = (
        ToolBody(np.array([0.0, 0.02, 0.0]), np.array([0.02, 0.03, 0.0]), 0.005),
        ToolBody(np.array([0.0, 0.0, 0.03]), np.array([0.0, 0.0, 0.03]), 0.008),
    )
    return RigidBody(bodies, 0.1, np.array([0.01, 0.02, 0.01]), np.diag([2e-5, 3e-5, 4e-5]), link)


def arc_arm(
    counts: tuple[int, ...] = (6, 5, 8),
    lengths: tuple[float, ...] = (0.3, 0.25, 0.2),
    limit: float = 2.0,
    radius: float = 0.01,
    straight: tuple[int, ...] = (),
    *,
    plane: bool = False,
    **changes: object,
) -> Arm:
    """Return an arm at the origin, straight along x, whose sections each bend by up to a limit about either axis.

    Args:
        counts: number of arcs of each section.
        lengths: length of each section [m].
        limit: bound on each of the two bends of a section [rad].
        radius: radius of the body about the arcs [m].
        straight: indices of further joints that do not bend, at which bodies may sit.
        plane: whether it moves in the plane.
        **changes: further fields of the arm.
    """
    both = np.full((len(counts), 2), radius)
    bends = 1 if plane else 2
    parts = (np.array(counts), np.array(lengths), np.full(len(counts), limit))
    sections = ArcSections(*parts, both, (), straight, np.eye(bends))
    n = sections.links
    mean = float(np.mean(sections.link_lengths))
    radii = sections.link_radii
    limits = np.repeat(sections.joint_limits, bends)
    shares = Proportions(sections.link_lengths / mean, radii / np.max(radii), limits / np.max(limits))
    values: dict[str, object] = {
        "links": n,
        "link_length": mean,
        "radius": float(np.max(radii)),
        "base": np.zeros(bends + 1),
        "direction": np.eye(bends + 1)[0],
        "up": np.array([0.0, 0.0, 1.0]),
        "joint_limit": float(np.max(limits)),
        "base_limit": 3.0,
        "self_collision": True,
        "mount_length": radius,
        "masses": np.full(n, 0.1),
        "inertia_axial": np.full(n, 3e-5),
        "inertia_transverse": np.full(n, 4e-5),
        "proportions": shares,
        "sections": sections,
    }
    return Arm(**(values | changes))  # type: ignore[arg-type]
