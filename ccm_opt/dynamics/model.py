"""The bodies of the arm as the dynamics see them: one link a ball, the two frames between massless (section 5.4)."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm, Axes
from ccm_opt.jointed.frames import base_rotation

UNROLLED_DOF = 72  # up to here one straight-line expression; above it one function a link, folded


@dataclass(frozen=True)
class Structure:
    """What decides the generated code; masses, inertias, lengths and gravity are its run-time inputs.

    Attributes:
        links: number of links.
        axes: order of the three revolutes of a ball joint.
        folded: whether the recursions loop over one compiled link instead of being written out.
    """

    links: int
    axes: Axes
    folded: bool

    @property
    def joints(self) -> int:
        """Number of revolutes, 3 * links."""
        return 3 * self.links


@dataclass(frozen=True)
class ArmModel:
    """Structure and numbers of an arm's dynamics.

    Attributes:
        structure: what decides the generated code.
        bodies: mass [kg], axial inertia [kg m²], transverse inertia about the centre [kg m²] and length [m] of every
            link, shape (links, 4).
        gravity: in the base frame, shape (3,) [m/s²].
    """

    structure: Structure
    bodies: FloatArray
    gravity: FloatArray


def arm_structure(arm: Arm) -> Structure:
    """Structure of an arm, unrolled up to 72 revolutes and folded above."""
    return Structure(arm.links, arm.axes, folded=3 * arm.links > UNROLLED_DOF)


def arm_model(arm: Arm, gravity: FloatArray) -> ArmModel:
    """Dynamic model of an arm: solid links with the arm's masses and inertias.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """
    lengths = np.full(arm.links, arm.link_length)
    bodies = np.column_stack((arm.masses, arm.inertia_axial, arm.inertia_transverse, lengths))
    local = base_rotation(arm).T @ np.asarray(gravity, dtype=np.float64)
    return ArmModel(arm_structure(arm), bodies, local)
