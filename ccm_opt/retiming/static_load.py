"""Why a path cannot be timed, in the user's terms."""

import numpy as np

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits
from ccm_opt.retiming.path_rows import PathRows

_AXIS = ("first (yaw)", "second (bend)", "third")


def revolute_name(number: int) -> str:
    """Ball and axis of a revolute in words, the ball counted from 1."""
    return f"joint {number // 3 + 1}, {_AXIS[number % 3]} axis"


def drive_name(number: int, coordinates: Coordinates) -> str:
    """A revolute in words, or an axis that carries the base; these are counted after the revolutes."""
    names = [f"the {name} axis" for name in coordinates.base_names]
    return revolute_name(number) if number < coordinates.revolutes else names[number - coordinates.revolutes]


def check_static_load(rows: PathRows, limits: Limits, coordinates: Coordinates) -> None:
    """Check that every drive can hold the arm everywhere on the path; then some slow motion keeps all limits.

    Raises:
        RetimingError: naming the joint that cannot, its torque, its limit and the place on the path; or the feed axis
            and its force; or the place at which the rows are not finite.
    """
    _check_finite(rows)
    if rows.c.shape[1] == rows.effort_rows:
        return
    load = np.abs(rows.c[:, rows.effort_rows :])
    point, row = np.unravel_index(np.argmax(load), load.shape)
    if load[point, row] >= 1.0:
        number = int(rows.axis[rows.effort_rows + row])
        raise too_weak(number, float(load[point, row]), float(rows.s[point]), limits, coordinates)


def too_weak(number: int, share: float, place: float, limits: Limits, coordinates: Coordinates) -> RetimingError:
    """The error for a drive that cannot hold the arm still.

    Args:
        number: of the drive.
        share: of its limit that it needs.
        place: path parameter.
        limits: of the problem.
        coordinates: of the arm.
    """
    kind, unit, part = ("torque", "N m", "joint") if number < coordinates.revolutes else ("force", "N", "axis")
    limit = float(limits.of_drives(coordinates).effort[number])
    load = share * limit
    return RetimingError(
        Diagnosis(
            reason=f"{drive_name(number, coordinates)} needs {load:.4g} {unit} to hold the arm still at {place:.1%} "
            f"of the path, but its {kind} limit is {limit:.4g} {unit}",
            stage="retiming",
            advice=(
                f"raise the {kind} limit of this {part} above {load:.4g} {unit}",
                "make the links lighter, or correct the direction of gravity",
                "choose a start or goal nearer to the vertical through the base",
            ),
            evidence={"revolute": number, kind: load, "limit": limit, "path_position": place},
        )
    )


def _check_finite(rows: PathRows) -> None:
    bad = ~(np.isfinite(rows.a) & np.isfinite(rows.b) & np.isfinite(rows.c))
    if not np.any(bad):
        return
    point = int(np.argmax(np.any(bad, axis=1)))
    place = float(rows.s[point])
    raise RetimingError(
        Diagnosis(
            reason=f"the path or its inverse dynamics is not finite at {place:.1%} of the path",
            stage="retiming",
            advice=("look at the path's keyframes, and at the arm's masses and inertias",),
            evidence={"path_position": place},
        )
    )
