"""From a curve in space to the arm and back: even joints on the curve, or all joints near it with the tip exact."""

import numpy as np

from ccm_opt.continuum.segment import PIECES
from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import MappingName
from ccm_opt.jointed.jointed_settings import DEFAULT_MAPPING, MappingSettings
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_inverse_kinematics import bends_from_directions
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.curve.curve_space import CurveSpace
from ccm_opt.space.curve.link_directions import even_joint_directions, least_squares_directions, mean_directions
from ccm_opt.space.curve.rigid_motions import exponential
from ccm_opt.space.curve.space_configuration import SpaceConfiguration


def map_space_curve(
    arm: SpaceArm, curve: SpaceConfiguration, method: MappingName, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Configuration of the arm that follows a curve, shape (c,) [rad, m]; every link keeps its length.

    Args:
        arm: the jointed arm.
        curve: as long as the arm, from its base or from a place on its feed axis.
        method: ``even-joints`` puts every second joint on the curve (section 5.3), ``least-squares`` brings all joints
            near their points of the curve with the tip exact.
        settings: tolerances, and the weight that keeps links from zigzagging.

    Raises:
        ProblemError: the lengths differ, the curve begins elsewhere, or the mapping does not exist for this curve.
    """
    allowed = settings.length_tolerance * arm.length
    if abs(curve.length - arm.length) > allowed:
        raise ProblemError(
            f"the curve is {curve.length:.9g} m long but the arm {arm.length:.9g} m ({arm.links} links of "
            f"{arm.link_length:g} m); make the segment lengths add up to the arm's length"
        )
    feed = float(np.clip((curve.base - arm.base) @ arm.direction, *arm.base_range))
    off = float(np.linalg.norm(curve.base - arm.base - feed * arm.direction))
    if off > allowed:
        raise ProblemError(f"the curve begins {off:.3g} m off the base of the arm; let it begin there")
    points = curve_points_in_space(curve, arm.links)
    means = mean_directions(curve, arm.links)
    if method == "even-joints":
        directions = even_joint_directions(points, arm.link_length, settings)
    else:
        directions = least_squares_directions(points, means, arm.link_length, settings)
    return arm.configuration(bends_from_directions(arm, directions), feed)


def curve_points_in_space(curve: SpaceConfiguration, links: int) -> FloatArray:
    """Points of the curve at equal arc lengths, base and tip included, shape (links + 1, 3) [m]."""
    return curve.positions_at(np.linspace(0.0, curve.length, links + 1))


def shape_error_in_space(arm: SpaceArm, curve: SpaceConfiguration, q: FloatArray) -> float:
    """Greatest distance of a joint from its own point of the curve, max |P_j − p(s_j)| [m]."""
    apart = joint_positions(arm, q) - curve_points_in_space(curve, arm.links)
    return float(np.linalg.norm(apart, axis=1).max())


def nearest_space_curve(
    arm: SpaceArm, q: FloatArray, segments: int = 3, settings: MappingSettings = DEFAULT_MAPPING
) -> SpaceConfiguration:
    """The curve of even segments whose mean directions on the links come nearest to those of a pose.

    Bends are linear in the curvature to the first order in the length of a link; what that leaves is taken up by
    mapping the curve and fitting what it lacks. Where a curve turns by nearly a radian a link that need not settle.

    Args:
        arm: the arm.
        q: the pose, shape (c,) [rad, m].
        segments: of the curve.
        settings: when the fits have settled, and how many there are at most.
    """
    space = CurveSpace.of(arm, PIECES * segments + 1)
    v = space.nearest(q)
    for _ in range(settings.most_steps):
        bends = bends_from_directions(arm, mean_directions(curve_of_coordinates(space, v), arm.links))
        change = space.nearest(q - arm.configuration(bends, float(arm.coordinates.advance(q))))
        v = v + change
        # The fits come nearer by a share each: what is left is about as much as the last has brought.
        if float(np.abs(change).max()) < settings.rounding:
            break
    return curve_of_coordinates(space, v)


def curve_of_coordinates(space: CurveSpace, v: FloatArray) -> SpaceConfiguration:
    """The chain of natural segments with the curvatures of coordinates at its knots.

    Args:
        space: with 4 K + 1 knots, for K segments.
        v: shape (p,).

    Raises:
        ProblemError: the number of knots does not make whole segments.
    """
    knots = space.knots
    segments = (knots - 1) // PIECES
    if segments < 1 or PIECES * segments + 1 != knots:
        raise ProblemError(f"segments have five knots and share their ends: expected 5, 9, 13, ... knots, got {knots}")
    arm = space.arm
    curvature = (space.curvature_rows @ v).reshape(2, knots)
    turn = (v * space.scales)[[0, knots + 1]]
    rotation, _ = exponential(np.array([0.0, -turn[1], turn[0], 0.0, 0.0, 0.0]))
    values = [curvature[:, PIECES * k : PIECES * (k + 1) + 1].T for k in range(segments)]
    carried = float(arm.coordinates.advance(space.configurations(v)))
    return SpaceConfiguration.chain(
        arm.base + carried * arm.direction, arm.base_rotation @ rotation, [arm.length / segments] * segments, values
    )
