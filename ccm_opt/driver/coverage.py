"""The fewest views from which a share of surfaces is seen: sampled, checked for poses, and chosen by a program.

Views are sampled about the pieces of the surfaces (``view_sampling``), and the fewest that see enough are chosen
(``set_cover``). A chosen view for which no pose of the arm is found (``pose_finding``) is left out, and others are
chosen in its place; so is one to which no motion is found. Views like it are left out with it, until the others see too
little.

An arm with few links is first posed at random, and views are those of a roadmap of its poses (``pose_roadmap``) if
these see enough: then the motions between them are known, too.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, TimeLimitReached
from ccm_opt.driver.pose_finding import PoseFinder
from ccm_opt.driver.pose_roadmap import PoseRoadmap
from ccm_opt.driver.set_cover import fewest_sets, greedy_order
from ccm_opt.driver.view_sampling import LEAST_ROOM, NO_POSE, NO_ROOM, NOT_LOOKED_AT, OUT_OF_REACH, Views, ViewSampler
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import Coverage, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import Tour
from ccm_opt.scene.surface_pieces import SurfacePieces
from ccm_opt.verification.coverage import SeenPieces, seen_pieces
from ccm_opt.verification.tool_chain import motion_of

_MOST_PIECES = 1500
"""Largest number of pieces for which views are chosen; of more, a random sample stands for all. Heuristic."""
_USED = 0.999
"""Fraction of the tolerances of a view that is used. Derived: far above rounding."""
_DRAWN = 300
"""Number of sampled poses. Heuristic: each takes a few thousandths of a second."""
_FURTHER_DRAWN = 1000
"""Likewise when those before do not see enough. Heuristic."""
_MOST_ROUNDS = 8
"""Number of times that poses are sampled, and views with them, while these do not see enough. Heuristic."""
_SKIPPED = -2
"""Mark of a view that is left out since it is like one without a pose."""
_FEW_LINKS = 8
"""Number of links up to which an arm with a fixed base has a roadmap of poses. Heuristic."""
_ROADMAP_POSES = 50
"""Number of free poses that are added to a roadmap together. Heuristic."""
_JOINED = 150
"""Number of poses to which motions lead from the start, in rounds of growth of a roadmap. Heuristic: in a room with ten
boxes, so many poses of five links see some three quarters of the walls."""
_MOST_DRAWN = 6000
"""Largest number of sampled poses of a roadmap. Heuristic: a thousand take a second."""
_GAIN = 0.25
"""Least gain of a roadmap that goes on growing, as a fraction of what it lacks. Heuristic."""
_APART = (0.06, float(np.deg2rad(20.0)))
"""Least difference of views that are tried after one has no pose: distance as a fraction of the arm's length, or angle
[rad]. Heuristic."""
_FASTEST = 1e6
"""Rate that stands for one that is not limited [rad/s, m/s]."""
_SEEDS = 3
"""Number of poses from which a pose of a view is tried. Heuristic."""
_PROGRAM_TIME = 2.0
"""Time limit of the choice of the fewest views [s]. Heuristic: most take a second."""
_ROUND_SHARE = 0.5
"""Fraction of the time left that is given to a tour, so that other views may follow. Heuristic."""
_SEARCH_SHARES = (0.5, 0.3)
"""Fractions of the time left after which no further poses are tried: where known ones do not see enough, and where they
do. Heuristic."""
_ROUNDING = 1e-9
"""Share that counts as rounding, as for the verifier."""
_SAMPLE_MARGIN = 0.01
"""Share that is seen beyond the required one where a sample of pieces stands for all. Heuristic."""


@dataclass(eq=False)
class CoverageViews:
    """Views of what a problem has to see, and what is known of them.

    Attributes:
        problem: the problem, with its coverage.
        coverage: what has to be seen.
        pieces: the pieces for which views are chosen.
        sampler: measures lines of sight to them.
        finder: finds poses.
        rng: source of the sampled views.
        views: the sampled views.
        posed: for each view, 2 if it was reached, 1 if a pose was found, −1 if none or no motion was, −2 if it is left
            out since it is like such a view, else 0, shape (n,).
        reasons: why a piece has no view, an index of an obstacle that hides it or a negative number, shape (m,).
        poses: poses found so far.
        roadmap: known motions between them; None for arms with many links, or on a feed axis.
        known: the configuration of each view whose pose is known, by index of the view, each of shape (c,).
        stops: views as goals, by index of the view.
        failures: errors of views to which no motion was found.
    """

    problem: Problem
    coverage: Coverage
    pieces: SurfacePieces
    sampler: ViewSampler
    finder: PoseFinder
    rng: np.random.Generator
    poses: list[Pose] = field(default_factory=list)
    roadmap: PoseRoadmap | None = None
    known: dict[int, FloatArray] = field(default_factory=dict)
    stops: dict[int, Stop] = field(default_factory=dict)
    failures: list[NoPlanFound] = field(default_factory=list)

    def __post_init__(self) -> None:
        sampled = len(self.pieces.sizes) == _MOST_PIECES
        self.share = min(self.coverage.share + (_SAMPLE_MARGIN if sampled else 0.0), 1.0)
        none = np.zeros((0, self.problem.dimension))
        self.views = Views(none, none, np.zeros((0, len(self.pieces.sizes)), dtype=bool))
        self._rounds = 0
        self.posed, self.reasons = np.zeros(0, dtype=np.intp), np.full(len(self.pieces.sizes), NOT_LOOKED_AT)
        if self.problem.arm.links <= _FEW_LINKS and self.problem.arm.feed is None:
            self._begin_roadmap()
        else:
            self._add_poses([self.finder.start])
            self._draw()

    def _sample(self) -> None:
        """Sample views about the pieces that no view sees but those that are left out."""
        sampled, self.reasons = self.sampler.sampled(self.rng, np.any(self.views.sees[self.posed >= 0], axis=0))
        self._add(sampled)

    def _draw(self) -> bool:
        """Draw poses, which are views, and sample further views; return whether these may see enough."""
        if self._rounds == _MOST_ROUNDS or (self._rounds and self._possible() < self.share - _ROUNDING):
            return False
        self._sample()
        self._add_poses(list(self.finder.drawn(_FURTHER_DRAWN if self._rounds else _DRAWN, self._rounds)))
        self._rounds += 1
        return True

    def _possible(self) -> float:
        """Return the share that is seen from some view, or may be for all that is known."""
        sizes = self.pieces.sizes
        maybe = np.any(self.views.sees, axis=0) | (self.reasons == NO_POSE)
        return float(np.sum(sizes[maybe]) / np.sum(sizes))

    def _revived(self) -> bool:
        """Take back those views that were left out only because they are like others; return whether there are any."""
        skipped = self.posed == _SKIPPED
        self.posed[skipped] = 0
        return bool(np.any(skipped))

    def _add(self, views: Views, known: Sequence[FloatArray] = ()) -> None:
        """Add views, whose configurations, each of shape (c,), are known or none are."""
        self.known |= dict(enumerate(known, start=len(self.posed)))
        self.views = self.views.with_further(views)
        self.posed = np.append(self.posed, np.full(len(views.tips), int(bool(known))))

    def _begin_roadmap(self) -> None:
        """Draw poses until those to which motions lead from the start see enough, or as long as that is likely."""
        start = self.finder.start
        pace = np.minimum(self.problem.limits.of_coordinates(self.problem.arm.coordinates).velocity, _FASTEST)
        self.roadmap = PoseRoadmap(self.finder.safe, pace, self.finder.configuration(start)[None])
        self._drawn, self._further = [start], self.finder.drawn(_MOST_DRAWN)
        self._add_poses([start])
        while (before := self._lacking()) > _ROUNDING and self._grow():
            if before - self._lacking() < _GAIN * self._lacking():
                return

    def _grow(self) -> bool:
        """Draw poses until motions lead from the start to some more, which are views; return whether there are any.

        Without a roadmap, poses are drawn whether motions lead to them or not.
        """
        roadmap, fresh = self.roadmap, list[Pose]()
        if roadmap is None:
            return self._draw()
        while len(fresh) < _JOINED and (some := list(islice(self._further, _ROADMAP_POSES))):
            known = np.append(roadmap.joined, np.zeros(len(some), dtype=bool))
            self._drawn += some
            roadmap.add(np.array(list(map(self.finder.configuration, some))))
            roadmap.find_neighbours()
            roadmap.join()
            fresh += [self._drawn[k] for k in np.flatnonzero(roadmap.joined & ~known)]
        if fresh:
            self._add_poses(fresh)
        return bool(fresh)

    def _add_poses(self, poses: list[Pose]) -> None:
        """Add poses, and what is seen from them as views."""
        known = list(map(self.finder.configuration, poses))
        self._add(self.sampler.from_poses(self.problem.arm, known), known)
        self.poses += poses

    def _lacking(self) -> float:
        """Return the share that the known poses lack."""
        return self.share - self._share_of(self.views.sees[self.posed > 0])

    def _share_of(self, sees: BoolArray) -> float:
        """Return the share that is seen from views together, by what each sees, shape (k, m)."""
        sizes = self.pieces.sizes
        return float(np.sum(sizes[np.any(sees, axis=0)])) / float(np.sum(sizes))

    @classmethod
    def of(cls, problem: Problem, coverage: Coverage) -> "CoverageViews":
        """Sample views of the surfaces that have to be seen.

        Args:
            problem: the problem.
            coverage: what has to be seen.

        Raises:
            MotionNotFound: the box in which pieces count has none.
        """
        whole = problem_with_tool_links(problem)
        found = SurfacePieces.of(problem.workspace, coverage.surfaces, coverage.spacing, coverage.within)
        if not np.any(found.sizes > 0.0):
            raise MotionNotFound(Diagnosis("goal.see: there is no surface in the box", "views", ("move goal.within",)))
        rng = np.random.default_rng(problem.planner.seed)
        if len(found.sizes) > _MOST_PIECES:
            some = np.sort(rng.choice(len(found.sizes), _MOST_PIECES, replace=False))
            found = SurfacePieces(found.corners[some], found.owner[some])
        sampler = ViewSampler(whole, coverage, found, problem.workspace.surface_tree)
        return cls(problem, coverage, found, sampler, PoseFinder.of(problem), rng)

    def fewest(self, deadline: Deadline) -> tuple[IntArray, int]:
        """Return the fewest views that see enough and have poses, and a lower bound on their number.

        The bound is that of the sampled views that are not left out.

        Args:
            deadline: time at which all planning has to end.

        Raises:
            NoPlanFound: all views together do not see enough; the message says why, with shares.
        """
        sizes = self.pieces.sizes
        needed = self.share * float(np.sum(sizes))
        # Where known poses see enough, further ones only lower the number of views.
        search = deadline.within(max(_SEARCH_SHARES[self._lacking() <= _ROUNDING] * deadline.left, 1.0))
        # Those that see most are looked at first, so that few remain that cannot be reached.
        while not search.passed():
            alive = self._alive()
            order = alive[greedy_order(self.views.sees[alive], sizes)]
            if self._have_poses(self._first_unknown(order, needed)):
                break
        while True:
            alive = self._alive()
            if search.passed() and self._lacking() <= _ROUNDING:
                alive = np.flatnonzero(self.posed > 0)
            cover = fewest_sets(self.views.sees[alive], sizes, needed, np.divide(self.posed[alive], 2.0), _PROGRAM_TIME)
            chosen = alive[cover.sets]
            if search.passed() or self._have_poses(chosen):
                return chosen, cover.fewest

    def _alive(self) -> IntArray:
        """Return the views that are not left out.

        Raises:
            NoPlanFound: they do not see enough.
        """
        if self.roadmap is not None:
            if self._lacking() <= _ROUNDING:
                return np.flatnonzero(self.posed > 0)
            if np.all(self.reasons == NOT_LOOKED_AT):
                self._sample()
        while (together := self._share_of(self.views.sees[self.posed >= 0])) < self.share - _ROUNDING:
            if not (self._revived() or self._grow()):
                raise self._not_enough(together)
        return np.flatnonzero(self.posed >= 0)

    def _have_poses(self, some: IntArray) -> bool:
        """Return whether all of some views have poses; those that have none are left out."""
        for k in some:
            if self.posed[k] == 0:
                self.posed[k] = self._posed(int(k))
                if self.posed[k] < 0:
                    self.posed[self._alike(k) & (self.posed == 0)] = _SKIPPED
        return bool(np.all(self.posed[some] >= 0))

    def _alike(self, k: np.intp) -> BoolArray:
        """Return a mask of the views that need not be tried where one has no pose, shape (n,)."""
        away = np.linalg.norm(self.views.tips - self.views.tips[k], axis=1)
        ahead = self.views.axes @ self.views.axes[k]
        return np.asarray((away < _APART[0] * self.problem.arm.length) & (ahead > np.cos(_APART[1])))

    def _first_unknown(self, order: IntArray, needed: float) -> IntArray:
        """Return those views of unknown pose that are needed if views are taken in an order."""
        covered = np.cumsum(self.views.sees[order], axis=0) > 0
        count = int(np.searchsorted(covered @ self.pieces.sizes, needed)) + 1
        return np.asarray(order[:count][self.posed[order[:count]] == 0])

    def _posed(self, k: int) -> int:
        """Return 1 if a pose is found for a view, which is kept, else −1."""
        near = self.stop(k).tolerances
        room = near.position, near.heading
        pose = self.finder.led_from(self.poses, self.views.tips[k], self.views.axes[k], room, _SEEDS)
        if pose is None:
            return -1
        q = self.finder.configuration(pose)
        self.poses.append(pose)
        if self.roadmap is not None:
            self._drawn.append(pose)
            self.roadmap.add(q[None])
            self.roadmap.find_neighbours()
        self.known[k] = q
        # Motions lead to this very pose, if there are any.
        self.views.sees[k] = self.sampler.from_poses(self.problem.arm, [q]).sees[0]
        return 1

    def stop(self, k: int) -> Stop:
        """Return a view as a goal, always the same, with the largest tolerances within which it sees its pieces."""
        if k not in self.stops:
            self.stops[k] = self._stop(k)
        return self.stops[k]

    def known_poses(self, chosen: IntArray) -> dict[int, FloatArray]:
        """Return the configurations (c,) that are known of some views, shape (k,), by index among these."""
        return {at: self.known[k] for at, k in enumerate(chosen.tolist()) if k in self.known}

    def chain(self, first: FloatArray, last: FloatArray) -> FloatArray | None:
        """Return poses between which motions are known, from one pose (c,) to another one, shape (K, c), or None."""
        return None if self.roadmap is None else self.roadmap.chain(first, last)

    def _stop(self, k: int) -> Stop:
        tip, axis, mine = self.views.tips[k], self.views.axes[k], np.flatnonzero(self.views.sees[k])
        sights = self.pieces.centres[mine] - tip
        away = np.linalg.norm(sights, axis=1)
        left = 0.5 * self.coverage.field_of_view - np.arccos(np.clip(sights @ axis / away, -1.0, 1.0))
        least = LEAST_ROOM * self.problem.arm.length
        radius = max(least, float(np.min(away * np.sin(np.clip(left / 3.0, 0.0, 0.5 * np.pi)))))
        rooms = self.sampler.rooms(np.broadcast_to(tip, sights.shape), mine, radius)
        radius = max(least, min(radius, float(np.min(rooms))))
        turn = float(np.min(left - np.arcsin(np.minimum(radius / away, 1.0))))
        tolerances = Tolerances(_USED * radius, _USED * max(turn, 1e-6))
        return Stop(TipGoal(tip, axis), tolerances, self.problem.pause)

    def expanded(self, chosen: IntArray, deadline: Deadline) -> Problem:
        """Return the problem whose goals, in free order, are some of the views.

        Args:
            chosen: indices of the views, shape (k,).
            deadline: time at which all planning has to end.
        """
        *before, last = [self.stop(int(k)) for k in chosen]
        options = replace(self.problem.planner, time_limit=max(_ROUND_SHARE * deadline.left, 1.0))
        goal: dict[str, Any] = {"goal": last.goal, "tolerances": last.tolerances, "pause": last.pause}
        return replace(self.problem, stops=tuple(before), planner=options, coverage=None, source="", **goal)

    def enough(self, ends: Sequence[FloatArray]) -> bool:
        """Return whether enough is seen from configurations, each of shape (c,)."""
        return self.seen(ends).share >= self.coverage.share - _ROUNDING

    def seen(self, ends: Sequence[FloatArray]) -> SeenPieces:
        """Return which pieces, of all, are seen from configurations, each of shape (c,)."""
        motion = motion_of(self.problem.arm, np.arange(len(ends), dtype=np.float64), np.array(ends))
        return seen_pieces(self.problem.workspace, self.coverage, motion, range(len(ends)))

    def leave_out(self, missed: IntArray, failures: Sequence[NoPlanFound] = ()) -> None:
        """Leave out views to which no motion was found, shape (k,), with the errors."""
        for k in missed:
            self.posed[self._alike(k) & (self.posed >= 0) & (self.posed < 2)] = _SKIPPED
            self.posed[k] = -1
        self.failures += failures

    def learn(self, reached: IntArray, ends: Sequence[FloatArray]) -> None:
        """Take from views, shape (k,), what the arm hides from itself where it reached them, in configurations (c,)."""
        seen = self.sampler.from_poses(self.problem.arm, ends).sees
        self.views.sees[reached] &= seen
        self.posed[reached] = 2
        if len(self.pieces.sizes) == _MOST_PIECES or self._share_of(seen) >= self.share - _ROUNDING:
            self.share = min(self.share + _SAMPLE_MARGIN, 1.0)

    def out_of_time(self, ends: Sequence[FloatArray]) -> TimeLimitReached:
        """Return the error for a search that ended with configurations, each of shape (c,), that do not see enough."""
        found, wanted = 100.0 * self.seen(ends).share, 100.0 * self.coverage.share
        reason = f"goal.see: when the time limit was reached, {found:.3g} % was seen from {len(ends)} views"
        advice = ("raise planner.time_limit", "lower goal.share")
        return TimeLimitReached(Diagnosis(f"{reason}, {wanted:.3g} % is wanted", "views", advice))

    def toured(self, tour: Tour, posed: Problem, fewest: int) -> Tour:
        """Return the tour of the views that were visited, as goals of the problem as posed.

        Args:
            tour: tour of the expanded problem.
            posed: the problem as posed.
            fewest: lower bound on the number of views.
        """
        visited = sorted(tour.order)
        goals = tour.posed.numbered_goals
        order = tuple(visited.index(number) + 1 for number in tour.order)
        views = tuple(goals[number - 1] for number in visited)
        least = min(fewest, len(views))
        return replace(tour, posed=posed, order=order, left_out=(), views=views, fewest=least, unseen=self.missing())

    def missing(self) -> tuple[str, ...]:
        """Return why parts of the surfaces have no view, with shares, the largest first."""
        sizes, names = self.pieces.sizes, self.problem.workspace.triangle_soup.names
        reasons = np.where(
            np.any(self.views.sees[self.posed >= 0], axis=0),
            np.iinfo(np.intp).max,
            np.where(np.any(self.views.sees, axis=0), NO_POSE, self.reasons),
        )
        words = {
            OUT_OF_REACH: "out of reach",
            NO_ROOM: "without room for the tip where they would be seen",
            NO_POSE: "seen only from where no pose was found",
            NOT_LOOKED_AT: "seen from no sampled pose",
        }
        shares: Counter[str] = Counter()
        for reason in np.unique(reasons[reasons < len(names)]).tolist():
            share = float(np.sum(sizes[reasons == reason]) / np.sum(sizes))
            shares[words[reason] if reason < 0 else f"hidden by '{names[reason]}'"] += share  # type: ignore[assignment]
        return tuple(f"{100.0 * share:.2g} % {reason}" for reason, share in shares.most_common(4) if share > 0.0)

    def _not_enough(self, together: float) -> NoPlanFound:
        """Return the error for views that do not see enough together."""
        wanted = 100.0 * self.coverage.share
        names = " and ".join(f"'{name}'" for name in self.coverage.surfaces)
        found = (
            f"goal.see: all sampled views together see {100.0 * together:.3g} % of {names}, {wanted:.3g} % is wanted"
        )
        reason = "; ".join((found, *self.missing()))
        if self.failures:
            reason += f"; to a view: {self.failures[0].diagnosis.reason}"
        advice = (
            f"lower goal.share to {np.floor(1000.0 * together) / 1000.0:g}",
            "widen goal.distance, goal.angle_deg or goal.field_of_view_deg",
        )
        evidence = {"share": together, "wanted": self.coverage.share, "views": len(self.views.tips)}
        kind = TimeLimitReached if any(isinstance(each, TimeLimitReached) for each in self.failures) else MotionNotFound
        return kind(Diagnosis(reason, "views", advice, evidence))
