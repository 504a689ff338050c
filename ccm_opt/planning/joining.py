"""Certified paths between the goals of a tour, along certified motions that are known and shortened by straight ones.

A chain of configurations leads from one goal to another over motions that are certified already, backwards and
forwards. Of the straight motions between two configurations of the chain, those that save most time are tried first;
the first one with a certificate replaces what it cuts off, as often as that helps. Then a spline near the chain is
certified.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.limits.motion_certificate import IntervalCertificate
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.planner import MotionPlanner, with_clamped_base
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.spline_path import certified_spare, certified_spline
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.planning.tool_problem import own_coordinates, path_without_tool_links, problem_with_tool_links
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
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
        return SurfaceTree.from_triangles(problem_with_tool_links(self.problem).workspace.triangle_soup)

    def path(self, chain: FloatArray) -> JointPath | None:
        """Return a certified path with the ends of a chain, along the chain or shorter, or None.

        Args:
            chain: configurations along certified motions, shape (K ≥ 2, c) [rad, m].
        """
        arm = self.problem.arm
        start, goal = (JointPose.from_configuration(q, arm.coordinates) for q in chain[[0, -1]])
        problem = problem_with_tool_links(replace(self.problem, start=start, goal=goal, stops=()))
        whole = problem.arm
        chain, pace = _with_bodies(chain, whole, 0.0), _with_bodies(self.pace, whole, 1.0)
        if arm.dimension == 2:
            with planning_units(problem) as units:
                scaled = units.scaled(problem)
                metres = np.ones(len(pace))
                metres[whole.coordinates.base] = units.metres
                ends = resolve_ends(scaled)
                task = MotionPlanner().task_without_routes(scaled, ends, _NO_DEADLINE)
                rows = _shortened(chain / metres, task.certificate, pace / metres)
                found = None if rows is None else _smooth(rows, task.certificate)
                if found is None:
                    return None
                keyframes, spline, curves = task.keyframes_along(found.keyframes, found.spline, legs=False)
                found = replace(found, keyframes=keyframes, spline=spline, curves=curves)
                found = units.path_in_metres(found, whole)
        else:
            certificate = self._certificate(problem)
            rows = _shortened(chain, certificate, pace)
            found = None if rows is None else _smooth(rows, certificate)
            if found is None:
                return None
        # Units round lengths; the next leg begins exactly where this one ends.
        found.spline.c[[0, -1]] = chain[[0, -1]]
        return found if whole is arm else path_without_tool_links(found, arm, whole)

    def _certificate(self, problem: Problem) -> IntervalCertificate:
        """Return the certificate of motions in space between the start and the goal of a problem."""
        if problem.arm.carrier:
            return SpaceCertificate(problem.arm, self._tree, problem.workspace.clearance)
        problem = with_clamped_base(problem, self._tree)
        return space_task(problem, self._tree, _NO_DEADLINE, SpaceMotionSettings()).certificate


def _with_bodies(values: FloatArray, whole: Arm, still: float) -> FloatArray:
    """Return values of an arm's coordinates, shape (..., c), with those of the joints of its bodies as links.

    Args:
        values: values of the arm's own coordinates.
        whole: the arm with its bodies as links.
        still: value of a coordinate that never changes.
    """
    own = own_coordinates(whole)
    found = np.full((*values.shape[:-1], len(own)), still)
    found[..., own] = values
    return found


def chain_time(chain: FloatArray, pace: FloatArray) -> FloatArray:
    """Return the least time until each configuration of a chain at given rates, shape (K,) [s].

    Args:
        chain: configurations, shape (K, c) [rad, m].
        pace: fastest rates of the coordinates, shape (c,) [rad/s, m/s].
    """
    return np.append(0.0, np.cumsum(np.max(np.abs(np.diff(chain, axis=0)) / pace, axis=1)))


def _evenly(chain: FloatArray, pace: FloatArray, count: int) -> FloatArray:
    """Return configurations of a chain between which the same time passes, shape (count + 1, c)."""
    time = chain_time(chain, pace)
    moving = np.append(True, np.diff(time) > 0.0)
    at = np.linspace(0.0, time[-1], count + 1)
    even = np.column_stack([np.interp(at, time[moving], column) for column in chain[moving].T])
    even[[0, -1]] = chain[[0, -1]]
    return even


def _shortened(chain: FloatArray, certificate: IntervalCertificate, pace: FloatArray) -> FloatArray | None:
    """Return a certified chain with the same ends in which straight motions replace parts, or None.

    None means that the given chain cannot be certified.
    """
    if len(certificate.failures(chain[[0, -1]])) == 0:
        return _evenly(chain[[0, -1]], pace, 4)
    even = _evenly(chain, pace, _ROWS)
    for _ in range(_HALVINGS):
        failing = certificate.failures(even)
        if len(failing) == 0:
            break
        even = _evenly(chain, pace, 2 * (len(even) - 1))
    else:
        return None
    for _ in range(_CUTS):
        cut = _cut(even, certificate, pace)
        if cut is None:
            break
        even = cut
    return even


def _cut(chain: FloatArray, certificate: IntervalCertificate, pace: FloatArray) -> FloatArray | None:
    """Return a certified chain with the straight motion that saves most time of those that are certified, or None."""
    time = chain_time(chain, pace)
    straight = np.max(np.abs(chain[:, None] - chain[None]) / pace, axis=2)
    saved = time[None, :] - time[:, None] - straight
    for first, last in itertools.islice(_spread(np.triu(saved, 2), _SAVED * float(time[-1])), _TRIES):
        if len(certificate.failures(chain[[first, last]])) == 0:
            count = max(2, round(_ROWS * float(straight[first, last] / time[-1])))
            steps = np.linspace(0.0, 1.0, count + 1)[1:-1, None]
            between = chain[first] + steps * (chain[last] - chain[first])
            return np.vstack((chain[: first + 1], between, chain[last:]))
    return None


def _spread(saved: FloatArray, least: float) -> Iterator[tuple[int, int]]:
    """Yield pairs of indices, the one that saves most first, of which no two differ little, from a matrix (K, K)."""
    left = np.where(saved >= least, saved, 0.0)
    while np.any(left):
        first, last = np.unravel_index(int(np.argmax(left)), left.shape)
        yield int(first), int(last)
        left[max(first - _APART, 0) : first + _APART + 1, max(last - _APART, 0) : last + _APART + 1] = 0.0


def _smooth(chain: FloatArray, certificate: IntervalCertificate) -> JointPath | None:
    """Return the certified spline path near a certified chain, or None."""
    spline = certified_spline(chain, certificate)
    if spline is None:
        return None
    return JointPath(spline, chain, (), "joined", spare=certified_spare(spline, certificate))
