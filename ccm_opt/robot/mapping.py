"""Mapping from a continuous curve to the joints of an arm, in the plane and in space."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polyline import vector_headings, wrap
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration, Curve, link_edges
from ccm_opt.robot.inverse_kinematics import LENGTH_TOLERANCE, bends_from_directions

REGULARISATION = 0.05
"""Weight ε of the least-squares mapping, in units of the squared link length: just enough to keep neighbouring links
from zigzagging. Heuristic."""
_MOST_STEPS = 60
"""Maximum number of Newton steps of the least-squares mapping. Heuristic: ten times the usual number."""
_SETTLED = 1e-11
"""Largest turn of a link in a Newton step at which the least-squares mapping counts as converged [rad]. Derived: a
hundred times rounding."""
_ON_TIP = 1e-9
"""Distance of the tip from its goal at which the iteration ends, as a fraction of the arm's length."""
_ROUNDING = 1e-8
"""Turn of a link in a Newton step below which a step that did not shrink counts as rounding error [rad]. Derived: the
square root of rounding."""


def even_joint_directions(points: FloatArray, link_length: float) -> FloatArray:
    """Return the link directions of an arm that has every second joint on a curve (paper, section 5.3).

    Each odd joint is at distance l from its two even neighbours, on the side of the chord between them on which the
    curve lies half-way. In the plane it is an intersection of the two circles of the paper. Where the curve changes
    side the mapping jumps.

    Args:
        points: points of the curve at the arc length of every joint, shape (links + 1, d) [m].
        link_length: length l of a link [m].

    Returns:
        Unit vectors from the base to the tip, shape (links, d).

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


def least_squares_directions(
    points: FloatArray, means: FloatArray, link_length: float, shares: FloatArray | None = None
) -> FloatArray:
    """Return the link directions that bring all joints of an arm close to a curve, with the tip exactly on its end.

    The directions d_i minimise Σ |P_j − p(s_j)|² + ε Σ angle(d_i, m_i)² over the joint positions P_j, subject to the
    exact tip. The method is Gauss–Newton in the turns of the links, and Newton on the tip equations (Nocedal and
    Wright, Numerical Optimization, chapter 18); each step solves H δ + Jᵀλ = -g, J δ = -c with the Schur complement.

    Args:
        points: points p(s_j) of the curve at the arc length of every joint, shape (links + 1, d) [m].
        means: mean direction m_i of the curve over each link, shape (links, d).
        link_length: l, the mean length of the links [m].
        shares: length of each link over that, shape (links,); ones if None.

    Returns:
        Unit vectors, shape (links, d).

    Raises:
        ProblemError: the iteration does not converge.
    """
    directions = means.copy()
    epsilon = REGULARISATION * link_length**2
    each = np.ones(len(means)) if shares is None else shares
    length = link_length * len(means)
    before, straight = np.inf, False
    for _ in range(_MOST_STEPS):
        step, miss = _tangent_step(points, directions, means, (link_length, each), epsilon)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        directions = np.asarray(np.cos(size) * directions + np.sinc(size / np.pi) * step)
        longest = float(size.max())
        # The tip of a nearly straight arm hardly moves along the arm, so rounding of its position is magnified in the
        # turns of the links: small steps that no longer shrink are that rounding.
        settled = longest < _SETTLED or _ROUNDING > longest >= before
        before = longest
        if settled and (straight or miss <= _ON_TIP * length):
            return directions
        if settled:
            directions = _bent_alternately(directions, miss / length)
            straight, before = True, np.inf
    raise ProblemError(
        f"the least-squares mapping did not converge in {_MOST_STEPS} steps: the tip is still {miss:.3g} m off; "
        "use more links or a curve that bends less per link"
    )


def _bent_alternately(directions: FloatArray, shorter: float) -> FloatArray:
    """Return directions turned to one side and the other in turn, so that a straight arm is shorter by a fraction.

    No small step brings the tip of a straight arm nearer to its base.
    """
    turn = np.sqrt(2.0 * shorter) * (-1.0) ** np.arange(len(directions))[:, None]
    return np.asarray(np.cos(turn) * directions + np.sin(turn) * _across(directions)[:, 0])


def _tangent_step(
    points: FloatArray, directions: FloatArray, means: FloatArray, links: tuple[float, FloatArray], epsilon: float
) -> tuple[FloatArray, float]:
    """Return one Gauss–Newton step of the least-squares mapping, and the distance of the tip from its goal [m].

    Args:
        points: points of the curve at the arc length of every joint, shape (n + 1, d) [m].
        directions: current link directions, unit vectors, shape (n, d).
        means: mean direction of the curve over each link, shape (n, d).
        links: mean length of the links [m], and the length of each over it, shape (n,).
        epsilon: weight of the angles between directions and means [m²].

    Returns:
        Changes of the directions, each perpendicular to its direction, shape (n, d) [rad], and the distance.
    """
    n, d = directions.shape
    l, shares = links
    residual = points[0] + l * np.cumsum(shares[:, None] * directions, axis=0) - points[1:]
    axes = _across(directions)
    turn = (l * shares[:, None, None] * axes).reshape(-1, d)
    below = np.repeat(np.arange(n)[::-1], d - 1)[:, None]
    later = np.minimum(below, below.T).astype(np.float64)  # number of joints, without the tip, that both links move
    hessian = (turn @ turn.T) * later + epsilon * np.eye(len(turn))
    inner = residual.copy()
    inner[-1] = 0.0
    carried = np.cumsum(inner[::-1], axis=0)[::-1]
    gradient = np.einsum(
        "nad,nd->na", axes, l * shares[:, None] * carried - epsilon * _sphere_logarithm(directions, means)
    ).ravel()
    solved = np.linalg.solve(hessian, np.column_stack((gradient, turn)))
    schur = turn.T @ solved[:, 1:]
    # A straight arm cannot move its tip along itself: the pseudo-inverse drops that direction.
    multiplier = np.linalg.pinv(schur, rcond=1e-12) @ (residual[-1] - turn.T @ solved[:, 0])
    step = -solved[:, 0] - solved[:, 1:] @ multiplier
    return np.einsum("na,nad->nd", step.reshape(n, d - 1), axes), float(np.linalg.norm(residual[-1]))


def _across(directions: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the space perpendicular to each direction (n, d), shape (n, d - 1, d)."""
    return np.asarray(np.linalg.svd(directions[:, None, :])[2][:, 1:])


def _sphere_logarithm(directions: FloatArray, means: FloatArray) -> FloatArray:
    """Return the logarithms on the unit sphere from directions to means, both of shape (n, d).

    Each logarithm is the vector tangent to the sphere at a direction that points to the mean; its length is the angle
    between the two [rad].
    """
    along = np.sum(directions * means, axis=1, keepdims=True)
    sideways = means - along * directions
    size = np.linalg.norm(sideways, axis=1, keepdims=True)
    angle = np.arctan2(size, along)
    return np.asarray(np.where(size > 0.0, angle / np.maximum(size, np.finfo(np.float64).tiny), 1.0) * sideways)


def map_curve(arm: Arm, curve: Curve, method: MappingName) -> FloatArray:
    """Return the joint bends with which an arm takes the shape of a curve, shape (k links,), k per joint [rad].

    Links keep their length, so the joints lie only near the curve.

    Args:
        arm: the jointed arm, whose base is taken to be that of the curve.
        curve: the curve, as long as the arm.
        method: ``even-joints`` puts every second joint on the curve (section 5.3); ``least-squares`` brings all joints
            close to the curve and the tip exactly to its end.

    Raises:
        ProblemError: the arm has unequal links, the lengths differ, or the mapping does not exist for this curve.
    """
    if abs(curve.length - arm.length) > LENGTH_TOLERANCE * arm.length:
        raise ProblemError(
            f"the curve is {curve.length:.9g} m long but the arm {arm.length:.9g} m ({arm.links} links of "
            f"{arm.link_length:g} m); make the segment lengths add up to the arm's length"
        )
    lengths = None if arm.proportions is None else arm.lengths
    points = curve_points(curve, arm.links, lengths)
    if method == "even-joints":
        if lengths is not None and np.ptp(lengths) > LENGTH_TOLERANCE * arm.link_length:
            raise ProblemError("the even-joint mapping needs links of equal length; choose the mapping 'least-squares'")
        directions = even_joint_directions(points, arm.link_length)
    else:
        directions = least_squares_directions(
            points, curve.mean_directions(arm.links, lengths), arm.link_length, arm.length_shares
        )
    if isinstance(curve, Configuration):  # in the plane, headings follow the curve, whole turns included
        means = curve.mean_headings(arm.links, lengths)
        return arm.bends(means + wrap(vector_headings(directions) - means))
    return bends_from_directions(arm, directions).ravel()


def curve_points(curve: Curve, links: int, lengths: FloatArray | None = None) -> FloatArray:
    """Divide a curve into ``links`` pieces and return their ends, from base to tip, shape (links + 1, d) [m].

    The pieces have equal lengths or, if ``lengths``, shape (links,), are given, lengths in their proportion.
    """
    return curve.positions_at(link_edges(curve.length, links, lengths))


def shape_error(arm: Arm, curve: Curve, bends: FloatArray) -> float:
    """Return the greatest distance of a joint from the curve point of equal arc length, max ``|P_j - p(s_j)|`` [m].

    On a curve of constant curvature κ the even-joint mapping gives 0.077 κ l², with l the link length.

    Args:
        arm: the arm, which is moved to the base of the curve.
        curve: the curve.
        bends: joint bends, shape (k links,) for k bends per joint [rad].
    """
    points = curve_points(curve, arm.links, None if arm.proportions is None else arm.lengths)
    joints = arm.joint_positions_at(arm.configuration(bends, 0.0)) - arm.base + points[0]
    return float(np.linalg.norm(joints - points, axis=1).max())
