"""Checks of the arm of a problem file: sections, couplings, bodies, lists of limits, and poses."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ccm_opt.core.length_words import file_length, in_unit, message_unit
from ccm_opt.io.arm_tables import ArmTable, ChainTable, SectionTable, arc_ending_at
from ccm_opt.io.goal_tables import PoseTable, SpacePoseTable
from ccm_opt.io.issues import Issues, KeyPath
from ccm_opt.io.option_tables import LimitsTable, VerificationTable
from ccm_opt.io.schema import PlaneArmTable, SpaceArmTable
from ccm_opt.problem.options import MOST_CONTACT_SHARE_OF_LENGTH
from ccm_opt.problem.tool_rules import Key, tool_defects
from ccm_opt.robot.arc_sections import MOST_ARC_TURN
from ccm_opt.robot.arm import Arm

if TYPE_CHECKING:
    from ccm_opt.io.tool_tables import PlaneToolBodyTable, SpaceToolBodyTable

_LENGTH_TOLERANCE = 1e-6
"""Allowed relative difference between the total length of a pose's curve segments and the arm's length. Heuristic:
lengths are written with six digits or more."""
ANGLE_TOLERANCE = 1e-9
"""Amount by which joint angles may exceed their limit [rad]. Derived: converting degrees to radians rounds."""
LEAST_ACROSS = 1e-6
"""Minimum component of ``up`` perpendicular to the base direction; with less, the two count as parallel."""


def check_arm(arm: ArmTable | SpaceArmTable, issues: Issues) -> bool:
    """Report lists of the arm's table with a wrong number of entries, and an ``up`` parallel to the base direction.

    Returns:
        Whether the arm can be built from the table.
    """
    before = len(issues.found)
    _one_each(arm.masses, ("arm", "masses"), (arm.links,), "link", issues)
    counts, what = _drive_lists(arm) if arm.bends_evenly else ((arm.links, 3 * arm.links), "ball joint or revolute")
    for key in ("rotor_inertia", "friction"):
        _one_each(getattr(arm, key), ("arm", key), counts, what, issues)
    if arm.inertia is not None:
        _one_each(arm.inertia.axial, ("arm", "inertia", "axial"), (arm.links,), "link", issues)
        _one_each(arm.inertia.transverse, ("arm", "inertia", "transverse"), (arm.links,), "link", issues)
    if isinstance(arm, SpaceArmTable) and np.linalg.norm(np.cross(arm.base.up, arm.base.direction)) < LEAST_ACROSS:
        issues.add(
            ("arm", "base", "up"), "parallel to arm.base.direction; expected a vector with a component across it"
        )
    if isinstance(arm, ArmTable):
        pairs = [
            (("arm", "sections", k, "joint_limit_deg"), each.joint_limit_deg)
            for k, each in enumerate(arm.sections or ())
        ]
        for path, limit in [(("arm", "base_limit_deg"), arm.base_limit_deg), *pairs]:
            if isinstance(limit, list):
                issues.add(path, "expected one number in the plane, where a joint has one bend")
    if isinstance(arm, SpaceArmTable) and arm.coupling is not None:
        _check_coupling(arm, arm.coupling, issues)
    if arm.sections and not any(np.any(each.limits) for each in arm.sections):
        issues.add(("arm", "sections"), "all joints are locked; expected at least one that bends")
    return len(issues.found) == before


def _check_coupling(arm: SpaceArmTable, rows: Sequence[Sequence[float]], issues: Issues) -> None:
    """Report a coupling of drives that has another size than the arm, or more than one drive a bend or none to move."""
    path: KeyPath = ("arm", "coupling")
    if arm.bends_evenly:
        issues.add(path, 'not together with sections with drive = "section", which have drives of their own')
    if len(rows) != 2 * arm.links:
        issues.add(path, f"expected one row for each of the {2 * arm.links} bends of the joints; got {len(rows)}")
        return
    drives = len(rows[0])
    limits = np.array([arm.bend_limit(k // 2, k % 2)[1] for k in range(len(rows))])
    for k, row in enumerate(rows):
        moved = sum(value != 0.0 for value in row)
        if len(row) != drives:
            issues.add((*path, k), f"expected one number for each of the {drives} drives; got {len(row)}")
        elif moved > 1:
            issues.add((*path, k), f"{moved} drives move one bend; expected one at most")
        elif moved and limits[k] == 0.0:
            issues.add((*path, k), f"joint {k // 2 + 1} {'ab'[k % 2]} is locked; expected zeros")
    if any(len(row) != drives for row in rows):
        return
    for drive in np.flatnonzero(~np.any(np.array(rows), axis=0)):
        issues.add(path, f"drive {drive + 1} moves nothing, so that the matrix has no full rank; leave its column out")


def check_unequal_links(arm: Arm, sections: Sequence[SectionTable], issues: Issues) -> None:
    """Report links of even sections that turn too far, and tendons outside of the body.

    Args:
        arm: the arm.
        sections: its sections.
        issues: receives the defects.
    """
    where: KeyPath = ("arm", "sections")
    arcs = () if arm.sections is None else zip(arm.sections.limits, arm.sections.counts, strict=True)
    for k, (limit, count) in enumerate(arcs):
        turn = np.sqrt(arm.bends_a_joint) * limit / count
        if turn > MOST_ARC_TURN:
            least = int(np.ceil(turn * count / MOST_ARC_TURN))
            issues.add((*where, k, "links"), f"links turn by up to {np.rad2deg(turn):.3g}°; expected {least} or more")
    thinnest = math.inf
    for k, each in enumerate(sections):
        thinnest = min(thinnest, *each.radius)
        if each.tendons is not None and each.tendons.radius > thinnest:
            words = f"expected at most {file_length(thinnest, 6)}, the least radius of the body up to the section's end"
            issues.add((*where, k, "tendons", "radius"), words)


def check_contact(arm: ChainTable, table: VerificationTable, issues: Issues) -> None:
    """Report a contact tolerance so large that plans could pass through walls; it is meant for rounding errors only."""
    tolerance = table.contact_tolerance
    if tolerance is not None and tolerance > MOST_CONTACT_SHARE_OF_LENGTH * arm.links * arm.link_length > 0.0:
        given = f"{in_unit(tolerance, message_unit()):g}"
        path: KeyPath = ("verification", "contact_tolerance")
        issues.add(path, f"expected at most a thousandth of the arm's length; got {given}")


def _check_places(table: SpaceArmTable, issues: Issues) -> None:
    """Report bodies on links of sections that bend evenly, on sections of others, or at places where no arc ends."""
    rows = table.sections or ()
    for k, body in enumerate(table.bodies):
        where: KeyPath = ("arm", "bodies", k)
        if body.section is None:
            if table.bends_evenly:
                issues.add((*where, "link"), 'expected section and at for sections with drive = "section"')
        elif not table.bends_evenly:
            issues.add((*where, "section"), 'only for sections with drive = "section"; give the link')
        elif body.section > len(rows):
            issues.add((*where, "section"), f"expected a section from 1 to {len(rows)}, got {body.section}")
        elif arc_ending_at(body.at, arcs := rows[body.section - 1].links) is None:
            ends = [end for end in (math.floor(body.at * arcs), math.ceil(body.at * arcs)) if end]
            near = " or ".join(f"{end / arcs:.6g}" for end in ends)
            words = f"no arc of the section, of {arcs}, ends there; expected {near}, or another number of links"
            issues.add((*where, "at"), words)


def check_bodies(arm: Arm, table: PlaneArmTable | SpaceArmTable, tables: Mapping[str, Any], issues: Issues) -> None:
    """Report bodies that collide with their own arm at rest, and keys that are not allowed together with bodies.

    Args:
        arm: the arm.
        table: its table.
        tables: validated tables by name, None for each that has defects.
        issues: receives the defects.
    """
    keys: dict[Key, Any] = {("arm", "payload"): arm.payload}
    for name in ("limits", "planner", "tolerance"):
        values = (
            {} if tables[name] is None else {key: getattr(tables[name], key) for key in type(tables[name]).model_fields}
        )
        keys |= {(name, key): value for key, value in values.items()}
    before = len(issues.found)
    if isinstance(table, SpaceArmTable):
        _check_places(table, issues)
    if len(issues.found) > before:
        return
    for key, defect in tool_defects(arm, keys):
        last = key[-1]
        if key[-2:-1] != ("bodies",) or not isinstance(last, int) or len(key) == 3:
            issues.add(key, defect)
            continue
        # A body of the file is covered by one or more capsules.
        rigid = table.tool if key[1] == "tool" else table.bodies[int(key[2])]
        rows: Sequence[PlaneToolBodyTable | SpaceToolBodyTable] = rigid.bodies if rigid is not None else ()
        covers = [k for k, body in enumerate(rows) for _ in body.capsules()]
        issues.add((*key[:-1], covers[last]), defect)


def check_limit_lists(arm: ChainTable, limits: LimitsTable, issues: Issues) -> None:
    """Report lists of joint limits that have neither one value per ball joint nor one per revolute joint."""
    counts, what = _drive_lists(arm)
    for key in ("velocity", "acceleration", "jerk", "torque"):
        _one_each(getattr(limits, key), ("limits", key), counts, what, issues)


def _drive_lists(arm: ChainTable) -> tuple[tuple[int, int], str]:
    """Return the lengths that lists of values of drives may have, and what they have one value for, in words."""
    if arm.bends_evenly:
        return (len(arm.sections or ()), 3 * arm.links), "section or revolute"
    if isinstance(arm, SpaceArmTable) and arm.coupling is not None:
        return (len(arm.coupling[0]), 3 * arm.links), "drive or revolute"
    return (arm.links, 3 * arm.links), "ball joint or revolute"


def check_limited_points(arm: ChainTable, limits: LimitsTable, issues: Issues) -> None:
    """Report entries of ``limits.points`` that lie beyond the tip, give no limit, or repeat a point."""
    length = arm.links * arm.link_length
    for k, point in enumerate(limits.points):
        path: KeyPath = ("limits", "points", k)
        if point.at > length * (1.0 + _LENGTH_TOLERANCE):
            expected = f"at most the arm's length, links * link_length = {file_length(length, 6)}"
            issues.add((*path, "at"), f"{file_length(point.at, 6)} is beyond the tip; expected {expected}")
        if point.velocity is None and point.acceleration is None:
            issues.add(path, "limits nothing; expected velocity, acceleration or both")
        if point.at in [other.at for other in limits.points[:k]]:
            issues.add(
                (*path, "at"),
                f"the point at {file_length(point.at, 6)} is limited already; expected one entry per point",
            )


def check_pose(
    arm: ArmTable | SpaceArmTable,
    pose: PoseTable | SpacePoseTable,
    path: KeyPath,
    issues: Issues,
) -> None:
    """Report a pose whose joint angles have a wrong number or exceed their limits, or whose curve has a wrong length.

    The lengths of a curve's segments must add up to the arm's length.

    Args:
        arm: the table ``[arm]``.
        pose: the table ``[start]`` or ``[goal]``.
        path: key path of that table.
        issues: receives the defects.
    """
    bends: Sequence[Any] = pose.joints_deg or []
    if arm.bends_evenly and len(bends) == len(arm.sections or ()):
        _check_section_bends(arm.sections or (), bends, path, issues)
        return
    if bends and len(bends) != arm.links:
        each = "[a, b] per joint" if isinstance(bends[0], list) else "value per joint"
        issues.add((*path, "joints_deg"), f"expected one {each}, {arm.links} in all; got {len(bends)}")
    for k, bend in enumerate(bends):
        if k >= arm.links:
            break
        for *which, value in [(*pair,) for pair in enumerate(bend)] if isinstance(bend, list) else [(bend,)]:
            key, limit = arm.bend_limit(k, *which)
            if abs(value) > limit + ANGLE_TOLERANCE:
                passed = f"{math.degrees(value):g}° exceeds {key} = {math.degrees(limit):g}"
                issues.add((*path, "joints_deg", k, *which), passed)
    if pose.segments is not None and not arm.bends_evenly:
        total = sum(segment.length for segment in pose.segments)
        length = arm.links * arm.link_length
        if abs(total - length) > _LENGTH_TOLERANCE * length:
            issues.add(
                (*path, "segments"),
                f"the lengths of the segments add up to {file_length(total, 9)}; expected the arm's length, "
                f"links * link_length = {file_length(length, 9)}",
            )


def _check_section_bends(sections: Sequence[SectionTable], bends: Sequence[Any], path: KeyPath, issues: Issues) -> None:
    """Report bends of sections that bend evenly which exceed their limits, in space a pair a section."""
    for k, (pair, section) in enumerate(zip(bends, sections, strict=True)):
        limit = section.links * float(np.max(section.joint_limit_deg))
        most = float(np.max(np.abs(pair)))
        if most > limit + ANGLE_TOLERANCE:
            passed = f"{math.degrees(most):g}° exceeds {math.degrees(limit):g}°, the limit of the section's bends"
            issues.add((*path, "joints_deg", k), passed)


def _one_each(
    value: float | Sequence[float] | None, path: KeyPath, counts: tuple[int, ...], what: str, issues: Issues
) -> None:
    if isinstance(value, Sequence) and len(value) not in counts:
        wanted = " or ".join(map(str, counts))
        issues.add(path, f"expected one value per {what}, {wanted} in all; got {len(value)}")
