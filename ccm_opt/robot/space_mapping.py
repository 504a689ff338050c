"""The mapping from a curve in space to the joints of an arm."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.curve_space import CurveSpace
from ccm_opt.robot.inverse_kinematics import bends_from_directions
from ccm_opt.robot.link_bodies import DEFAULT_MAPPING, MappingSettings
from ccm_opt.robot.rigid_motions import exponential
from ccm_opt.robot.segment import PIECES
from ccm_opt.robot.space_configuration import SpaceConfiguration

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss points over a link; the direction is a smooth function but for knots, where its third derivative jumps."""


def mean_directions(curve: SpaceConfiguration, links: int) -> FloatArray:
    """Mean direction of the curve over each of ``links`` equal lengths, shape (links, 3).

    The mean is that of the turns from the frame in the middle: in the plane that of the headings.
    """
    length = curve.length / links
    middles = length * (np.arange(links) + 0.5)
    arcs = middles[:, None] + 0.5 * length * np.append(_NODES, 0.0)
    order = np.argsort(arcs.ravel())
    frames = np.empty((links * arcs.shape[1], 3, 3))
    frames[order] = curve.frames_at(arcs.ravel()[order])[0]
    frames = frames.reshape(links, -1, 3, 3)
    middle = frames[:, -1]
    local = np.einsum("nij,nki->nkj", middle, frames[:, :-1, :, 0])
    sideways = np.linalg.norm(local[..., 1:], axis=-1)
    angle = np.arctan2(sideways, local[..., 0])
    turns = local[..., 1:] * (angle / np.maximum(sideways, np.finfo(np.float64).tiny))[..., None]
    mean = 0.5 * np.einsum("k,nkd->nd", _WEIGHTS, turns)
    size = np.linalg.norm(mean, axis=1)
    ahead = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * mean), axis=1)
    return np.asarray(np.einsum("nij,nj->ni", middle, ahead))


def even_joint_directions(points: FloatArray, link_length: float, settings: MappingSettings) -> FloatArray:
    """Link directions with every second joint on the curve.

    The odd joint of a pair lies at distance l from both even joints, to the side to which the curve bulges: that of its
    point half-way between them. In the plane these are the two circles of the paper; where the bulge changes side the
    mapping jumps.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 3) [m].
        link_length: l [m].
        settings: by how much two links' chord may be too long.

    Returns:
        Shape (links, 3).

    Raises:
        ProblemError: the number of links is odd, or two even joints coincide or are farther apart than two links.
    """
    links = len(points) - 1
    if links % 2:
        raise ProblemError(f"the even-joint mapping needs an even number of links, got {links}")
    steps = np.diff(points[::2], axis=0)
    chords = np.linalg.norm(steps, axis=1)
    for pair in np.flatnonzero(chords > (2.0 + settings.length_tolerance) * link_length):
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
    # Where the curve is straight there is no lift either, and any side will do.
    side = np.divide(bulge, size, out=np.zeros_like(bulge), where=size > 0.0)
    cosine = np.clip(0.5 * chords / link_length, 0.0, 1.0)[:, None]
    lift = np.sqrt(1.0 - cosine**2) * side
    directions = np.stack((cosine * along + lift, cosine * along - lift), axis=1).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def least_squares_directions(
    points: FloatArray, means: FloatArray, link_length: float, settings: MappingSettings
) -> FloatArray:
    """Link directions d = argmin Σ|P_j − p(s_j)|² + ε Σ angle(d_i, m_i)² subject to the tip being exact.

    Gauss–Newton in turns of the links, Newton on the three equations of the tip, as in the plane.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 3) [m].
        means: m, mean directions of the curve per link, shape (links, 3).
        link_length: l [m].
        settings: ε, and when the iteration has settled.

    Raises:
        ProblemError: the iteration does not settle.
    """
    directions = means.copy()
    before = np.inf
    for _ in range(settings.most_steps):
        step, miss = _tangent_step(points, directions, means, link_length, settings.regularisation * link_length**2)
        size = np.linalg.norm(step, axis=1, keepdims=True)
        directions = np.asarray(np.cos(size) * directions + np.sinc(size / np.pi) * step)
        longest = float(size.max())
        if longest < settings.settled or settings.rounding > longest >= before:
            return directions
        before = longest
    raise ProblemError(
        f"the least-squares mapping did not settle in {settings.most_steps} steps, the tip is still {miss:.3g} m off; "
        "use more links or a curve that bends less per link"
    )


def _tangent_step(
    points: FloatArray, directions: FloatArray, means: FloatArray, l: float, epsilon: float
) -> tuple[FloatArray, float]:
    """Changes of the directions, each at right angles to its own, shape (n, 3), and the tip's distance [m]."""
    n = len(directions)
    residual = points[0] + l * np.cumsum(directions, axis=0) - points[1:]
    axes = np.linalg.svd(directions[:, None, :])[2][:, 1:]  # two unit vectors across each link, (n, 2, 3)
    turn = l * axes.reshape(2 * n, 3)
    below = np.repeat(np.arange(n)[::-1], 2)[:, None]
    later = np.minimum(below, below.T).astype(np.float64)  # joints before the tip that both links carry
    hessian = (turn @ turn.T) * later + epsilon * np.eye(2 * n)
    inner = residual.copy()
    inner[-1] = 0.0
    carried = np.cumsum(inner[::-1], axis=0)[::-1]
    pull = np.einsum("nad,nd->na", axes, l * carried - epsilon * _turn_to(directions, means))
    gradient = pull.ravel()
    solved = np.linalg.solve(hessian, np.column_stack((gradient, turn)))
    schur = turn.T @ solved[:, 1:]
    # A straight arm cannot move its tip along itself: the pseudo-inverse drops that direction.
    multiplier = np.linalg.pinv(schur, rcond=1e-12) @ (residual[-1] - turn.T @ solved[:, 0])
    step = -solved[:, 0] - solved[:, 1:] @ multiplier
    return np.einsum("na,nad->nd", step.reshape(n, 2), axes), float(np.linalg.norm(residual[-1]))


def _turn_to(directions: FloatArray, means: FloatArray) -> FloatArray:
    """The ways on the sphere from directions to their means: as long as the angle, across the direction, (n, 3)."""
    along = np.sum(directions * means, axis=1, keepdims=True)
    sideways = means - along * directions
    size = np.linalg.norm(sideways, axis=1, keepdims=True)
    angle = np.arctan2(size, along)
    return np.asarray(np.where(size > 0.0, angle / np.maximum(size, np.finfo(np.float64).tiny), 1.0) * sideways)


def map_space_curve(
    arm: Arm, curve: SpaceConfiguration, method: MappingName, settings: MappingSettings = DEFAULT_MAPPING
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


def shape_error_in_space(arm: Arm, curve: SpaceConfiguration, q: FloatArray) -> float:
    """Greatest distance of a joint from its own point of the curve, max |P_j − p(s_j)| [m]."""
    apart = arm.joint_positions_at(q) - curve_points_in_space(curve, arm.links)
    return float(np.linalg.norm(apart, axis=1).max())


def nearest_space_curve(
    arm: Arm, q: FloatArray, segments: int = 3, settings: MappingSettings = DEFAULT_MAPPING
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
