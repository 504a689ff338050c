"""Rigid-body model of an arm: one link per ball joint, massless frames between revolutes (paper, section 5.4)."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Axes


@dataclass(frozen=True)
class Structure:
    """Properties of an arm that determine generated code; masses, lengths, drives and gravity are run-time inputs.

    Attributes:
        links: number of links.
        axes: order of the three revolutes of a ball joint.
        planar: whether the arm never leaves its plane, where only the second revolutes move and most terms are zero.
    """

    links: int
    axes: Axes
    planar: bool = False

    @property
    def variant(self) -> str:
        """Name of the variant of the generated code for the structure, such as "zyx_planar"."""
        return f"{self.axes}{'_planar' if self.planar else ''}"

    @property
    def joints(self) -> int:
        """Number of revolute joints, 3 * links."""
        return 3 * self.links


@dataclass(frozen=True)
class ArmModel:
    """Structure and parameters of an arm's dynamics.

    Attributes:
        structure: properties that determine generated code.
        bodies: mass [kg], axial inertia [kg m²], transverse inertia about the centre [kg m²] and length [m] of every
            link, shape (links, 4).
        drives: rotor inertia [kg m²] of the three revolutes of a ball joint, then their friction [N m s/rad], shape
            (links, 6).
        world: gravity in the base frame [m/s²], mass of the payload [kg], and 1 if the base slides, else 0, shape (5,).
    """

    structure: Structure
    bodies: FloatArray
    drives: FloatArray
    world: FloatArray


def arm_model(arm: Arm, gravity: FloatArray) -> ArmModel:
    """Return the dynamic model of an arm: solid links with the arm's masses and inertias, a point mass at the tip.

    Args:
        arm: the arm.
        gravity: gravitational acceleration in the world frame, shape (3,) [m/s²].
    """
    bodies = np.column_stack((arm.masses, arm.inertia_axial, arm.inertia_transverse, arm.lengths))
    drives = np.hstack((_per_ball(arm, arm.rotor_inertia), _per_ball(arm, arm.friction)))

    # The recursions start in the base frame, so gravity is expressed in it once.
    local_gravity = arm.base_rotation.T @ np.asarray(gravity, dtype=np.float64)
    slides = float(len(arm.base_axes))
    world = np.array([*local_gravity, arm.payload, slides])
    return ArmModel(Structure(arm.links, arm.axes), bodies, drives, world)


def in_plane_alone(model: ArmModel) -> ArmModel:
    """Return a model whose generated code handles planar motions only.

    The model is returned unchanged if gravity or the order of axes leads out of the plane.
    """
    if model.world[1] != 0.0 or model.structure.axes != "zyx":
        return model
    return replace(model, structure=replace(model.structure, planar=True))


def _per_ball(arm: Arm, value: FloatArray | float) -> FloatArray:
    """Return a drive parameter as one row per ball joint, shape (links, 3).

    It is given as one number for all drives, or as one number per revolute.
    """
    return np.broadcast_to(value, (3 * arm.links,)).reshape(arm.links, 3)
