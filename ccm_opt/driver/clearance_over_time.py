"""The clearance that a motion keeps over time.

Gaps are recorded at a subset of the motion's samples. The least gap is the minimum over all times, with motion linear
between samples, as proved by the verifier's checks.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.planning.ends import GapsAtSamples
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, ClearanceRecord, JointTrajectory, NearPlace, ShortStretch
from ccm_opt.problem.solution.records import ShortCause
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.selfcollision import check_self_collision, first_distant, link_gaps
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import check_walls


@dataclass(frozen=True)
class ClearanceSettings:
    """Settings of the clearance record; no check depends on them.

    Attributes:
        samples: maximum number of samples of the motion whose gaps are recorded, not counting its ends and stops; the
            least gap does not depend on them. Taste: more than a chart shows.
        enough: fraction of the preferred clearance below which a motion counts as short of clearance. Taste: planning
            keeps the preferred clearance by soft rows, which may fall a little short.
        reach: search distance for gaps, as a fraction of the arm's length; larger gaps are recorded as this distance.
            Taste: several times the usual preferred clearance.
        reach_wanted: search distance for gaps, in multiples of the preferred clearance; the larger of this and
            ``reach`` applies. Taste.
    """

    samples: int = 240
    enough: float = 0.9
    reach: float = 0.05
    reach_wanted: float = 4.0


DEFAULT_CLEARANCE = ClearanceSettings()
"""Default settings of the clearance record."""


@dataclass(frozen=True)
class _GapsAtSamples:
    """The nearest pair of bodies at each inspected sample, each array of shape (N,).

    Attributes:
        gap: gap of the pair [m]; the search distance where no pair is within it.
        wanted: preferred gap of the pair [m].
        link: link of the pair, from 1; 0 where no pair is within the search distance.
        second_link: second link of the pair, from 1; 0 where the pair is with a wall or missing.
        obstacle: name of the wall, or empty.
    """

    gap: FloatArray
    wanted: FloatArray
    link: IntArray
    second_link: IntArray
    obstacle: npt.NDArray[np.object_]

    @property
    def lack(self) -> FloatArray:
        """Shortfall from the preferred clearance, shape (N,) [m]; negative where the gap is larger."""
        return self.wanted - self.gap

    def where(self, choose: BoolArray, other: "_GapsAtSamples") -> "_GapsAtSamples":
        """Return gaps taken from this object at the samples of a mask, and from another object elsewhere."""
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
    """Return the record of the clearance that a motion keeps.

    Args:
        problem: the problem as posed.
        trajectory: the motion, which passes the verifier.
        wanted: the preferred clearance [m]; 0 when there is none.
        checks: checks of the verifier, which hold the least gaps; computed here when None.
        settings: fraction of the preferred clearance that counts as enough, and search distance.
        verification: resolution of the least gap between samples.

    Returns:
        The record, without the largest possible gap and the price of the preferred clearance.
    """
    verification = verification.for_problem(problem)
    if checks is None:
        motion = ChainMotion(problem.arm, trajectory.time, trajectory.positions)
        made = [check_walls(motion, problem.workspace, verification)]
        if problem.arm.self_collision:
            made.append(check_self_collision(motion, verification))
        checks = made
    return _Room(problem, trajectory, wanted, tuple(checks), settings, verification).record()


@dataclass(frozen=True)
class _Room:
    """Measures the clearance of one motion among its obstacles; attributes as for ``clearance_over_time``."""

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
        """Indices of the inspected samples, evenly spread in time, and of all samples at which the arm rests."""
        time = self.trajectory.time
        spread = np.searchsorted(time, np.linspace(0.0, time[-1], self.settings.samples))
        return np.unique([0, *np.minimum(spread, len(time) - 1), *self.trajectory.stops, len(time) - 1])

    @property
    def _reach(self) -> float:
        return max(self.settings.reach * self.problem.arm.length, self.settings.reach_wanted * self.wanted)

    def record(self) -> ClearanceRecord:
        """Return the record of the motion."""
        motion = self._motion
        samples = self._samples
        poses = motion.points[samples]
        to_walls = self._wall_gaps(poses)
        to_itself, itself_lacks = self._self_gaps(poses)
        # The nearest pair need not fall shortest of its preferred clearance: links close along the arm want smaller
        # gaps.
        nearest = to_walls.where(to_walls.gap <= to_itself.gap, to_itself)
        lacking = to_walls.where(to_walls.lack >= itself_lacks.lack, itself_lacks)
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
        """Return the gap to the nearest wall at every inspected sample."""
        clearance = self.problem.workspace.clearance
        seen = GapsAtSamples.of(self.problem, poses, self._reach + clearance, 0.0)
        near = seen.walls
        names = np.array([*seen.names, ""], dtype=np.object_)[near.other]
        wanted = np.full(len(poses), self.wanted)
        return _GapsAtSamples(near.gap - clearance, wanted, near.link, np.zeros_like(near.link), names)

    def _self_gaps(self, poses: FloatArray) -> tuple[_GapsAtSamples, _GapsAtSamples]:
        """Return the gaps of the nearest pair of links at every sample, and of the pair with the largest shortfall."""
        arm = self.problem.arm
        may_meet = arm.self_collision and first_distant(arm) < arm.links
        pairs, distance = link_gaps(arm, poses if may_meet else poses[:0], self._reach)
        wanted = arm.link_margins(pairs.link, pairs.other, self.wanted)

        def chosen(least: FloatArray) -> _GapsAtSamples:
            best = _first_per_node(pairs.stretch, least, len(poses))
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
        """Return the least gap over all times, at a sample or, as proved by the checks, between two samples."""
        known = [self._place(at_samples, int(np.argmin(at_samples.gap)))]
        for place in (check.place for check in self.checks if check.place is not None):
            wanted = self.wanted
            if place.second_link:
                wanted = _wanted_pair_gap(self.problem.arm, place.link - 1, place.second_link - 1, wanted)
            known.append(replace(place, wanted=wanted))
        return min(known, key=lambda place: place.gap)

    def _place(self, gaps: _GapsAtSamples, sample: int) -> NearPlace:
        """Return the record of the nearest pair of bodies at one sample."""
        return NearPlace(
            float(gaps.gap[sample]),
            float(gaps.wanted[sample]),
            float(self.trajectory.time[self._samples[sample]]),
            int(gaps.link[sample]),
            str(gaps.obstacle[sample]),
            int(gaps.second_link[sample]),
        )

    def _short(self, gaps: _GapsAtSamples, rests: list[int]) -> Iterator[ShortStretch]:
        """Yield the time intervals in which the motion is short of the preferred clearance, each with its cause."""
        few = gaps.lack > (1.0 - self.settings.enough) * self.wanted
        edges = np.flatnonzero(np.diff(np.concatenate(([False], few, [False])).astype(np.int8)))
        for first, end in edges.reshape(-1, 2):
            last = end - 1
            worst = first + int(np.argmax(gaps.lack[first:end]))
            cause = self._cause(gaps, rests, (int(first), int(last)), float(gaps.lack[worst]))
            yield ShortStretch(
                float(self.trajectory.time[self._samples[first]]),
                float(self.trajectory.time[self._samples[last]]),
                self._place(gaps, worst),
                cause,
            )

    def _cause(self, gaps: _GapsAtSamples, rests: list[int], stretch: tuple[int, int], lack: float) -> ShortCause:
        """Return the rest pose that causes a shortfall, or "passage".

        A rest pose within the interval is the cause if no other pose there falls shorter of the preferred clearance.
        """
        for number, sample in enumerate(rests):
            inside = stretch[0] <= sample <= stretch[1]
            if inside and gaps.lack[sample] >= lack - self.verification.report_resolution:
                if number == 0:
                    return "start"
                return "goal" if number == len(rests) - 1 else "stop"
        return "passage"


def _first_per_node(node: IntArray, least: FloatArray, count: int) -> IntArray:
    """Return the index of the item with the least value at each node, shape (count,); -1 for a node without items."""
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, node, least)
    lowest_items = np.flatnonzero(least == lowest[node])
    best = np.full(count, -1)
    best[node[lowest_items]] = lowest_items
    return best


def _filled(best: IntArray, values: FloatArray, otherwise: float) -> FloatArray:
    """Return the value at the chosen index of each sample, shape (N,), or a default where no index is chosen."""
    return np.append(values, otherwise)[best]


def _numbered(best: IntArray, numbers: IntArray) -> IntArray:
    """Return the number at the chosen index of each sample, counted from 1, shape (N,); 0 where no index is chosen."""
    counted: IntArray = np.append(numbers + 1, 0)[best]
    return counted


def _wanted_pair_gap(arm: Arm, first: int, second: int, wanted: float) -> float:
    return float(arm.link_margins(np.array([first]), np.array([second]), wanted)[0])
