"""Arms of the random scenes in space: as long, as thick and as heavy whatever the number of their links."""

from dataclasses import replace

import numpy as np

from ccm_opt.jointed.link_bodies import cylinder_inertia
from ccm_opt.jointed.space_arm import SpaceArm

USUAL_LINKS = 24
"""Of the shipped problems."""
MASS = 0.5
"""Of a whole arm [kg]."""
JOINT_LIMIT = float(np.deg2rad(45.0))
"""Of each bend where there are as many links as usual, or more [rad]."""


def arm_of_links(links: int, length: float, radius: float) -> SpaceArm:
    """An arm at the origin along x, whose base turns any way."""
    masses = np.full(links, MASS / links)
    axial, transverse = cylinder_inertia(masses, radius, length / links)
    return SpaceArm(
        links=links,
        link_length=length / links,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        up=np.array([0.0, 0.0, 1.0]),
        joint_limit=joint_limit(links),
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
    )


def joint_limit(links: int) -> float:
    """Bound on a bend [rad]: few links have to bend more for the same curve, up to a right angle."""
    return min(max(JOINT_LIMIT, JOINT_LIMIT * USUAL_LINKS / links), 0.5 * np.pi)


def with_links(arm: SpaceArm, links: int) -> SpaceArm:
    """An arm as long, thick and heavy, of another number of links, whose drives are all alike."""
    masses = np.full(links, float(np.sum(arm.masses)) / links)
    axial, transverse = cylinder_inertia(masses, arm.radius, arm.length / links)
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=joint_limit(links),
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        rotor_inertia=float(np.mean(arm.rotor_inertia)),
        friction=float(np.mean(arm.friction)),
    )
