"""Why a path cannot be timed, in the user's terms."""

import numpy as np

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.problem import Limits
from ccm_opt.retiming.rows import PathRows

_AXIS = ("first (yaw)", "second (bend)", "third")


def revolute_name(number: int) -> str:
    """Ball and axis of a revolute in words, the ball counted from 1."""
    return f"joint {number // 3 + 1}, {_AXIS[number % 3]} axis"


def check_static_load(rows: PathRows, limits: Limits) -> None:
    """Check that every joint can hold the arm everywhere on the path.

    Raises:
        RetimingError: naming the joint that cannot, its torque, its limit and the place on the path.
    """
    if limits.torque is None or rows.c.shape[1] == rows.torque_rows:
        return
    load = np.abs(rows.c[:, rows.torque_rows :])
    point, row = np.unravel_index(np.argmax(load), load.shape)
    if load[point, row] < 1.0:
        return
    number = int(rows.revolute[rows.torque_rows + row])
    limit = float(limits.torque[number])
    torque, place = float(load[point, row]) * limit, float(rows.s[point])
    raise RetimingError(
        Diagnosis(
            reason=f"{revolute_name(number)} needs {torque:.4g} N m to hold the arm still at {place:.1%} of the path, "
            f"but its torque limit is {limit:.4g} N m",
            stage="retiming",
            advice=(
                f"raise the torque limit of this joint above {torque:.4g} N m",
                "make the links lighter, or correct the direction of gravity",
                "choose a start or goal nearer to the vertical through the base",
            ),
            evidence={"revolute": number, "torque": torque, "limit": limit, "path_position": place},
        )
    )


def explain_failure(rows: PathRows, limits: Limits, point: int) -> RetimingError:
    """The error for a grid point at which TOPP-RA finds no feasible speed; names the row with the least room."""
    row = int(
        np.argmax(np.abs(rows.c[point]) + np.abs(rows.b[point]) / max(float(np.max(np.abs(rows.b[point]))), 1e-300))
    )
    number, is_torque = int(rows.revolute[row]), row >= rows.torque_rows
    kind, unit = ("torque", "N m") if is_torque else ("acceleration", "rad/s²")
    values = limits.torque if is_torque and limits.torque is not None else limits.acceleration
    limit, place = float(values[number]), float(rows.s[point])
    return RetimingError(
        Diagnosis(
            reason=f"no speed keeps the limits at {place:.1%} of the path; the tightest there is the {kind} limit of "
            f"{revolute_name(number)}, {limit:.4g} {unit}",
            stage="retiming",
            advice=(f"raise the {kind} limit of this joint", "plan a smoother path, or one with fewer sharp turns"),
            evidence={"revolute": number, "kind": kind, "limit": limit, "path_position": place},
        )
    )
