"""What a solution of the goal-pose NLP says: its curve, the rows that shape the pose, and those that are broken."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.curve.space_configuration import SpaceConfiguration
from ccm_opt.space.nlp.shooting_start import CurveNumbers
from ccm_opt.space.nlp.space_pose_program import SpacePoseProgram


def curve_from(program: SpacePoseProgram, variables: FloatArray, arm: SpaceArm) -> SpaceConfiguration:
    """The curve of a solution, in metres, from where the base is."""
    places = program.places
    arcs = variables[places["arcs"]]
    if np.any(np.diff(arcs) <= 0.0):  # where the solver failed, knots may lie out of their order
        arcs = np.linspace(0.0, 1.0, len(arcs))
    curvatures = np.stack((variables[places["curvature left"]], variables[places["curvature up"]]))
    turn = variables[places["base turn"]]
    feed = float(variables[places["feed"]][0]) * arm.length
    return CurveNumbers(arcs, curvatures, turn).configuration(arm, feed)


def shaping_rows(names: tuple[str, ...], multipliers: FloatArray, least: float) -> dict[str, float]:
    """Multipliers of the rows that shape the pose, the largest first; those of equations that tie variables aside."""
    order = np.argsort(-np.abs(multipliers), kind="stable")
    shaping = [int(row) for row in order if abs(multipliers[row]) > least and not _is_tie(names[row])]
    return {names[row]: float(abs(multipliers[row])) for row in shaping}


def named_above(names: tuple[str, ...], violation: FloatArray, allowed: float) -> dict[str, float]:
    """Rows that are violated by more than is allowed, the worst first."""
    order = np.argsort(-violation, kind="stable")
    return {names[row]: float(violation[row]) for row in order if violation[row] > allowed}


def _is_tie(name: str) -> bool:
    """Whether a row only ties variables together and asks nothing of the pose."""
    if name.startswith("user: "):  # whatever its user calls it
        return False
    return "mapping" in name or "gap in" in name or "spline at" in name
