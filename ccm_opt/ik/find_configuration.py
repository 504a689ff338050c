"""Search for planar curves of the arm's length through a corridor of convex regions, by an NLP from several guesses.

The initial guess is a heading profile θ(s). In a region where the shortest path of the route has the length ℓ and the
curve gets the length Λ ≥ ℓ, the heading oscillates about that of the path by a sin 2πmu, u in [0, 1]. Such a curve
advances by Λ J₀(a), so the amplitude with J₀(a) = ℓ/Λ takes up the surplus length (Bessel's integral; the modal curves
of Chirikjian and Burdick use the same identity). Its m bumps rise Λ/(2m) H₀(a) from the path, where H₀ is Struve's
function; m is the smallest number whose bumps fit into the region.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise, product

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from scipy.special import struve

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ConfigurationNotFound
from ccm_opt.core.polyline import (
    WHOLE_TURN,
    arc_lengths,
    leg_headings,
    leg_indices,
    points_at,
    unit_vector,
    without_repeats,
    wrap,
)
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.infeasibility import FailedAttempt, beyond_reach, diagnose, shortfalls
from ccm_opt.ik.multiple_shooting import (
    ConfigurationNLP,
    build_configuration_nlp,
    pack_variables,
    solve_nlp,
    unpack_variables,
)
from ccm_opt.ik.spline_curve import CurveNumbers
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import EVEN_KNOTS, PIECES, SegmentType, curvature_spline, end_angle, piece_coefficients
from ccm_opt.scene.corridor import ConvexRegion

_POLISH_STEPS = 8
"""Maximum number of Newton steps that bring the tip onto the goal. Heuristic; three are usual."""

_PATH_SAMPLES = 401
"""Number of samples of the shortest path for which the region that contains them is determined. Heuristic."""


@dataclass(frozen=True)
class PathProfile:
    """Shortest path of a route as a polyline with unwrapped headings, in units of the arm's length from the base.

    Attributes:
        points: vertices of the path, shape (k, 2).
        arcs: length of the path up to each vertex, shape (k,).
        directions: unwrapped heading of each leg, shape (k - 1,) [rad].
        base_heading: heading of the arm at its base [rad].
        tip_heading: heading of the arm at its tip, whole turns included [rad].
    """

    points: FloatArray
    arcs: FloatArray
    directions: FloatArray
    base_heading: float
    tip_heading: float

    @property
    def end_turns(self) -> float:
        """Sum of the absolute turns from the base heading to the path and from the path to the tip heading [rad]."""
        return abs(float(self.directions[0]) - self.base_heading) + abs(self.tip_heading - float(self.directions[-1]))

    def direction_at(self, length: FloatArray) -> FloatArray:
        """Return the unwrapped heading of the path at given lengths along the path, shape (m,) [rad]."""
        return self.directions[leg_indices(self.arcs, length)]

    def point_at(self, length: FloatArray) -> FloatArray:
        """Return the points of the path at given lengths along it, shape (m, 2); both are in arm lengths."""
        return points_at(self.points, self.arcs, length)


def path_profile(task: ConfigurationTask, base_turns: int = 0, tip_turns: int = 0) -> PathProfile:
    """Return the shortest path of a task's route, with headings unwrapped from base to tip.

    Args:
        task: the task, whose corridor holds the route.
        base_turns: number of whole turns added between the base heading and the path.
        tip_turns: number of whole turns added between the path and the goal heading.
    """
    points = _taut_points(task)
    directions = leg_headings(points)
    low, high = task.base_heading_range
    middle = 0.5 * (low + high)
    base_heading = float(np.clip(middle + wrap(float(directions[0]) - middle), low, high))
    first = base_heading + wrap(float(directions[0]) - base_heading) + WHOLE_TURN * base_turns
    # All headings are shifted together, so that turns along the path stay the same.
    directions += first - directions[0]
    tip = float(directions[-1])
    if task.goal_heading is not None:
        tip += wrap(task.goal_heading - tip) + WHOLE_TURN * tip_turns
    return PathProfile(points, arc_lengths(points), directions, base_heading, tip)


def region_crossings(profile: PathProfile, task: ConfigurationTask) -> FloatArray:
    """Return the lengths along a route's shortest path at which it changes region, shape (regions + 1,).

    The first entry is 0 and the last the length of the path, in units of the arm's length. Where two regions overlap,
    the change is in the middle of the overlap.
    """
    t = np.linspace(0.0, profile.arcs[-1], _PATH_SAMPLES)
    world = profile.point_at(t) * task.length + task.base
    inside = [np.all(world @ region.normals.T <= region.offsets + 1e-9, axis=1) for region in task.corridor.regions]
    crossings = [0.0]
    for here, there in pairwise(inside):
        # Two regions overlap along a stretch of the path: the path changes region in its middle.
        both = t[here & there & (t >= crossings[-1])]
        crossings.append(float(both.mean()) if len(both) else crossings[-1])
    return np.append(crossings, profile.arcs[-1])


def _taut_points(task: ConfigurationTask) -> FloatArray:
    """Return the vertices of the shortest path from base to goal, in arm lengths from the base, shape (k, 2).

    Repeated points are removed; at least two points remain.
    """
    points = (np.vstack((task.base, task.corridor.route.taut[1:-1], task.goal)) - task.base) / task.length
    points = without_repeats(points, 1e-6)
    return points if len(points) > 1 else np.vstack((points, points[0] + np.array([1e-3, 0.0])))


_SEGMENT_TOTALS = (4, 6, 8)
"""Total numbers of segments in the attempts after the first. Heuristic."""
_WINDINGS = 3
"""Number of combinations of whole turns at base and tip that are tried, the least total turn first. Heuristic."""
_GUESS_SAMPLES = 401
"""Number of samples of the guessed heading. Heuristic."""
_CORNER_ROUNDING = 0.06
"""Width over which corners of the guessed heading are rounded [arm lengths]. Heuristic."""
_END_BLEND = 0.12
"""Arc length over which the guess turns from the base heading to that of the path, and from the path to the tip heading
[arm lengths]. Heuristic."""
_LEAST_REGION_SHARE = 0.05
"""Minimum length of the guess in each region [arm lengths]. Heuristic."""
_GUESS_CURVATURE = 0.9
"""Fraction of the curvature limit that the guess may use, so that the NLP starts inside its bounds. Heuristic."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Gauss-Legendre nodes and weights of one spline piece."""


def polished_configuration(nlp: ConfigurationNLP, variables: FloatArray) -> Configuration:
    """Return the curve of an NLP solution, corrected to exact tip position, tip heading and length.

    Args:
        nlp: the NLP that was solved.
        variables: solution of the NLP, shape (variables,).

    Returns:
        The curve in metres; if the task needs a straight stub at the base, the stub is the first segment.
    """
    task = nlp.task
    states, controls = unpack_variables(variables)
    widths = controls[:, 4:8] * (task.length - task.stub) / controls[:, 4:8].sum()
    values = np.append(states[0, 3], controls[:, :4]) / task.length
    heading, values = _newton(nlp, widths, float(states[0, 2]), values)
    arcs = np.append(0.0, np.cumsum(widths))
    lengths, of_segments, knots = CurveNumbers(arcs, values[None], np.array([heading])).parts()
    curvatures = [each[:, 0] for each in of_segments]
    if task.stub > 0.0:
        lengths = [task.stub, *lengths]
        curvatures = [np.zeros(5), *curvatures]
        knots = [EVEN_KNOTS, *knots]
    return Configuration.chain(task.base, heading, lengths, curvatures, knots)


def heading_basis(widths: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the linear map from the 4 K + 1 knot curvatures of K segments to their headings, θ = θ_0 + rows @ values.

    Args:
        widths: arc lengths between knots, shape (K, 4) [m].

    Returns:
        The rows at quadrature nodes (nodes, 4 K + 1) [m]; the weights of the nodes (nodes,) [m], with ∫ f ds = weights
        @ f(nodes); and the row at the end of the last segment (4 K + 1,) [m].
    """
    breaks = np.append(0.0, np.cumsum(widths))
    coefficients = np.zeros((widths.size, PIECES, widths.size + 1))
    for k, row in enumerate(widths):
        own = slice(PIECES * k, PIECES * k + PIECES)
        coefficients[own, :, PIECES * k : PIECES * k + PIECES + 1] = piece_coefficients(row, np.eye(5))
    turns = curvature_spline(coefficients, breaks).antiderivative()
    half = 0.5 * widths.reshape(-1, 1)
    nodes = (breaks[:-1, None] + half * (_NODES + 1.0)).ravel()
    return turns(nodes), (half * _WEIGHTS).ravel(), turns(breaks[-1])


def _newton(nlp: ConfigurationNLP, widths: FloatArray, heading: float, values: FloatArray) -> tuple[float, FloatArray]:
    """Return the base heading and curvatures nearest to given ones that put the tip exactly on the goal.

    Each Newton step is the least-norm solution of the linearised tip equations, with curvatures in units of the arm.

    Args:
        nlp: the NLP, for its task and tip heading.
        widths: arc lengths between knots, shape (K, 4) [m].
        heading: initial base heading [rad].
        values: initial curvatures at the knots, shape (4 K + 1,) [1/m].
    """
    task = nlp.task
    basis = heading_basis(widths)

    # A fixed base keeps its heading; after a straight stub the curvature starts at zero.
    free = np.append(nlp.upper[2] > nlp.lower[2], np.full(len(values), fill_value=True))
    free[1] = task.stub == 0.0
    scale = np.append(1.0, np.full(len(values), 1.0 / task.length))[free]

    unknowns = np.append(heading, values)
    for _ in range(_POLISH_STEPS):
        residual, jacobian = _tip_equations(nlp, basis, unknowns)
        if np.abs(residual).max() < 1e-13 * task.length:
            break
        # The least step that solves the linearised equations, in scaled unknowns.
        step = np.linalg.lstsq(jacobian[:, free] * scale, -residual, rcond=1e-12)[0]
        unknowns[free] += scale * step
    low, high = task.base_heading_range
    return float(np.clip(unknowns[0], low, high)), unknowns[1:]


def _tip_equations(
    nlp: ConfigurationNLP, basis: tuple[FloatArray, FloatArray, FloatArray], unknowns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residual of the tip equations and its Jacobian with respect to base heading and curvatures.

    The residual is tip position minus goal [m] and, if the NLP prescribes a tip heading, tip heading minus that [rad].

    Args:
        nlp: the NLP, for its task and tip heading.
        basis: result of ``heading_basis``.
        unknowns: base heading [rad] and curvatures at the knots [1/m], shape (4 K + 2,).
    """
    task = nlp.task
    rows, weights, tip = basis
    theta = unknowns[0] + rows @ unknowns[1:]
    cosine = np.cos(theta)
    sine = np.sin(theta)
    stub = task.stub * unit_vector(unknowns[0])
    position = stub + np.array([weights @ cosine, weights @ sine])
    inner = np.stack((-(weights * sine) @ rows, (weights * cosine) @ rows))
    # Turning the base turns the whole arm about it.
    turning = np.array([-position[1], position[0]])
    residual = position - (task.goal - task.base)
    jacobian = np.column_stack((turning, inner))
    if nlp.tip_heading is None:
        return residual, jacobian
    miss = unknowns[0] + tip @ unknowns[1:] - nlp.tip_heading
    return np.append(residual, miss), np.vstack((jacobian, np.append(1.0, tip)))


def initial_guess(nlp: ConfigurationNLP, profile: PathProfile, bulge: int = 1) -> FloatArray:
    """Return start values of an NLP's variables, shape (variables,): a smooth curve of the arm's length along a path.

    Args:
        nlp: the NLP.
        profile: the path with its headings.
        bulge: +1 puts the bumps that take up surplus length on the side of each region with more space, -1 on the
            other side.
    """
    task = nlp.task
    crossings = region_crossings(profile, task)
    lengths = curve_shares(task, profile, crossings)
    edges = np.append(0.0, np.cumsum(lengths))
    s = np.linspace(0.0, 1.0, _GUESS_SAMPLES)
    heading = profile.direction_at(np.interp(s, edges, crossings))
    amplitudes, waves = _swings(nlp, profile, bulge, crossings, lengths)
    region = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, len(lengths) - 1)
    heading += amplitudes[region] * np.sin(2.0 * np.pi * waves[region] * (s - edges[region]) / lengths[region])

    # The ends are blended to the required headings, and the corners rounded.
    heading += (profile.base_heading - heading[0]) * np.clip(1.0 - s / _END_BLEND, 0.0, 1.0)
    heading += (profile.tip_heading - heading[-1]) * np.clip(1.0 - (1.0 - s) / _END_BLEND, 0.0, 1.0)
    smooth = gaussian_filter1d(heading, _CORNER_ROUNDING * len(s), mode="nearest")

    # The segments of a region share its length evenly.
    counts = np.bincount(nlp.regions, minlength=len(lengths))
    boundaries = np.append(0.0, np.cumsum(np.repeat(lengths / counts, counts)))
    return _sample(nlp, profile, s, smooth, boundaries)


def _swings(
    nlp: ConfigurationNLP, profile: PathProfile, bulge: int, crossings: FloatArray, lengths: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the oscillation of the heading in each region that takes up the curve's surplus length.

    Args:
        nlp: the NLP, for its task and the regions of its segments.
        profile: the path with its headings.
        bulge: side of the bumps, as in ``initial_guess``.
        crossings: lengths along the path at which it changes region, shape (regions + 1,).
        lengths: length of the curve in each region, shape (regions,).

    Returns:
        The amplitude of the heading [rad], positive if the first bump is to the left, and the number of bumps, each of
        shape (regions,).
    """
    task = nlp.task
    regions = task.corridor.regions
    taut = np.diff(crossings)

    # The swing takes up each region's surplus length, on the side with more space at the middle of its stretch.
    swings = [end_angle(SegmentType.LEFT_RIGHT, min(1.0, t / length)) for t, length in zip(taut, lengths, strict=True)]
    amplitudes = np.array(swings)
    middle = crossings[:-1] + 0.5 * taut
    points = profile.point_at(middle) * task.length + task.base
    across = profile.direction_at(middle) + 0.5 * np.pi
    reaches = [_reaches(region, *rest) for region, *rest in zip(regions, points, across, strict=True)]
    left, right = np.array(reaches).T / task.length
    sides = np.where(left >= right, 1, -1) * bulge

    # As few bumps as fit that space; at most one per segment, and no more than the curvature allows.
    rise = 0.5 * lengths * struve(0, amplitudes)
    fitting = np.ceil(rise / np.maximum(np.where(sides > 0, left, right), 1e-3))
    segments = np.bincount(nlp.regions, minlength=len(regions))
    bendable = task.curvature_limit * task.length * lengths / (2.0 * np.pi * np.maximum(amplitudes, 1e-9))
    most = np.floor(np.minimum(segments, bendable))
    return sides * amplitudes, np.clip(fitting, 1, np.maximum(most, 1))


def curve_shares(task: ConfigurationTask, profile: PathProfile, crossings: FloatArray) -> FloatArray:
    """Return the fraction of the arm's length that the initial guess has in each region, shape (regions,).

    A region gets the length of the path inside, and a part of the surplus length proportional to its squared area.

    Args:
        task: the task, for the regions.
        profile: the path.
        crossings: lengths along the path at which it changes region, shape (regions + 1,).
    """
    regions = task.corridor.regions
    taut = np.diff(crossings)
    areas = np.array([shapely.Polygon(region.vertices).area for region in regions])
    lengths = taut + max(0.0, 1.0 - float(profile.arcs[-1])) * areas**2 / (areas**2).sum()
    lengths = np.maximum(lengths, min(_LEAST_REGION_SHARE, 0.5 / len(regions)))
    shares: FloatArray = lengths / lengths.sum()
    return shares


def _reaches(region: ConvexRegion, point: FloatArray, across: float) -> tuple[float, float]:
    """Return the distances [m] from a point to the edge of a convex region, in a direction and in the opposite one.

    Args:
        region: the region; infinite distances are returned where it is unbounded.
        point: a point inside, shape (2,) [m].
        across: heading of the direction [rad].
    """
    slack = region.offsets - region.normals @ point
    rate = region.normals @ unit_vector(across)
    ahead = rate > 1e-9
    behind = rate < -1e-9
    return (
        float((slack[ahead] / rate[ahead]).min(initial=np.inf)),
        float((slack[behind] / -rate[behind]).min(initial=np.inf)),
    )


def _sample(
    nlp: ConfigurationNLP, profile: PathProfile, s: FloatArray, heading: FloatArray, boundaries: FloatArray
) -> FloatArray:
    """Return an NLP's variables (states at segment boundaries, and controls) for a sampled heading profile.

    Positions are sheared so that the curve ends at the goal.

    Args:
        nlp: the NLP, for its bounds.
        profile: the path, for the goal.
        s: arc lengths of the samples, from 0 to 1, shape (N,).
        heading: heading at the samples, shape (N,) [rad].
        boundaries: arc lengths of the segment boundaries, shape (K + 1,).
    """
    # Trapezium rule, then a shear: the tip's error is spread evenly over the arm's length.
    tangents = unit_vector(heading)
    steps = 0.5 * np.diff(s)[:, None] * (tangents[1:] + tangents[:-1])
    points = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    points += s[:, None] * (profile.points[-1] - points[-1])

    limit = _GUESS_CURVATURE * nlp.task.curvature_limit * nlp.task.length
    curvature = np.clip(np.gradient(heading, s), -limit, limit)
    knots = boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0.0, 1.0, PIECES + 1)
    values = np.interp(knots, s, curvature)
    # The bounds on |κ| start slightly above the curvatures, so that their rows hold.
    bounds = np.minimum(1.1 * np.maximum(np.abs(values[:, 1:]), np.abs(values[:, :-1])) + 0.1, limit)
    controls = np.hstack((values[:, 1:], np.diff(knots, axis=1), bounds))
    at = [np.interp(boundaries, s, column) for column in (*points.T, heading, curvature)]
    guess = pack_variables(np.column_stack((*at, boundaries)), controls)
    return np.clip(guess, nlp.lower, nlp.upper)


def find_configuration(task: ConfigurationTask, most_attempts: int | None = None) -> Configuration:
    """Return a planar curve that reaches a task's goal inside its corridor, within the curvature limit.

    NLPs are solved from several guesses: first with one curvature segment per region and the fewest whole turns at the
    ends, then with the surplus length on the other side, with other numbers of whole turns, and with more segments.
    Every solution is corrected to the exact goal and densely checked.

    Args:
        task: the task.
        most_attempts: maximum number of attempts; all by default, at most ten. Most tasks need one.

    Returns:
        A checked curve: tip within 1e-5 m of the goal, curvature within the limit, inside the corridor.

    Raises:
        ConfigurationNotFound: no attempt passed; the diagnosis names the NLP constraint that could not be satisfied.
    """
    if (obstacle := beyond_reach(task)) is not None:
        raise ConfigurationNotFound(obstacle)
    failures: list[FailedAttempt] = []
    for regions, profile, bulge in islice(attempts(task), most_attempts):
        outcome = attempt(task, regions, profile, bulge)
        if isinstance(outcome, Configuration):
            return outcome
        failures.append(outcome)
    raise ConfigurationNotFound(diagnose(task, failures))


def attempt(
    task: ConfigurationTask, regions: tuple[int, ...], profile: PathProfile, bulge: int
) -> Configuration | FailedAttempt:
    """Solve one NLP from one initial guess; return its checked curve, or a ``FailedAttempt`` with the reasons.

    Args:
        task: the task to be solved.
        regions: index of the region in which each curvature segment must stay.
        profile: the path with its headings, whole turns included.
        bulge: side of the bumps that take up surplus length, as in ``initial_guess``.
    """
    tip_heading = None if task.goal_heading is None else profile.tip_heading
    nlp = build_configuration_nlp(task, regions, tip_heading)
    result = solve_nlp(nlp, initial_guess(nlp, profile, bulge))
    if result.broken:
        return FailedAttempt(nlp, result)
    configuration = polished_configuration(nlp, result.variables)
    missed = shortfalls(nlp, configuration)
    return FailedAttempt(nlp, result, missed) if missed else configuration


def attempts(task: ConfigurationTask) -> Iterator[tuple[tuple[int, ...], PathProfile, int]]:
    """Yield the arguments ``regions``, ``profile`` and ``bulge`` of every attempt, the most promising first."""
    profiles = winding_profiles(task)
    first, *others = segment_regions(task, profiles[0])
    # Most tasks need only the first guess; more segments cost more than another side or winding.
    yield first, profiles[0], 1
    yield first, profiles[0], -1
    for profile in profiles[1:]:
        yield first, profile, 1
    for regions in others:
        yield regions, profiles[0], 1
        yield regions, profiles[0], -1


def winding_profiles(task: ConfigurationTask) -> list[PathProfile]:
    """Return versions of the shortest path that differ by whole turns at its ends, the least total turn first."""
    low, high = task.base_heading_range
    # A freely turning base takes the path's heading; a fixed one may have to wind around to it.
    base = (0, 1, -1) if high - low < WHOLE_TURN else (0,)
    tip = (0,) if task.goal_heading is None else (0, 1, -1)
    profiles = [path_profile(task, *turns) for turns in product(base, tip)]
    return sorted(profiles, key=lambda profile: profile.end_turns)[:_WINDINGS]


def segment_regions(task: ConfigurationTask, profile: PathProfile) -> list[tuple[int, ...]]:
    """Return assignments of curvature segments to regions, each the index of the region of every segment.

    The first has one segment per region; later ones have more, in proportion to the length of the curve in a region.
    """
    count = len(task.corridor.regions)
    shares = np.ones(count, dtype=np.intp)
    plans = [shares.copy()]
    lengths = curve_shares(task, profile, region_crossings(profile, task))
    for total in _SEGMENT_TOTALS:
        while shares.sum() < total:
            shares[np.argmax(lengths / shares)] += 1  # one more for the region with the longest segments
        if shares.sum() > plans[-1].sum():
            plans.append(shares.copy())
    return [tuple(np.repeat(np.arange(count), plan).tolist()) for plan in plans]
