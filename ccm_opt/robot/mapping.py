"""The mapping from a curve to the joints of an arm."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import vector_headings, wrap
from ccm_opt.errors import ProblemError
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.link_bodies import DEFAULT_MAPPING, MappingSettings


def even_joint_headings(
    points: FloatArray, near: FloatArray, link_length: float, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings with every second joint on the curve.

    The odd joint of a pair lies at distance l from both even joints, on the side to which the curve bulges: the side
    of its point half-way between them. Where the bulge changes side the mapping jumps.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 2) [m].
        near: mean headings of the curve per link; the result takes the nearest turn, shape (links,) [rad].
        link_length: l [m].
        settings: by how much two links' chord may be too long.

    Returns:
        Shape (links,) [rad].

    Raises:
        ProblemError: the number of links is odd, or two even joints coincide or are farther apart than two links.
    """
    if len(near) % 2:
        raise ProblemError(f"the even-joint mapping needs an even number of links, got {len(near)}")
    chords, directions = _chords(points, link_length, settings.length_tolerance)
    # Both links of a pair make the same angle with its chord: an isosceles triangle.
    lift = np.arccos(np.clip(0.5 * chords / link_length, 0.0, 1.0)) * _bulge_side(points)
    headings = np.column_stack((directions + lift, directions - lift)).ravel()
    nearest: FloatArray = near + wrap(headings - near)
    return nearest


def _chords(points: FloatArray, link_length: float, slack: float) -> tuple[FloatArray, FloatArray]:
    """Lengths and directions of the chords between even joints, each of shape (links / 2,) [m], [rad]."""
    steps = np.diff(points[::2], axis=0)
    chords = np.linalg.norm(steps, axis=1)
    for pair in np.flatnonzero(chords > (2.0 + slack) * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} are {chords[pair]:.9g} m apart, two links reach only "
            f"{2.0 * link_length:.9g} m; make curve and arm equally long"
        )
    for pair in np.flatnonzero(chords < ROUNDING * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} coincide, so joint {2 * pair + 1} has no place of its own; "
            "bend the curve less or use more links"
        )
    return chords, vector_headings(steps)


def _bulge_side(points: FloatArray) -> FloatArray:
    """+1 where the curve between two even joints lies left of their chord, else -1."""
    chord = np.diff(points[::2], axis=0)
    half_way = points[1::2] - points[:-1:2]
    return np.where(cross(chord, half_way) >= 0.0, 1.0, -1.0)


def least_squares_headings(
    points: FloatArray, mean: FloatArray, link_length: float, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings φ = argmin Σ|P_j - p(s_j)|² + ε|φ - φ̄|² subject to the tip being exact.

    Gauss-Newton on the least-squares part, Newton on the two tip equations (Nocedal and Wright, Numerical
    Optimization, chapter 18); each step solves H δ + Jᵀλ = -g, J δ = -c by its 2×2 Schur complement.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 2) [m].
        mean: φ̄, mean headings of the curve per link, shape (links,) [rad].
        link_length: l [m].
        settings: ε, and when the iteration has settled.

    Returns:
        Shape (links,) [rad].

    Raises:
        ProblemError: the iteration does not settle.
    """
    headings = mean.copy()
    epsilon = settings.regularisation * link_length**2
    before = np.inf
    for _ in range(settings.most_steps):
        step, miss = _newton_step(points, headings, mean, link_length, epsilon)
        headings = headings + step
        length = float(np.abs(step).max())
        # The tip of an arm that is nearly straight hardly moves along itself, and rounding there is many times as much
        # in the headings: what small steps no longer lessen is that.
        if length < settings.settled or settings.rounding > length >= before:
            return headings
        before = length
    raise ProblemError(
        f"the least-squares mapping did not settle in {settings.most_steps} steps, the tip is still {miss:.3g} m off; "
        "use more links or a curve that bends less per link"
    )


def _newton_step(
    points: FloatArray, headings: FloatArray, mean: FloatArray, link_length: float, epsilon: float
) -> tuple[FloatArray, float]:
    """The step δ of the headings, shape (links,) [rad], and the tip's distance from the curve's tip [m]."""
    n = len(headings)
    unit = np.stack((np.cos(headings), np.sin(headings)))
    residual = points[0][:, None] + link_length * np.cumsum(unit, axis=1) - points[1:].T
    turn = link_length * np.stack((-unit[1], unit[0]))  # the derivative of one link's vector
    below = np.arange(n)[::-1, None]
    later = np.minimum(below, below.T).astype(np.float64)  # joints before the tip moved by both headings
    hessian = (turn.T @ turn) * later + epsilon * np.eye(n)
    gradient = (turn * _sums_of_later(residual)).sum(axis=0) + epsilon * (headings - mean)
    solved = np.linalg.solve(hessian, np.column_stack((gradient, turn.T)))
    schur = turn @ solved[:, 1:]
    # A straight arm cannot move its tip along itself: the pseudo-inverse drops that direction.
    multiplier = np.linalg.pinv(schur, rcond=1e-12) @ (residual[:, -1] - turn @ solved[:, 0])
    return -solved[:, 0] - solved[:, 1:] @ multiplier, float(np.hypot(*residual[:, -1]))


def _sums_of_later(residual: FloatArray) -> FloatArray:
    """Sum of the residuals of all joints beyond each link but the tip, shape (2, links)."""
    inner = residual.copy()
    inner[:, -1] = 0.0
    return np.cumsum(inner[:, ::-1], axis=1)[:, ::-1]


def map_curve(
    arm: Arm, configuration: Configuration, method: MappingName, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings that follow a curve, shape (links,) [rad]; every link keeps its length by construction.

    Args:
        arm: the jointed arm; it is placed at the base of the curve.
        configuration: a curve as long as the arm.
        method: ``even-joints`` puts every second joint on the curve (section 5.3), ``least-squares`` brings all
            joints near their points of the curve with the tip exact.
        settings: tolerances, and the weight that keeps links from zigzagging.

    Raises:
        ProblemError: the lengths differ, or the mapping does not exist for this curve.
    """
    if abs(configuration.length - arm.length) > settings.length_tolerance * arm.length:
        raise ProblemError(
            f"the curve is {configuration.length:.9g} m long but the arm {arm.length:.9g} m "
            f"({arm.links} links of {arm.link_length:g} m); make the segment lengths add up to the arm's length"
        )
    points = curve_points(configuration, arm.links)
    headings = mean_headings(configuration, arm.links)
    if method == "even-joints":
        return even_joint_headings(points, headings, arm.link_length, settings)
    return least_squares_headings(points, headings, arm.link_length, settings)


def mean_headings(configuration: Configuration, links: int) -> FloatArray:
    """Mean heading of the curve over each of ``links`` equal lengths, shape (links,) [rad]; exact."""
    edges = np.linspace(0.0, configuration.length, links + 1)
    means: FloatArray = np.diff(configuration.heading_integral_at(edges)) * (links / configuration.length)
    return means


def curve_points(configuration: Configuration, links: int) -> FloatArray:
    """Points of the curve at equal arc lengths, base and tip included, shape (links + 1, 2) [m]."""
    return configuration.positions_at(np.linspace(0.0, configuration.length, links + 1))


def shape_error(arm: Arm, configuration: Configuration, headings: FloatArray) -> float:
    """Greatest distance of a joint from its own point of the curve, max |P_j - p(s_j)| [m].

    For curvature κ the even-joint mapping gives 0.077 κ l² with the elbow on the bulge side.
    """
    joints = arm.joint_positions(headings) - arm.base + configuration.base
    return float(np.linalg.norm(joints - curve_points(configuration, arm.links), axis=1).max())
