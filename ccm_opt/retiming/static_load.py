"""A drive that cannot hold the arm still, in the user's terms."""

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits

_AXIS = ("first (yaw)", "second (bend)", "third")


def revolute_name(number: int) -> str:
    """Ball and axis of a revolute in words, the ball counted from 1."""
    return f"joint {number // 3 + 1}, {_AXIS[number % 3]} axis"


def drive_name(number: int, coordinates: Coordinates) -> str:
    """A revolute in words, or an axis that carries the base; these are counted after the revolutes."""
    names = [f"the {name} axis" for name in coordinates.base_names]
    return revolute_name(number) if number < coordinates.revolutes else names[number - coordinates.revolutes]


def too_weak(number: int, share: float, place: float, limits: Limits, coordinates: Coordinates) -> RetimingError:
    """The error for a drive that cannot hold the arm still.

    Args:
        number: of the drive.
        share: of its limit that it needs.
        place: path parameter.
        limits: of the problem.
        coordinates: of the arm.
    """
    turning = number < coordinates.revolutes
    kind = "torque" if turning else "force"
    unit = "N m" if turning else "N"
    part = "joint" if turning else "axis"

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
