"""Arms and their limits from the validated tables of a problem file."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.arm_tables import ArmTable, TendonTable
from ccm_opt.io.option_tables import LimitsTable
from ccm_opt.io.schema import BaseAxisTable, SpaceArmTable
from ccm_opt.io.tool_tables import build_bodies, build_tool
from ccm_opt.problem import (
    Limits,
    PointLimit,
)
from ccm_opt.robot.arc_sections import ArcSections, Tendons
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis, Feed
from ccm_opt.robot.coordinates import DriveLimits
from ccm_opt.robot.couplings import CoupledJoints
from ccm_opt.robot.link_bodies import DEFAULT_LINK_MASS, SPACE_ROD_RADIUS, cylinder_inertia
from ccm_opt.robot.link_layout import Proportions


def _mount_length(table: ArmTable | SpaceArmTable, radius: float) -> float:
    """Return the length of the mount of an arm [m], by default the radius of the first link; 0 on moving axes."""
    if table.mount_length is not None:
        return table.mount_length
    # What carries the base moves with it, and is no reason to pass through an obstacle.
    return 0.0 if isinstance(table, SpaceArmTable) and table.base.axes else radius


def build_arm(table: ArmTable | SpaceArmTable) -> Arm:
    """Return the arm that the table ``[arm]`` describes; by default links have the inertia of solid cylinders."""
    in_space = isinstance(table, SpaceArmTable)
    driven = _arc_sections(table)
    lengths, radii, limits, proportions = _each_link(table, driven)
    masses = _masses(table, driven)
    if table.inertia is not None:
        axial, transverse = (_each(value, table.links) for value in (table.inertia.axial, table.inertia.transverse))
    else:
        thinnest = SPACE_ROD_RADIUS * lengths if in_space else 0.0
        axial, transverse = cylinder_inertia(masses, np.maximum(radii, thinnest), lengths)
    # By default the guide tube ends at the position of the base at full feed.
    feed = None
    if table.feed is not None:
        low, high = table.feed.range
        feed = Feed(low, high, high if table.feed.hole is None else table.feed.hole)
    same = ("links", "link_length", "joint_limit", "self_collision", "axes", "payload")
    parts: dict[str, Any] = {
        **{key: table.values[key] for key in same},
        "radius": float(np.max(radii)),
        "base_limit": float(np.max(table.base_limits)),
        "mount_length": _mount_length(table, float(radii[0])),
        "sections": driven,
        "coupled": _coupled_joints(table, lengths, limits),
        "proportions": proportions,
        "masses": masses,
        "inertia_axial": axial,
        "inertia_transverse": transverse,
        "feed": feed,
        "rotor_inertia": _of_drives(table.rotor_inertia, table.links, driven),
        "friction": _of_drives(table.friction, table.links, driven),
        "bodies": build_bodies(getattr(table, "bodies", ()), driven),
        "tool": None if (tool := getattr(table, "tool", None)) is None else build_tool(tool),
    }
    if isinstance(table, ArmTable):
        return Arm(base=np.array(table.base), base_heading=table.base_heading_deg, **parts)
    direction = np.array(table.base.direction)
    up = _across(np.array(table.base.up), direction)
    carrier = tuple(_base_axis(axis, table.base.position) for axis in table.base.axes or ())
    parts["feed"] = None if carrier else feed  # both are refused elsewhere
    return Arm(base=np.array(table.base.position), direction=direction, up=up, carrier=carrier, **parts)


def _masses(table: ArmTable | SpaceArmTable, driven: ArcSections | None) -> FloatArray:
    """Return the mass of each link, shape (links,) [kg]; a link at the end of an arc has half of that of both arcs."""
    rows = table.sections or ()
    alike = DEFAULT_LINK_MASS if table.link_mass is None else table.link_mass
    weighed = [each.mass for each in rows if each.mass is not None]
    if table.masses or not rows or len(weighed) not in {0, len(rows)}:  # some without are reported elsewhere
        return _each(table.masses or alike, table.links)
    if driven is None:
        return np.repeat(weighed, [each.links for each in rows]) if weighed else _each(alike, table.links)
    return driven.link_masses(np.array(weighed) if weighed else np.full(len(rows), DEFAULT_LINK_MASS))


def _of_drives(value: float | Sequence[float], links: int, driven: ArcSections | None) -> FloatArray:
    """Return inertia or friction of each revolute, of which bends of sections have that of all of their joints."""
    if driven is not None and np.size(value) != 3 * links:
        value = driven.at_joints(np.asarray(value) * driven.counts).tolist()
    return each_revolute(value, links)


def _base_axis(table: BaseAxisTable, base: list[float]) -> BaseAxis:
    """Return an axis that carries an arm, whose base is at a position where all axes are at zero [m]."""
    point = np.array(base if table.position is None else table.position)
    revolute = table.kind == "revolute"
    return BaseAxis(
        np.array(table.axis), *table.bounds, revolute=revolute, point=point if revolute else np.zeros(3),
        inertia=table.inertia,
    )  # fmt: skip


def with_axis_limits(limits: Limits, table: ArmTable | SpaceArmTable) -> Limits:
    """Return limits with those of the axes that carry an arm, from the arm's table."""
    axes = table.base.axes if isinstance(table, SpaceArmTable) else None
    if axes is None:
        return limits
    of_axes = DriveLimits(
        velocity=np.array([axis.velocity for axis in axes]),
        acceleration=np.array([axis.acceleration for axis in axes]),
        jerk=np.full(len(axes), np.inf),
        effort=np.array([axis.force or axis.torque or np.inf for axis in axes]),
    )
    return replace(limits, axes=of_axes)


def _each_link(
    table: ArmTable | SpaceArmTable, driven: ArcSections | None
) -> tuple[FloatArray, FloatArray, FloatArray, Proportions | None]:
    """Return length and radius of each link, (links,) [m], limits of bends, (links, 2) [rad], and the proportions.

    The proportions are None if all links are equal.
    """
    lengths, radii = np.full(table.links, table.link_length), np.full(table.links, table.radius)
    limits = np.full((table.links, 2), table.joint_limit_deg)
    if driven is not None:
        lengths, radii = driven.link_lengths, driven.link_radii
        limits = np.repeat(driven.joint_limits[:, None], 2, axis=1)
    elif table.sections is not None:
        lengths = np.concatenate([np.full(each.links, each.link_length) for each in table.sections])
        radii = np.concatenate([each.radii for each in table.sections])
        limits = np.concatenate([each.limits for each in table.sections])
    base = table.base_limits
    moved = table.moved if isinstance(table, SpaceArmTable) else None
    if moved is not None:  # what no drive moves is locked
        limits, base = limits * moved, base * moved[0]
    if table.links % 2 == 0 and not (np.ptp(lengths) or np.ptp(radii) or np.ptp(limits) or np.ptp(base)):
        return lengths, radii, np.vstack((base, limits[1:])), None
    widest = float(np.max(radii))
    shares = np.ones(table.links) if widest == 0.0 else radii / widest
    bends = np.minimum(limits / table.joint_limit_deg, 1.0)
    bends[0] = base / np.max(table.base_limits) if np.any(bends[0]) else 0.0
    of_bends = np.vstack((base * np.any(bends[0]), limits[1:]))
    bends = bends.ravel() if isinstance(table, SpaceArmTable) else bends[:, 0]
    counts = tuple(each.links for each in table.sections or ())
    return lengths, radii, of_bends, Proportions(lengths / table.link_length, shares, bends, counts)


def _coupled_joints(table: ArmTable | SpaceArmTable, lengths: FloatArray, limits: FloatArray) -> CoupledJoints | None:
    """Return the coupling of an arm's joints to drives, or None if each has its own.

    Args:
        table: the table of the arm.
        lengths: lengths of its links, shape (links,) [m].
        limits: limits of the bends of its joints, shape (links, 2) [rad].
    """
    if not isinstance(table, SpaceArmTable) or table.coupling is None:
        return None
    ratios = np.array(table.coupling)
    names = tuple(f"drive{k + 1}" for k in range(ratios.shape[1]))
    return CoupledJoints(ratios, names, limits.ravel(), lengths)


def _arc_sections(table: ArmTable | SpaceArmTable) -> ArcSections | None:
    """Return the division of an arm into sections that bend evenly, or None."""
    if not table.bends_evenly or table.sections is None:
        return None
    rows, plane = table.sections, isinstance(table, ArmTable)
    counts = np.array([each.links for each in rows])
    return ArcSections(
        counts,
        counts * np.array([each.link_length for each in rows]),
        counts * np.array([float(np.max(each.joint_limit_deg)) for each in rows]),
        np.array([(each.radius[0], each.radius[-1]) for each in rows]),
        tuple(None if each.tendons is None else _tendons(each.tendons, plane=plane) for each in rows),
        table.straight_joints,
        np.eye(1 if plane else 2),
    )


def _tendons(table: TendonTable, *, plane: bool) -> Tendons:
    """Return the tendons of a section from their table, two in the plane."""
    limits = (math.inf if limit is None else limit for limit in (table.travel, table.speed))
    return Tendons(table.radius, 2 if plane else table.number, table.angle_deg, *limits)


def _across(up: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the component of a vector perpendicular to a unit vector, normalised to unit length, shape (3,)."""
    rest = up - (up @ direction) * direction
    # A second projection removes what rounding left of the parallel component.
    rest = rest - (rest @ direction) * direction
    return np.asarray(rest / np.linalg.norm(rest))


def build_limits(table: LimitsTable, arm: Arm) -> Limits:
    """Return the limits that the table ``[limits]`` describes, joint limits expanded to one value per revolute joint.

    Args:
        table: the validated table.
        arm: the arm of n links; each ball joint consists of three revolutes, so that there are 3 n. For sections that
            bend evenly, values are of all sections or of each, whose joints share them; likewise of coupled drives.
    """
    limits = table.values
    points = [(None, limits.pop("tip_velocity"), limits.pop("tip_acceleration"))]
    points += [(point.at, point.velocity, point.acceleration) for point in limits.pop("points")]
    limits["points"] = tuple(PointLimit(at, v or np.inf, a or np.inf) for at, v, a in points if v or a)
    for key in ("velocity", "acceleration", "torque", "jerk"):
        value = limits[key]
        if value is not None and arm.sections is not None and np.size(value) != 3 * arm.links:
            # Joints have a share in the rates of their section, and bear all of its torque.
            share = 1.0 if key == "torque" else 1.0 / arm.sections.counts
            value = arm.sections.at_joints(np.asarray(value) * share).tolist()
        if value is not None and arm.coupled is not None and np.size(value) != 3 * arm.links:
            value = arm.coupled.at_joints(np.asarray(value), rates=key != "torque").tolist()
        limits[key] = None if value is None else each_revolute(value, arm.links)
    return Limits(**limits)


def _each(value: float | Sequence[float], links: int) -> FloatArray:
    """Return one value per link, shape (links,), from a single value for all links or a list of values."""
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (links,)).copy()


def each_revolute(value: float | Sequence[float], links: int) -> FloatArray:
    """Return one value per revolute joint, shape (3 n,), for an arm of n ball joints of three revolutes each.

    Args:
        value: one value for all, a list with one per ball joint, or a list with one per revolute.
        links: number n of links, each with a ball joint.
    """
    values = np.asarray(value, dtype=np.float64)
    if values.shape == (links,):
        return np.repeat(values, 3)
    return np.broadcast_to(values, (3 * links,)).copy()
