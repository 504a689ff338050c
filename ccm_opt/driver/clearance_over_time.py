"""Measurement of the clearance of a motion over time.

Clearances are recorded at a subset of the motion's samples. The minimum clearance, taken from the verifier's checks,
covers all times, with linear interpolation of the joint angles between samples.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.polyline import points_at
from ccm_opt.planning.ends import GapsAtSamples
from ccm_opt.planning.tool_problem import motion_with_tool_links, problem_with_tool_links
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, ClearanceRecord, JointTrajectory, NearPlace, ShortStretch
from ccm_opt.problem.solution.records import ShortCause
from ccm_opt.verification.chain_motion import ChainMotion, chain_points
from ccm_opt.verification.selfcollision import check_self_collision, distant_pairs, link_gaps
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import check_walls


@dataclass(frozen=True)
class ClearanceSettings:
    """Settings for the record of a motion's clearance; no check depends on them.

    Attributes:
        samples: maximum number of samples at which clearance is recorded, besides start, goal and stops of the motion.
            The minimum clearance of the motion does not depend on this number. Heuristic: more than a chart shows.
        enough: fraction of the preferred clearance below which a shortfall is recorded. Heuristic: planning keeps the
            preferred clearance by soft constraints, which may be violated a little.
        reach: search distance, at which recorded clearances are capped, as a fraction of the arm's length. Heuristic:
            several times the default preferred clearance.
        reach_wanted: alternative search distance, as a multiple of the preferred clearance; the larger of the two
            search distances applies. Heuristic.
    """

    samples: int = 240
    enough: float = 0.9
    reach: float = 0.05
    reach_wanted: float = 4.0


DEFAULT_CLEARANCE = ClearanceSettings()
"""Default settings for the record of a motion's clearance."""


@dataclass(frozen=True)
class _GapsAtSamples:
    """The nearest pair of bodies at each of N samples; all arrays have shape (N,).

    Attributes:
        gap: clearance of the pair [m]; the search distance where no pair is within it.
        wanted: preferred clearance of the pair [m].
        link: number of the link, from 1; 0 where no pair is within the search distance.
        second_link: number of the second link, from 1; 0 where the other body is an obstacle, or there is no pair.
        obstacle: name of the obstacle; empty where there is none.
    """

    gap: FloatArray
    wanted: FloatArray
    link: IntArray
    second_link: IntArray
    obstacle: npt.NDArray[np.object_]

    @property
    def shortfall(self) -> FloatArray:
        """Shortfall from the preferred clearance at each sample, shape (N,) [m]; negative where clearance is larger."""
        return self.wanted - self.gap

    def where(self, choose: BoolArray, other: "_GapsAtSamples") -> "_GapsAtSamples":
        """Return the pairs of this object where a mask of shape (N,) is True, and those of another object elsewhere."""
        return _GapsAtSamples(
            *(np.where(choose, mine, theirs) for mine, theirs in zip(*map(_columns, (self, other)), strict=True))
        )


def _columns(gaps: _GapsAtSamples) -> tuple[np.ndarray, ...]:
    return gaps.gap, gaps.wanted, gaps.link, gaps.second_link, gaps.obstacle


def clearance_over_time(
    problem: Problem,
    trajectory: JointTrajectory,
    wanted: float,
    checks: Sequence[Check] | None = None,
    settings: ClearanceSettings = DEFAULT_CLEARANCE,
    verification: VerificationSettings = DEFAULT_VERIFICATION,
) -> ClearanceRecord:
    """Return the clearance of a motion over time.

    Args:
        problem: the problem as posed.
        trajectory: the motion, which passes the verifier.
        wanted: the preferred clearance beyond the required clearance [m]; 0 if there is none.
        checks: verifier's checks, which hold the minimum clearances; None to compute them here.
        settings: samples, search distance, and fraction of the preferred clearance that counts as enough.
        verification: settings of the verifier, which give the resolution of minimum clearances.

    Returns:
        The clearance, without the upper bound for any motion and without the price of the preferred clearance.
    """
    verification = verification.for_problem(problem)
    if problem.arm.rigid_bodies:
        whole = problem_with_tool_links(problem)
        trajectory = motion_with_tool_links(trajectory, whole.arm)
        problem = whole
    if checks is None:
        motion = ChainMotion(problem.arm, trajectory.time, trajectory.positions)
        computed = [check_walls(motion, problem.workspace, verification)]
        if problem.arm.self_collision:
            computed.append(check_self_collision(motion, verification))
        checks = computed
    return _Room(problem, trajectory, wanted, tuple(checks), settings, verification).record()


@dataclass(frozen=True)
class _Room:
    """Measurement of the clearance of one motion; attributes are the arguments of ``clearance_over_time``."""

    problem: Problem
    trajectory: JointTrajectory
    wanted: float
    checks: tuple[Check, ...]
    settings: ClearanceSettings
    verification: VerificationSettings

    @property
    def _motion(self) -> ChainMotion:
        return ChainMotion(self.problem.arm, self.trajectory.time, self.trajectory.positions)

    @cached_property
    def _samples(self) -> IntArray:
        """Indices of the recorded samples, evenly spread over time and including all samples at which the arm rests."""
        time = self.trajectory.time
        spread = np.searchsorted(time, np.linspace(0.0, time[-1], self.settings.samples))
        return np.unique([0, *np.minimum(spread, len(time) - 1), *self.trajectory.stops, len(time) - 1])

    @property
    def _reach(self) -> float:
        return max(self.settings.reach * self.problem.arm.length, self.settings.reach_wanted * self.wanted)

    def record(self) -> ClearanceRecord:
        """Return the clearance of the motion over time."""
        motion = self._motion
        samples = self._samples
        poses = motion.points[samples]
        to_walls = self._wall_gaps(poses)
        to_itself, itself_lacks = self._self_gaps(poses)
        # The nearest pair need not fall shortest of its preferred clearance: links close along the arm want smaller
        # gaps.
        nearest = to_walls.where(to_walls.gap <= to_itself.gap, to_itself)
        lacking = to_walls.where(to_walls.shortfall >= itself_lacks.shortfall, itself_lacks)
        rests = np.searchsorted(samples, [0, *self.trajectory.stops, len(motion.time) - 1]).tolist()
        return ClearanceRecord(
            time=self.trajectory.time[samples],
            wanted=self.wanted,
            clearance=self.problem.workspace.clearance,
            wall_gaps=to_walls.gap,
            self_gaps=to_itself.gap,
            reach=self._reach,
            nearest=self._nearest(nearest),
            ends=tuple(self._place(nearest, sample) for sample in rests),
            short=tuple(self._short(lacking, rests)),
        )

    def _wall_gaps(self, poses: FloatArray) -> _GapsAtSamples:
        """Return the nearest link and obstacle at every recorded sample.

        Args:
            poses: positions of joints and tip of n links at N samples, shape (N, n + 1, d) with d = 2 or 3 [m].
        """
        clearance = self.problem.workspace.clearance
        seen = GapsAtSamples.from_poses(self.problem, poses, self._reach + clearance, 0.0)
        near = seen.walls
        names = np.array([*seen.names, ""], dtype=np.object_)[near.other]
        wanted = np.full(len(poses), self.wanted)
        return _GapsAtSamples(near.gap - clearance, wanted, near.link, np.zeros_like(near.link), names)

    def _self_gaps(self, poses: FloatArray) -> tuple[_GapsAtSamples, _GapsAtSamples]:
        """Return for every recorded sample the nearest pair of links, and the pair with the largest shortfall.

        Args:
            poses: positions of joints and tip of n links at N samples, shape (N, n + 1, d) with d = 2 or 3 [m].
        """
        arm = self.problem.arm
        may_meet = arm.self_collision and len(distant_pairs(arm)[0]) > 0
        pairs, distance = link_gaps(arm, poses if may_meet else poses[:0], self._reach)
        wanted = arm.link_margins(pairs.link, pairs.other, self.wanted)

        def chosen(least: FloatArray) -> _GapsAtSamples:
            best = _first_per_node(pairs.interval, least, len(poses))
            nothing = np.full(len(poses), "", dtype=np.object_)
            return _GapsAtSamples(
                _filled(best, distance, self._reach),
                _filled(best, wanted, self.wanted),
                _numbered(best, pairs.link),
                _numbered(best, pairs.other),
                nothing,
            )

        nearest = chosen(distance)
        return nearest, chosen(distance - wanted) if self.wanted > 0.0 else nearest

    def _nearest(self, at_samples: _GapsAtSamples) -> NearPlace:
        """Return the minimum clearance over all times: at a recorded sample, or from a check if that is less."""
        known = [self._place(at_samples, int(np.argmin(at_samples.gap)))]
        for place in (check.place for check in self.checks if check.place is not None):
            wanted = self.wanted
            if place.second_link:
                wanted = self._wanted_pair_gap(place)
            known.append(replace(place, wanted=wanted))
        return min(known, key=lambda place: place.gap)

    def _wanted_pair_gap(self, place: NearPlace) -> float:
        """Return the preferred gap between the two links, or bodies on links, that are nearest at a place [m]."""
        arm = self.problem.arm
        if arm.tool_links is None:
            pair = np.array([place.link - 1]), np.array([place.second_link - 1])
            return float(arm.link_margins(*pair, self.wanted)[0])
        # The numbers of links do not tell their bodies apart.
        q = points_at(self.trajectory.positions, self.trajectory.time, place.time)
        return float(self._self_gaps(chain_points(arm, q[None]))[0].wanted[0])

    def _place(self, gaps: _GapsAtSamples, sample: int) -> NearPlace:
        """Return bodies, clearance and time of the nearest pair at one recorded sample."""
        arm = self.problem.arm
        number = arm.link_number
        first, second = int(gaps.link[sample]), int(gaps.second_link[sample])
        return NearPlace(
            float(gaps.gap[sample]),
            float(gaps.wanted[sample]),
            float(self.trajectory.time[self._samples[sample]]),
            number(first - 1) if first else 0,
            str(gaps.obstacle[sample]),
            number(second - 1) if second else 0,
            arm.link_name(first - 1) if first else "",
            arm.link_name(second - 1) if second else "",
        )

    def _short(self, gaps: _GapsAtSamples, rests: list[int]) -> Iterator[ShortStretch]:
        """Yield the time intervals in which clearance is below the preferred clearance, each with its cause.

        Args:
            gaps: the pair with the largest shortfall at each recorded sample.
            rests: positions, among the recorded samples, of those at which the arm rests.
        """
        few = gaps.shortfall > (1.0 - self.settings.enough) * self.wanted
        edges = np.flatnonzero(np.diff(np.concatenate(([False], few, [False])).astype(np.int8)))
        for first, end in edges.reshape(-1, 2):
            last = end - 1
            worst = first + int(np.argmax(gaps.shortfall[first:end]))
            cause = self._cause(gaps, rests, (int(first), int(last)), float(gaps.shortfall[worst]))
            yield ShortStretch(
                float(self.trajectory.time[self._samples[first]]),
                float(self.trajectory.time[self._samples[last]]),
                self._place(gaps, worst),
                cause,
            )

    def _cause(self, gaps: _GapsAtSamples, rests: list[int], stretch: tuple[int, int], shortfall: float) -> ShortCause:
        """Return the cause of a shortfall of clearance: "start", "stop", "goal", or "passage".

        A pose in which the arm rests is the cause if its shortfall is the largest of the interval.

        Args:
            gaps: the pair with the largest shortfall at each recorded sample.
            rests: positions, among the recorded samples, of those at which the arm rests.
            stretch: first and last recorded sample of the interval.
            shortfall: largest shortfall in the interval [m].
        """
        for number, sample in enumerate(rests):
            inside = stretch[0] <= sample <= stretch[1]
            if inside and gaps.shortfall[sample] >= shortfall - self.verification.report_resolution:
                if number == 0:
                    return "start"
                return "goal" if number == len(rests) - 1 else "stop"
        return "passage"


def _first_per_node(node: IntArray, least: FloatArray, count: int) -> IntArray:
    """Return for each of ``count`` groups the index of the item with the minimum value, or -1 for an empty group.

    Args:
        node: group of each item, shape (m,).
        least: value of each item, shape (m,).
        count: number of groups.
    """
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, node, least)
    lowest_items = np.flatnonzero(least == lowest[node])
    best = np.full(count, -1)
    best[node[lowest_items]] = lowest_items
    return best


def _filled(best: IntArray, values: FloatArray, otherwise: float) -> FloatArray:
    """Return the values at given indices, shape (N,), with a default value where the index is -1."""
    return np.append(values, otherwise)[best]


def _numbered(best: IntArray, numbers: IntArray) -> IntArray:
    """Return the numbers at given indices, increased by one, shape (N,); 0 where the index is -1."""
    counted: IntArray = np.append(numbers + 1, 0)[best]
    return counted
