"""Certified paths between the goals of a tour, along certified motions that are known and shortened by straight ones.

A chain of configurations leads from one goal to another over motions that are certified already, backwards and
forwards. Of the straight motions between two configurations of the chain, those that save most time are tried first;
the first one with a certificate replaces what it cuts off, as often as that helps. Then a spline near the chain is
certified. If possible, all of this keeps the chain's gap, up to the preferred one.
"""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import points_at
from ccm_opt.planning.clamped_base import with_clamped_base
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.leader import travel_between_samples
from ccm_opt.planning.limits.motion_certificate import IntervalCertificate
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.own_units import OwnUnits, planning_units
from ccm_opt.planning.plane_in_space import needs_space, path_in_plane, problem_in_space, rows_in_space
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.spline_path import certified_spare, certified_spline
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.planning.tool_problem import path_without_tool_links, problem_with_tool_links, with_bodies
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import HELD_TOLERANCE, Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_ROWS = 48
"""Least number of steps of a chain. Heuristic."""
_HALVINGS = 4
"""Maximum number of times that the steps of a chain are halved until they are certified. Heuristic."""
_CUTS = 6
"""Maximum number of straight motions that replace parts of a chain. Heuristic."""
_TRIES = 40
"""Number of straight motions that are tried for each of them. Heuristic."""
_SAVED = 0.02
"""Least time that a straight motion has to save, as a fraction of the chain's. Heuristic."""
_GAP_KEPT = 0.9
"""Fraction of the chain's gap, at most the preferred one, that a path has to keep if possible. Heuristic: a smooth path
deviates from the configurations of the chain."""
_FEED_STEP = 1.0 / 6.0
"""Travel of the base between two configurations of a chain, in link lengths. Heuristic."""
_MIXED = 2
"""Number of configurations on either side that a smooth path mixes with one, of which it is a control point. Derived:
four control points shape every span of a cubic spline."""
_LOOKS = 5
"""Number of samples per keyframe at which the clearance of a path is measured. Heuristic."""
_NO_DEADLINE = Deadline(np.inf, np.inf)
"""Deadline of certificates, which take no time limit."""
_APART = 2
"""Largest difference of both ends at which two straight motions count as the same try, in configurations. Heuristic."""


@dataclass(frozen=True, eq=False)
class PathJoiner:
    """Makes certified paths along chains of configurations of an arm.

    Attributes:
        problem: problem with the arm, its workspace and limits; start and goals do not matter.
        pace: fastest rates of the coordinates, shape (c,) [rad/s, m/s].
    """

    problem: Problem
    pace: FloatArray

    @cached_property
    def _tree(self) -> SurfaceTree:
        """Distance tree of the surfaces of a workspace in space."""
        return problem_with_tool_links(self.problem).workspace.surface_tree

    @cached_property
    def _in_space(self) -> "PathJoiner":
        """What does the same for a planar arm whose motions are planned in space."""
        links = self.problem.arm.links
        pace = np.concatenate((np.repeat(self.pace[:links], 2), self.pace[links:]))
        return PathJoiner(problem_in_space(replace(self.problem, goal=self.problem.start, stops=())), pace)

    def path(self, chain: FloatArray) -> JointPath | None:
        """Return a certified path with the ends of a chain, along the chain or shorter, or None.

        Between two configurations alone no motion is known: theirs is straight, and has to keep the gap of its ends.

        Args:
            chain: configurations along certified motions, shape (K ≥ 2, c) [rad, m].
        """
        arm = self.problem.arm
        if needs_space(arm):
            path = self._in_space.path(rows_in_space(chain, arm.links))
            return None if path is None else path_in_plane(path, arm)
        start, goal = (JointPose.from_configuration(q, arm.coordinates) for q in chain[[0, -1]])
        problem = problem_with_tool_links(replace(self.problem, start=start, goal=goal, stops=()))
        whole = problem.arm
        chain, pace = with_bodies(chain, whole, 0.0), with_bodies(self.pace, whole, 1.0)
        if arm.dimension == 2:
            with planning_units(problem) as units:
                scaled, metres = units.scaled(problem), _metres(units, whole)
                task = _planar_task(scaled)
                found = _shortest(_planar_certificates(task, chain / metres), pace / metres, scaled, chain / metres)
                if found is None:
                    return None
                keyframes, spline, curves = task.keyframes_along(found.keyframes, found.spline, legs=False)
                found = replace(found, keyframes=keyframes, spline=spline, curves=curves)
                found = units.path_in_metres(found, whole)
        else:
            found = _shortest(self._certificates(problem, chain), pace, problem, chain)
            if found is None:
                return None
        # Units round lengths; the next leg begins exactly where this one ends.
        found.spline.c[[0, -1]] = chain[[0, -1]]
        return found if whole is arm else path_without_tool_links(found, arm, whole)

    def joins(self, first: FloatArray, last: FloatArray) -> bool:
        """Return whether the straight motion between two configurations, each of shape (c,), has a certificate."""
        chain = np.stack((first, last))
        if self.problem.dimension == 2:
            return self.path(chain) is not None
        shortening = self._contact_shortening
        rows = shortening.straight(*with_bodies(chain, shortening.arm, 0.0))
        return len(shortening.failures(rows)) == 0

    @cached_property
    def _contact_shortening(self) -> "_Shortening":
        """Shortening of chains in space without regard to their gaps."""
        problem = problem_with_tool_links(replace(self.problem, goal=self.problem.start, stops=()))
        *_, certificate = self._certificates(problem, problem.start.configuration(problem.arm)[None])
        return _Shortening(certificate, with_bodies(self.pace, problem.arm, 1.0), _tube(problem))

    def lack(self, path: JointPath) -> FloatArray:
        """Return how much clearance a path lacks at samples, as fractions of the preferred one, shape (K,).

        Args:
            path: certified path of the problem's arm.
        """
        return self.lack_at(np.asarray(path.spline(np.linspace(0.0, 1.0, _LOOKS * len(path.keyframes) + 1))))

    def lack_at(self, rows: FloatArray) -> FloatArray:
        """Return how much clearance configurations (K, c) lack, as fractions of the preferred one, shape (K,)."""
        if self.problem.wanted_gap == 0.0:
            return np.zeros(len(rows))
        if needs_space(self.problem.arm):
            return self._in_space.lack_at(rows_in_space(rows, self.problem.arm.links))
        start = JointPose.from_configuration(rows[0], self.problem.arm.coordinates)
        problem = problem_with_tool_links(replace(self.problem, start=start, goal=start, stops=()))
        rows = with_bodies(rows, problem.arm, 0.0)
        if problem.dimension == 2:
            with planning_units(problem) as units:
                task: SearchTask = _planar_task(units.scaled(problem))
                rows = rows / _metres(units, problem.arm)
        else:
            task = space_task(problem, self._tree, _NO_DEADLINE, SpaceMotionSettings())
        return task.clearance_shortfall(rows) / task.wanted_gap

    def _certificates(self, problem: Problem, chain: FloatArray) -> Iterator[IntervalCertificate]:
        """Yield certificates of motions in space between the ends of a chain, that of the chain's own gap first."""
        if problem.arm.carrier:
            yield SpaceCertificate(problem.arm, self._tree, problem.workspace.clearance)
            return
        problem = with_clamped_base(problem, self._tree)
        task = space_task(problem, self._tree, _NO_DEADLINE, SpaceMotionSettings())
        yield replace(task, clearance=task.clearance + _kept_gap(task, chain)).certificate
        yield task.certificate


def _planar_task(scaled: Problem) -> MotionTask:
    """Return the search task of a planar problem in units of its arm."""
    return MotionPlanner().task_without_routes(scaled, resolve_ends(scaled), _NO_DEADLINE)


def _metres(units: OwnUnits, arm: Arm) -> FloatArray:
    """Return the unit of each coordinate of an arm in units of its own, shape (c,) [m, rad]."""
    metres = np.ones(len(arm.coordinates))
    metres[arm.coordinates.base] = units.metres
    return metres


def _planar_certificates(task: MotionTask, chain: FloatArray) -> Iterator[IntervalCertificate]:
    """Yield certificates of motions in the plane, that of a chain's own gap first."""
    yield task.certificate_with(_kept_gap(task, chain))
    yield task.certificate


def _kept_gap(task: SearchTask, chain: FloatArray) -> float:
    """Return the gap beyond contact that paths along a chain, (K, c), keep if possible, at least 0 [m]."""
    return _GAP_KEPT * max(task.least_gap(chain), 0.0)


def _shortest(
    certificates: Iterable[IntervalCertificate], pace: FloatArray, problem: Problem, chain: FloatArray
) -> JointPath | None:
    """Return the path along a chain, (K, c), by the first certificate that admits one, or None."""
    if len(chain) == 2:
        certificates = itertools.islice(certificates, 1)
    paths = (_Shortening(certificate, pace, _tube(problem)).path(chain) for certificate in certificates)
    return next((path for path in paths if path is not None), None)


def chain_time(chain: FloatArray, pace: FloatArray) -> FloatArray:
    """Return the least time until each configuration of a chain at given rates, shape (K,) [s].

    Args:
        chain: configurations, shape (K, c) [rad, m].
        pace: fastest rates of the coordinates, shape (c,) [rad/s, m/s].
    """
    return np.append(0.0, np.cumsum(np.max(np.abs(np.diff(chain, axis=0)) / pace, axis=1)))


def _tube(problem: Problem) -> "Tube | None":
    """Return the guide tube of a problem's arm; None if there is none."""
    fed = problem.arm.feed is not None
    return Tube(problem.arm, travel_between_samples(problem.arm, problem.limits)) if fed else None


@dataclass(frozen=True, eq=False)
class Tube:
    """The guide tube of a fed arm, in which joints are straight.

    Attributes:
        arm: the arm.
        travel: travel of the base between two samples in time: no joint begins to bend nearer to the hole [m].
    """

    arm: Arm
    travel: float

    @property
    def step(self) -> float:
        """Largest travel of the base between two configurations of a chain [m]."""
        return _FEED_STEP * self.arm.link_length

    def beyond(self, q: FloatArray) -> FloatArray:
        """Return how far each coordinate of a bend is beyond the end of the tube, shape (..., bends) [m]."""
        places = np.repeat(self.arm.bending_places, self.arm.bends_a_joint)
        return np.asarray(q[..., -1:] + places - self.arm.hole)

    def bent_inside(self, q: FloatArray) -> BoolArray:
        """Return whether a joint bends inside the tube in an interval of a chain q, (K, c), shape (K − 1,)."""
        bent = q[:, :-1] != 0.0
        beyond = self.beyond(q)
        inside = (bent[1:] | bent[:-1]) & (np.minimum(beyond[1:], beyond[:-1]) < -HELD_TOLERANCE)
        # A joint that begins to bend is out by then, also halfway between two samples in time.
        begins = bent[1:] != bent[:-1]
        straight = np.where(bent[1:], beyond[:-1], beyond[1:])
        return np.asarray(np.any(inside | (begins & (straight < self.travel)), axis=1))

    def straightened(self, chain: FloatArray) -> FloatArray:
        """Return a chain without bends inside the tube, at its end, and at the configurations before and after."""
        held = np.pad(self.beyond(chain) < self.travel, ((_MIXED, _MIXED), (0, 0)))
        around = np.any([held[k : k + len(chain)] for k in range(2 * _MIXED + 1)], axis=0)
        found = chain.copy()
        found[1:-1, :-1][around[1:-1]] = 0.0
        return found

    def motion(self, first: FloatArray, last: FloatArray) -> FloatArray:
        """Return an even motion of base and joints of which joints bend once they are out of the tube, shape (m, c)."""
        share = np.linspace(0.0, 1.0, 2 + int(abs(last[-1] - first[-1]) / self.step))[:, None]
        rows = first + share * (last - first)
        ends = np.stack((first, last))
        beyond = self.beyond(ends)
        outer = np.argmax(beyond, axis=0)
        columns = np.arange(beyond.shape[1])
        reserve = self.travel + _MIXED * self.step
        far = beyond[outer, columns]
        crossing = (np.min(beyond, axis=0) < reserve) & (far > reserve)
        grown = (self.beyond(rows) - reserve) / np.where(crossing, far - reserve, 1.0)
        emerging = np.clip(grown, 0.0, 1.0) * ends[outer, columns]
        rows[:, :-1] = np.where(crossing, emerging, rows[:, :-1])
        rows[[0, -1]] = ends
        return rows


@dataclass(frozen=True, eq=False)
class _Shortening:
    """Shortening of chains by straight motions.

    Attributes:
        certificate: certificate of contact and limits.
        pace: fastest rates of the coordinates, shape (c,).
        tube: the guide tube; None for an arm without one.
    """

    certificate: IntervalCertificate
    pace: FloatArray
    tube: Tube | None

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.certificate.arm

    @property
    def spare(self) -> float:
        """Certified gap beyond contact [m]."""
        return self.certificate.spare

    def failures(self, q: FloatArray, /, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the intervals of a chain, (K, c), that are not certified."""
        failing = self.certificate.failures(q, depth)
        return failing if self.tube is None else np.union1d(failing, np.flatnonzero(self.tube.bent_inside(q)))

    def evenly(self, chain: FloatArray, count: int) -> FloatArray:
        """Return configurations of a chain between which the same time passes, at least ``count`` + 1, shape (m, c)."""
        if self.tube is not None:
            count = max(count, int(np.sum(np.abs(np.diff(chain[:, -1]))) / self.tube.step))
        time = chain_time(chain, self.pace)
        moving = np.append(True, np.diff(time) > 0.0)
        at = np.linspace(0.0, time[-1], count + 1)
        even = points_at(chain[moving], time[moving], at)
        even[[0, -1]] = chain[[0, -1]]
        return even if self.tube is None else self.tube.straightened(even)

    def straight(self, first: FloatArray, last: FloatArray) -> FloatArray:
        """Return an even motion between two configurations, with those at which joints leave the tube, shape (m, c)."""
        return np.stack((first, last)) if self.tube is None else self.tube.motion(first, last)

    def path(self, chain: FloatArray) -> JointPath | None:
        """Return a certified path with the ends of a chain in which straight motions replace parts, or None."""
        rows = self._shortened(chain)
        spline = None if rows is None else certified_spline(rows, self)
        if rows is None or spline is None:
            return None
        return JointPath(spline, rows, (), "joined", spare=certified_spare(spline, self))

    def _shortened(self, chain: FloatArray) -> FloatArray | None:
        """Return a certified chain with the same ends in which straight motions replace parts.

        The result is None if the given chain cannot be certified.
        """
        whole = self.straight(chain[0], chain[-1])
        if len(self.failures(whole)) == 0:
            return whole
        if len(chain) == 2:
            return None
        even = self.evenly(chain, _ROWS)
        for _ in range(_HALVINGS):
            if len(self.failures(even)) == 0:
                break
            even = self.evenly(chain, 2 * (len(even) - 1))
        else:
            return None
        for _ in range(_CUTS):
            cut = self._cut(even)
            if cut is None:
                break
            even = cut
        return even

    def _cut(self, chain: FloatArray) -> FloatArray | None:
        """Return a certified chain with the straight motion that saves most time, of those certified, or None."""
        time = chain_time(chain, self.pace)
        straight = np.max(np.abs(chain[:, None] - chain[None]) / self.pace, axis=2)
        saved = time[None, :] - time[:, None] - straight
        for first, last in itertools.islice(_spread(np.triu(saved, 2), _SAVED * float(time[-1])), _TRIES):
            rows = self.straight(chain[first], chain[last])
            if len(self.failures(rows)) == 0:
                if len(rows) == 2:
                    count = max(2, round(_ROWS * float(straight[first, last] / time[-1])))
                    rows = rows[0] + np.linspace(0.0, 1.0, count + 1)[:, None] * (rows[1] - rows[0])
                return np.vstack((chain[:first], rows, chain[last + 1 :]))
        return None


def _spread(saved: FloatArray, least: float) -> Iterator[tuple[int, int]]:
    """Yield pairs of indices, the one that saves most first, of which no two differ little, from a matrix (K, K)."""
    left = np.where(saved >= least, saved, 0.0)
    while np.any(left):
        first, last = np.unravel_index(int(np.argmax(left)), left.shape)
        yield int(first), int(last)
        left[max(first - _APART, 0) : first + _APART + 1, max(last - _APART, 0) : last + _APART + 1] = 0.0
