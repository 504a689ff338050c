"""The mapping from a curve to the joints of an arm, in the plane and in space."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polyline import vector_headings, wrap
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration, Curve
from ccm_opt.robot.inverse_kinematics import LENGTH_TOLERANCE, bends_from_directions

REGULARISATION = 0.05
"""ε of the least-squares mapping, in units of l²: just enough to keep neighbouring links from zigzagging. Taste."""
_MOST_STEPS = 60
"""Most Newton steps of the least-squares mapping. Taste: ten times the usual number."""
_SETTLED = 1e-11
"""Largest heading step at which the least-squares mapping has converged [rad]. Derived: a hundred times rounding."""
_ROUNDING = 1e-8
"""Step size below which a step no smaller than the last is rounding [rad]. Derived: the square root of rounding."""


def even_joint_directions(points: FloatArray, link_length: float) -> FloatArray:
    """Return the link directions that put every second joint on the curve.

    The odd joint of a pair is at distance l from both even joints, on the side to which the curve bulges: the side of
    the curve point half-way between them. In the plane these are the two circles of the paper; where the bulge changes
    side the mapping jumps.

    Args:
        points: points of the curve at the arc length of every joint, shape (links + 1, d) [m].
        link_length: l [m].

    Returns:
        Unit vectors, shape (links, d).

    Raises:
        ProblemError: the number of links is odd, or two even joints coincide or are farther apart than two links.
    """
    links = len(points) - 1
    if links % 2:
        raise ProblemError(f"the even-joint mapping needs an even number of links, got {links}")
    steps = np.diff(points[::2], axis=0)
    chords = np.linalg.norm(steps, axis=1)
    for pair in np.flatnonzero(chords > (2.0 + LENGTH_TOLERANCE) * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} are {chords[pair]:.9g} m apart, two links reach only "
            f"{2.0 * link_length:.9g} m; make curve and arm equally long"
        )
    for pair in np.flatnonzero(chords < ROUNDING * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} coincide, so joint {2 * pair + 1} has no place of its own; "
            "bend the curve less or use more links"
        )
    along = steps / chords[:, None]
    bulge = points[1::2] - points[:-1:2]
    bulge = bulge - np.sum(bulge * along, axis=1, keepdims=True) * along
    size = np.linalg.norm(bulge, axis=1, keepdims=True)
    # If the curve bulges to neither side, any side will do.
    side = np.where(size > 0.0, bulge / np.where(size > 0.0, size, 1.0), _across(along)[:, 0])
    # Both links of a pair make the same angle with their chord: an isosceles triangle.
    cosine = np.clip(0.5 * chords / link_length, 0.0, 1.0)[:, None]
    lift = np.sqrt(1.0 - cosine**2) * side
    directions = np.stack((cosine * along + lift, cosine * along - lift), axis=1).reshape(links, -1)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def least_squares_directions(points: FloatArray, means: FloatArray, link_length: float) -> FloatArray:
    """Return the link directions that fit the joints to the curve in least squares, with an exact tip.

    The directions are d = argmin Σ|P_j − p(s_j)|² + ε Σ angle(d_i, m_i)² subject to the exact tip. The method is
    Gauss–Newton in the turns of the links, and Newton on the tip equations (Nocedal and Wright, Numerical Optimization,
    chapter 18); each step solves H δ + Jᵀλ = -g, J δ = -c with the Schur complement.

    Args:
        points: points of the curve at the arc length of every joint, shape (links + 1, d) [m].
        means: m, the mean direction of the curve over each link, shape (links, d).
        link_length: l [m].

    Raises:
        ProblemError: the iteration does not converge.
    """
    directions = means.copy()
    before = np.inf
    for _ in range(_MOST_STEPS):
        step, miss = _tangent_step(points, directions, means, link_length, REGULARISATION * link_length**2)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        directions = np.asarray(np.cos(size) * directions + np.sinc(size / np.pi) * step)
        longest = float(size.max())
        # The tip of a nearly straight arm hardly moves along the arm, so rounding of its position is magnified in the
        # turns of the links: small steps that no longer shrink are that rounding.
        if longest < _SETTLED or _ROUNDING > longest >= before:
            return directions
        before = longest
    raise ProblemError(
        f"the least-squares mapping did not converge in {_MOST_STEPS} steps: the tip is still {miss:.3g} m off; "
        "use more links or a curve that bends less per link"
    )


def _tangent_step(
    points: FloatArray, directions: FloatArray, means: FloatArray, l: float, epsilon: float
) -> tuple[FloatArray, float]:
    """Return the changes of directions, each perpendicular to its direction, shape (n, d), and the tip error [m]."""
    n, d = directions.shape
    residual = points[0] + l * np.cumsum(directions, axis=0) - points[1:]
    axes = _across(directions)
    turn = l * axes.reshape(-1, d)
    below = np.repeat(np.arange(n)[::-1], d - 1)[:, None]
    later = np.minimum(below, below.T).astype(np.float64)  # joints short of the tip that both links move
    hessian = (turn @ turn.T) * later + epsilon * np.eye(len(turn))
    inner = residual.copy()
    inner[-1] = 0.0
    carried = np.cumsum(inner[::-1], axis=0)[::-1]
    gradient = np.einsum("nad,nd->na", axes, l * carried - epsilon * _sphere_logarithm(directions, means)).ravel()
    solved = np.linalg.solve(hessian, np.column_stack((gradient, turn)))
    schur = turn.T @ solved[:, 1:]
    # A straight arm cannot move its tip along itself: the pseudo-inverse drops that direction.
    multiplier = np.linalg.pinv(schur, rcond=1e-12) @ (residual[-1] - turn.T @ solved[:, 0])
    step = -solved[:, 0] - solved[:, 1:] @ multiplier
    return np.einsum("na,nad->nd", step.reshape(n, d - 1), axes), float(np.linalg.norm(residual[-1]))


def _across(directions: FloatArray) -> FloatArray:
    """Return orthonormal vectors perpendicular to each direction, shape (n, d - 1, d), for directions (n, d)."""
    return np.asarray(np.linalg.svd(directions[:, None, :])[2][:, 1:])


def _sphere_logarithm(directions: FloatArray, means: FloatArray) -> FloatArray:
    """Return the sphere logarithms from directions to means, shape (n, d).

    Each logarithm is a vector perpendicular to its direction, as long as the angle between direction and mean [rad].
    """
    along = np.sum(directions * means, axis=1, keepdims=True)
    sideways = means - along * directions
    size = np.linalg.norm(sideways, axis=1, keepdims=True)
    angle = np.arctan2(size, along)
    return np.asarray(np.where(size > 0.0, angle / np.maximum(size, np.finfo(np.float64).tiny), 1.0) * sideways)


def map_curve(arm: Arm, curve: Curve, method: MappingName) -> FloatArray:
    """Return the joint bends with which the arm follows a curve, shape (k links,) [rad].

    Every link keeps its length.

    Args:
        arm: the jointed arm; it is placed at the base of the curve.
        curve: the curve, as long as the arm.
        method: ``even-joints`` puts every second joint on the curve (section 5.3); ``least-squares`` brings all joints
            close to their points on the curve with the tip exact.

    Raises:
        ProblemError: the lengths differ, or the mapping does not exist for this curve.
    """
    if abs(curve.length - arm.length) > LENGTH_TOLERANCE * arm.length:
        raise ProblemError(
            f"the curve is {curve.length:.9g} m long but the arm {arm.length:.9g} m ({arm.links} links of "
            f"{arm.link_length:g} m); make the segment lengths add up to the arm's length"
        )
    points = curve_points(curve, arm.links)
    if method == "even-joints":
        directions = even_joint_directions(points, arm.link_length)
    else:
        directions = least_squares_directions(points, curve.mean_directions(arm.links), arm.link_length)
    if isinstance(curve, Configuration):  # in the plane, headings follow the curve, whole turns included
        means = curve.mean_headings(arm.links)
        return arm.bends(means + wrap(vector_headings(directions) - means))
    return bends_from_directions(arm, directions).ravel()


def curve_points(curve: Curve, links: int) -> FloatArray:
    """Return the points of the curve at equal arc lengths, including base and tip, shape (links + 1, d) [m]."""
    return curve.positions_at(np.linspace(0.0, curve.length, links + 1))


def shape_error(arm: Arm, curve: Curve, bends: FloatArray) -> float:
    """Return the greatest distance of a joint from its own point on the curve, max ``|P_j - p(s_j)|`` [m].

    At curvature κ the even-joint mapping gives 0.077 κ l² with the elbow on the bulge side.
    """
    points = curve_points(curve, arm.links)
    joints = arm.joint_positions_at(arm.configuration(bends, 0.0)) - arm.base + points[0]
    return float(np.linalg.norm(joints - points, axis=1).max())
