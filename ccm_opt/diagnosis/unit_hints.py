"""Whether numbers of a problem look as if they were given in another unit."""

from collections.abc import Iterator

import numpy as np
import shapely

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, UnitHintSettings
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.space.problem import AnyProblem, SpaceProblem, SpaceTipGoal


def unit_hints(problem: Problem, settings: UnitHintSettings = DEFAULT_DIAGNOSIS.units) -> tuple[str, ...]:
    """Advice where a unit looks wrong: lengths about a thousand times off, joint limits in radians; mostly none."""
    low_x, low_y, high_x, high_y = problem.workspace.boundary.bounds
    reach = float(shapely.distance(problem.workspace.boundary, shapely.Point(problem.arm.base)))
    size = max(high_x - low_x, high_y - low_y)
    return (*_of_lengths(problem, settings), *_of_room(problem, size, reach, settings), *_of_limits(problem, settings))


def unit_hints_in_space(problem: SpaceProblem, settings: UnitHintSettings = DEFAULT_DIAGNOSIS.units) -> tuple[str, ...]:
    """The same of a problem in space, which may have no room."""
    hints = [*_of_lengths(problem, settings)]
    bounds = problem.workspace.bounds
    if bounds is not None:
        beyond = np.maximum(np.maximum(bounds[0] - problem.arm.base, problem.arm.base - bounds[1]), 0.0)
        hints += _of_room(problem, float(np.ptp(bounds, axis=0).max()), float(np.linalg.norm(beyond)), settings)
    return (*hints, *_of_limits(problem, settings))


def _of_lengths(problem: AnyProblem, settings: UnitHintSettings) -> Iterator[str]:
    """Lengths beside the arm's."""
    arm = problem.arm
    lengths = [
        ("arm.radius", arm.radius, settings.thick),
        ("workspace.clearance", problem.workspace.clearance, settings.thick),
    ]
    if isinstance(problem.goal, TipGoal | SpaceTipGoal):
        far = float(np.linalg.norm(problem.goal.position - arm.base))
        lengths.append(("goal.position (its distance from the base)", far, settings.thousand))
    for name, length, (least, most) in lengths:
        times = length / arm.length
        if least <= times <= most:
            yield f"check the units: {name} is {times:.3g} times the arm's length, as if one were in mm, the other in m"


def _of_room(problem: AnyProblem, size: float, reach: float, settings: UnitHintSettings) -> Iterator[str]:
    """A room in which the arm is lost, into which it does not go, or from which its base is far away."""
    share = size / problem.arm.length
    if share > settings.thousand[0] or share < settings.small_room or reach / problem.arm.length > settings.thousand[0]:
        yield f"check the units: the room is {share:.3g} times as large as the arm is long"


def _of_limits(problem: AnyProblem, settings: UnitHintSettings) -> Iterator[str]:
    """A joint limit of as many degrees as one would give radians, with which the arm can hardly bend."""
    arm = problem.arm
    degrees = float(np.rad2deg(arm.joint_limit))
    if degrees <= np.pi and (arm.links - 1) * arm.joint_limit < settings.hardly_bends:
        yield (
            f"check the units: arm.joint_limit_deg = {degrees:.4g} lets all joints together bend by "
            f"{degrees * (arm.links - 1):.3g}°; {degrees:.4g} rad would be {np.rad2deg(degrees):.4g}°"
        )
