"""Arms in space for tests, with equal links, of which any parameter can be changed."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.configuration import Configuration, SpaceConfiguration
from ccm_opt.robot.rigid_motions import turn_towards

FEED_OF_TESTS = Feed(0.0, 0.5, 0.5)
"""Feed axis with a travel of 0.5 m and a guide tube that ends at its end."""


def space_arm(links: int = 6, link_length: float = 0.1, radius: float = 0.02, **changes: object) -> Arm:
    """Return an arm at the origin, straight along x, with z upwards and without mount.

    Each link has a mass of 0.1 kg, and bend angles are limited to 0.8 rad.

    Args:
        links: number of links.
        link_length: length of a link [m].
        radius: radius of the arm [m].
        **changes: further fields of the arm.
    """
    values: dict[str, object] = {
        "links": links,
        "link_length": link_length,
        "radius": radius,
        "base": np.zeros(3),
        "direction": np.array([1.0, 0.0, 0.0]),
        "up": np.array([0.0, 0.0, 1.0]),
        "joint_limit": 0.8,
        "base_limit": 3.0,
        "self_collision": True,
        "mount_length": 0.0,
        "masses": np.full(links, 0.1),
        "inertia_axial": np.full(links, 3e-5),
        "inertia_transverse": np.full(links, 4e-5),
    }
    return Arm(**(values | changes))  # type: ignore[arg-type]


def planar_twin(arm: Arm) -> Arm:
    """Return the planar arm with equal links in the plane of an arm's direction (x) and left (y), at the origin."""
    return Arm(
        links=arm.links,
        link_length=arm.link_length,
        radius=arm.radius,
        base=np.zeros(2),
        base_heading=0.0,
        joint_limit=arm.joint_limit,
        base_limit=arm.base_limit,
        self_collision=arm.self_collision,
        mount_length=arm.mount_length,
        masses=arm.masses,
        inertia_axial=arm.inertia_axial,
        inertia_transverse=arm.inertia_transverse,
        feed=arm.feed,
    )


def random_rotation(random: np.random.Generator) -> FloatArray:
    """Return a uniformly distributed random rotation, shape (3, 3)."""
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.array([1.0, 1.0, np.sign(np.linalg.det(q))]))


def turned_arm(random: np.random.Generator, links: int = 6, **changes: object) -> Arm:
    """Return an arm with random position and orientation of its base."""
    rotation = random_rotation(random)
    base = random.normal(0.0, 0.5, 3)
    return space_arm(links, base=base, direction=rotation[:, 0], up=rotation[:, 2], **changes)


def laid_into_space(curve: Configuration, base: FloatArray, rotation: FloatArray) -> SpaceConfiguration:
    """Return a planar curve as a curve in space.

    Args:
        curve: the planar curve.
        base: position of the base, shape (3,) [m].
        rotation: rotation whose first two columns are the axes x and y of the plane, shape (3, 3).
    """
    heading = curve.base_heading
    segments = curve.segments
    return SpaceConfiguration.chain(
        base,
        rotation @ turn_towards(np.array([1.0, 0.0]), heading),
        [segment.length for segment in segments],
        [np.column_stack((segment.curvature, np.zeros(5))) for segment in segments],
        [segment.knots for segment in segments],
    )
