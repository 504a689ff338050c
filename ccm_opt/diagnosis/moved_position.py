"""A goal's position moved towards a place where it can be taken: a change of problems in the plane and in space."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.ground.length_words import file_length
from ccm_opt.problem import TipGoal
from ccm_opt.space.problem import AnyProblem, SpaceTipGoal


def about_the_goal(findings: tuple[Finding, ...]) -> bool:
    """Whether all that is proved is about the goal."""
    return bool(findings) and all(finding.key.startswith("goal") for finding in findings)


def moved_position(
    problem: AnyProblem, goal: TipGoal | SpaceTipGoal, place: FloatArray, bound: float, tried: Sequence[float]
) -> Parameter:
    """The position of the goal of a problem, moved by a distance towards a place, or beyond it.

    Args:
        problem: whose arm it is for.
        goal: its last, for the tip.
        place: towards which it is moved, shape (d,) [m].
        bound: the least distance that may do [m].
        tried: distances that are tried beyond it, in order [m].
    """
    offset = place - goal.position
    direction = offset / float(np.linalg.norm(offset))

    def moved(by: float) -> FloatArray:
        return np.asarray(goal.position + by * direction)

    return Parameter(
        "goal.position",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=replace(goal, position=moved(by))),
        lambda p, by: f"goal.position moved by {file_length(by)}, to {_in_file(moved(by), p.length_unit)}",
        lambda p: 1.0 / METRES[_unit(p)],
        whole=problem.arm.length,
        bound=bound,
        tried=tuple(tried),
        paths_stay=False,
    )


def _unit(problem: AnyProblem) -> LengthUnit:
    return problem.length_unit


def _in_file(place: FloatArray, unit: LengthUnit) -> str:
    """A place (d,) [m] as it is written in the problem's file, to a tenth of a millimetre."""
    decimals = {"m": 4, "mm": 1, "in": 3}[unit]
    return f"({', '.join(f'{float(coordinate) / METRES[unit]:.{decimals}f}' for coordinate in place)})"
