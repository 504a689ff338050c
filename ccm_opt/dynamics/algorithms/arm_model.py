"""Rigid-body model of an arm: one link per ball joint, massless frames between revolutes (paper, section 5.4)."""

from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.frames import coupling_of_revolutes
from ccm_opt.robot.tool import attached_inertia

LOPSIDED = [2, 5, 8]
"""Numbers of ``attached_inertia``, by index, that are zero for bodies that are alike on both sides of the plane."""


@dataclass(frozen=True)
class Structure:
    """Properties of an arm that determine generated code; masses, lengths, drives and gravity are run-time inputs.

    Attributes:
        links: number of links.
        axes: order of the three revolutes of a ball joint.
        planar: whether the arm never leaves its plane, where only the second revolutes move and most terms are zero.
        arcs: whether joints are those of sections that bend evenly.
    """

    links: int
    axes: Axes
    planar: bool = False
    arcs: bool = False

    @property
    def variant(self) -> str:
        """Name of the variant of the generated code for the structure, such as "zyx_planar"."""
        return "arcs" if self.arcs else f"{self.axes}{'_planar' if self.planar else ''}"

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
            link, shape (links, 4). Where joints are those of arcs, the rigid body of a link is fixed to the end of the
            arc about its joint: in the place of the length, the arc's, and then the place of the body's centre along
            the link from there [m], shape (links, 5).
        drives: rotor inertia [kg m²] of the three revolutes of a ball joint, then their friction [N m s/rad], shape
            (links, 6).
        attached: mass, first and second moments of what is fixed to each link, shape (links, 10), as
            ``attached_inertia`` gives them; None if nothing is.
        world: gravity in the base frame [m/s²], mass of the payload [kg], and 1 if the base slides, else 0, shape (5,).
        coupling: derivatives of the revolutes' angles by the values of m drives that move them together, shape
            (3 * links, m); None if every revolute has its own drive.
        armature: inertia of these drives beyond that of the revolutes, shape (m,) [kg m²]; None for none.
        axes: the k axes that carry the base, as ``axis_rows`` gives them, shape (k, 7); none for a feed axis.
        axis_inertia: inertia of the drives of these axes, shape (k,) [kg, kg m²].
        ground: gravity in the world [m/s²], and place [m] and rotation of the base where all axes are at zero, shape
            (15,).
    """

    structure: Structure
    bodies: FloatArray
    drives: FloatArray
    world: FloatArray
    coupling: FloatArray | None = None
    armature: FloatArray | None = None
    attached: FloatArray | None = None
    axes: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))
    axis_inertia: FloatArray = field(default_factory=lambda: np.zeros(0))
    ground: FloatArray = field(default_factory=lambda: np.zeros(15))

    @property
    def coordinates(self) -> int:
        """Number of drives that bend the arm: of the revolutes, or of those that move them together."""
        return self.structure.joints if self.coupling is None else self.coupling.shape[1]

    @property
    def of_base(self) -> int:
        """Number of coordinates of the base: of its axes, or one of a feed axis, at rest where there is none."""
        return max(len(self.axes), 1)


def arm_model(arm: Arm, gravity: FloatArray) -> ArmModel:
    """Return the dynamic model of an arm: solid links, what is fixed to them, and a point mass at the tip.

    Args:
        arm: the arm.
        gravity: gravitational acceleration in the world frame, shape (3,) [m/s²].
    """
    sections = arm.sections
    lengths = arm.lengths if sections is None else 2.0 * sections.arcs[:-1]
    bodies = np.column_stack((arm.masses, arm.inertia_axial, arm.inertia_transverse, lengths))
    if sections is not None:
        bodies = np.column_stack((bodies, 0.5 * (sections.arcs[1:] - sections.arcs[:-1])))
    drives = np.hstack((_per_ball(arm, arm.rotor_inertia), _per_ball(arm, arm.friction)))

    # The recursions start in the base frame, so gravity is expressed in it once.
    local_gravity = arm.base_rotation.T @ np.asarray(gravity, dtype=np.float64)
    world = np.array([*local_gravity, arm.payload, float(len(arm.base_axes))])
    structure = Structure(arm.links, arm.axes, arcs=sections is not None)
    attached = attached_inertia(arm.rigid_bodies, arm.links)
    model = ArmModel(structure, bodies, drives, world, coupling_of_revolutes(arm), attached=attached)
    if not arm.carrier:
        return model
    return replace(
        model,
        axes=arm.axis_rows,
        axis_inertia=np.array([axis.inertia for axis in arm.base_axes]),
        ground=np.concatenate((gravity, arm.base_position, arm.base_rotation.ravel())),
    )


def in_plane_alone(model: ArmModel) -> ArmModel:
    """Return a model whose generated code handles planar motions only.

    The model is returned unchanged if gravity, the order of axes, axes of the base or a body may lead out of the plane.
    """
    lopsided = model.attached is not None and np.any(model.attached[:, LOPSIDED])
    if model.world[1] != 0.0 or model.structure.axes != "zyx" or lopsided or len(model.axes):
        return model
    return replace(model, structure=replace(model.structure, planar=True))


def _per_ball(arm: Arm, value: FloatArray | float) -> FloatArray:
    """Return a drive parameter as one row per ball joint, shape (links, 3).

    It is given as one number for all drives, or as one number per revolute.
    """
    return np.broadcast_to(value, (3 * arm.links,)).reshape(arm.links, 3)
