"""The files ``trajectory.csv``, for spreadsheets, and ``trajectory.yaml``, in the shape of a ROS message."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.arm_description import FEED
from ccm_opt.io.controller_points import ControllerPoints
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.solution import JointStates, JointTrajectory

QUANTITIES = ("angle", "velocity", "acceleration", "torque")
_FEED_QUANTITIES = ("position", "velocity", "acceleration", "force")
ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")
_WHOLE = re.compile(r" (-?\d+)(?![\d.])")
"""A number without a point, or the digits in front of its exponent, behind a space."""


def trajectory_texts(points: ControllerPoints, *, bends_only: bool = False, effort: bool = False) -> tuple[str, str]:
    """Write the points for a controller as CSV and as YAML; SI units, radians.

    Both have the same numbers, of twelve digits. Every number has a point, whole ones too: the fields of ROS messages
    take floats alone, and YAML takes ``1e-05`` for a text.

    Args:
        points: of the plan.
        bends_only: whether the revolutes that turn out of the plane, or about the link, are left out.
        effort: whether the message has efforts, which controllers from ROS 2 Humble on refuse.

    Returns:
        The text of ``trajectory.csv``: ``time`` and a column ``<joint>_<quantity>`` for every joint and quantity; and
        of ``trajectory.yaml``: ``joint_names`` and ``points`` as in ROS 2 ``trajectory_msgs/JointTrajectory``, with
        accelerations where jerk is limited. A feed axis is the first joint, ``feed``, with the columns
        ``feed_position``, …, ``feed_force`` [m, N].
    """
    motion = points.trajectory
    joints = bending_joints(points.joints, motion.coordinates) if bends_only else points.joints
    names, tables = trajectory_tables(motion, joints)
    rows = [number_rows(table) for table in tables]
    written = {"positions", "velocities", *(["accelerations"] * points.smooth), *(["effort"] * effort)}
    return "\n".join(_csv(motion.time, names, rows)), "\n".join(_yaml(motion.time, names, rows, written))


def number_rows(table: FloatArray) -> list[str]:
    """Write every row of a table, its numbers of twelve digits as ``%.12g`` has them, joined by commas, with a point.

    Whole numbers have a point too. Of columns of zeros alone no sign is written.

    Args:
        table: shape (rows, n).
    """
    # Revolutes that a plane motion leaves alone are most of the table, and need no formatting.
    moving = np.any(table != 0.0, axis=0)
    row = ",".join(" %.12g " if moves else "0.0" for moves in moving)
    whole = "\n".join([row % tuple(values) for values in table[:, moving].tolist()])
    # Most numbers without a point are zeros, of links that lie still, and a search for a text takes next to nothing.
    whole = whole.replace(" 0 ", "0.0").replace(" -0 ", "-0.0")
    return _WHOLE.sub(r"\1.0", whole).replace(" ", "").split("\n")


def trajectory_tables(trajectory: JointTrajectory, joints: JointStates) -> tuple[tuple[str, ...], list[FloatArray]]:
    """Names of the joints, and their positions, velocities, accelerations and efforts; the feed axis is the first."""
    tables = [joints.angles, joints.velocities, joints.accelerations, joints.torques]
    base = [
        trajectory.base_positions,
        trajectory.base_velocities,
        trajectory.base_accelerations,
        joints.base_forces,
    ]
    names = (*trajectory.coordinates.base_names, *joints.names)
    return names, [np.column_stack(pair) for pair in zip(base, tables, strict=True)]


def bending_joints(joints: JointStates, coordinates: Coordinates) -> JointStates:
    """The revolutes that bend the arm alone: the second of every ball in the plane, the first and second in space."""
    bending = coordinates.drive_numbers[coordinates.bends]
    return replace(
        joints,
        names=tuple(joints.names[drive] for drive in bending),
        angles=joints.angles[:, bending],
        velocities=joints.velocities[:, bending],
        accelerations=joints.accelerations[:, bending],
        torques=joints.torques[:, bending],
    )


def table_headings(names: tuple[str, ...]) -> list[str]:
    """The columns of the table for joints of these names."""
    quantities = zip(QUANTITIES, _FEED_QUANTITIES, strict=True)
    return ["time", *(f"{name}_{feed if name == FEED else joint}" for joint, feed in quantities for name in names)]


def _csv(time: FloatArray, names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    yield ",".join(table_headings(names))
    for now, *rows in zip(time.tolist(), *columns, strict=True):
        yield ",".join([f"{now:.12g}", *rows])
    yield ""


def _yaml(time: FloatArray, names: tuple[str, ...], columns: list[list[str]], written: set[str]) -> Iterator[str]:
    yield f"joint_names: {json.dumps(list(names))}"
    yield "points:"
    for now, *rows in zip(time.tolist(), *columns, strict=True):
        seconds, nanoseconds = divmod(round(now * 1e9), 1_000_000_000)
        yield f"- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}"
        fields = zip(ROS_FIELDS, rows, strict=True)
        yield from (f"  {field}: [{row}]" for field, row in fields if field in written)
    yield ""
