"""Search task of a planar motion: arm, workspace, start, goal and limits, with the certificates built from them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import count
from typing import TypeAlias

import numpy as np
import shapely
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.planning.limits.clearance_rows import motion_rows
from ccm_opt.planning.limits.gate_rails import GateLines, GateRails
from ccm_opt.planning.limits.limit import Limit
from ccm_opt.planning.limits.limit_stack import ContactLimit, assembled_limits
from ccm_opt.planning.limits.motion_certificate import MotionCertificate
from ccm_opt.planning.link_space import FedSpace, LinkSpace, nearest_curves
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.optimisation.objective import JointSlowness, normalised
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.settings import MotionSettings
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.planning.tip_paths import TipPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.certificate import Certificate, allowed_contact
from ccm_opt.scene.contact_finder import WallFinder
from ccm_opt.scene.workspace import Workspace

_SPARE_AT_ENDS = 0.5
"""Certified gap as a fraction of the gap at start and goal, if that is smaller than the usual one. Heuristic."""

_REACH_MARGINS = 4.0
"""Gap below which contacts are constraints of a QP step, in planning margins, if larger than ``_REACH``. Heuristic."""
_SPARE_IN_GATES = 0.1
"""Certified gap as a fraction of the gap beside the arm in narrow gates, if that is smaller than the usual one.
Heuristic: half of the fraction that the planning margin keeps."""
_END_REACH = 4.0
"""Search distance at which measured gaps at start and goal are capped, as a multiple of ``_SPARE``. Heuristic."""

EndPosesOffered: TypeAlias = Callable[[Arm, FloatArray], Iterable[FloatArray]]
"""Function that yields, from the arm and the configuration in which a motion ends, better goal configurations (c,)."""
_REACH = 0.96
"""Gap below which contacts are constraints of a QP step, in nominal links. Heuristic: a step moves a link by less."""
_PLAY = 0.5
"""Distance from the centre line of a gate within which joints are not pulled towards it, in planning margins.
Heuristic."""
_LARGEST_LINK = 1.0 / 36.0
"""Upper bound on the link length in which distances of the optimisation are given, as a fraction of the arm's length.
Heuristic."""
_ROW_REACH = 2.5
"""Gap to walls or other links above which the optimisation has no contact constraint, in link lengths of at most
``_LARGEST_LINK``. Heuristic."""
_ROW_MARGIN = 1e-3
"""Gap beyond contact that constraints of the optimisation require, as a fraction of the arm's length. Heuristic."""
_ROW_SEEN = 1.1
"""Distance to its bound below which a constraint enters the QP of the optimisation, in link lengths of at most
``_LARGEST_LINK``. Heuristic."""
_GROUPS = 36
"""Number of links above which the optimisation has one contact constraint per group of neighbouring joints.
Heuristic."""
_SPARE = 1e-4
"""Usual gap beyond contact that is certified, as a fraction of the arm's length. Heuristic."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionTask(SearchTask):
    """Inputs of the search for a planar motion.

    Attributes:
        workspace: the workspace.
        guesses: configurations, each of shape (c,), of possible goal poses as targets of interpolation; computed on
            demand.
        tip_paths: homotopy classes of tip paths, most promising first.
        clamped: whether the first link must keep its heading.
        further_guesses: more configurations of possible goal poses, used when the first do not help; computed on
            demand.
        slowness: relative slowness of the joints; None if all are equally fast.
        end_poses: function that offers better goal configurations (c,) than the one in which a motion of an arm ends,
            the best first.
        fed_space: map from coordinates to configurations for an arm on a feed axis; None if the base is fixed, where
            the map is that of curves through the start.
        nominal_links: number of nominal links in the arm's length; more than usual for narrow passages.
        settings: settings of every stage of the search.
    """

    workspace: Workspace
    guesses: Iterable[FloatArray] = ()
    tip_paths: tuple[TipPath, ...] = ()
    clamped: bool = False
    further_guesses: Iterable[FloatArray] = ()
    slowness: JointSlowness | None = None
    end_poses: EndPosesOffered = field(default=lambda _arm, _end: ())
    fed_space: FedSpace | None = None
    nominal_links: float = NOMINAL_LINKS
    settings: MotionSettings = field(default_factory=MotionSettings)

    @property
    def kept(self) -> float:
        """Required distance of walls from the centre line of the last link: radius plus clearance [m]."""
        return self.arm.tip_radius + self.workspace.clearance

    @property
    def advice(self) -> str:
        """Advice to the user if no motion is found and nothing more specific is known."""
        return "raise planner.routes (not tried)"

    @cached_property
    def contact_certificate(self) -> Certificate:
        """Certificate of contact that motions must pass, with a small gap beyond contact that the ends permit.

        Motions that touch no deeper than rounding may begin and end in contact.
        """
        ends = [self.start] if self.goal_pose is None else [self.start, self.goal_pose]
        gaps = [self._end_finder.find(self.arm.joint_positions_at(end)).gap.min(initial=np.inf) for end in ends]
        contact = allowed_contact(self.arm, self.workspace, self.settings.certificate)
        most = _SPARE * self.arm.length
        # No certificate can ask for more than an end has; an end in contact gets a small depth below it, or its first
        # interval would always fail. Nor can it ask for more than a gate leaves next to the arm.
        spare = np.clip(_SPARE_AT_ENDS * min(gaps) - contact, -contact, most)
        in_gates = min((self.gap_about(path.gate_places) for path in self.tip_paths), default=np.inf)
        spare = min(spare, max(_SPARE_IN_GATES * in_gates, 0.0))
        return Certificate(self.arm, self.workspace, float(spare), self.settings.certificate)

    def space_through(self, q: FloatArray) -> tuple[LinkSpace, FloatArray]:
        """Return the map from coordinates to configurations for motions from ``q`` (c,), and the coordinates of ``q``.

        For a fed arm, one map contains all configurations, which may have the shape (..., c).
        """
        if self.fed_space is not None:
            return self.fed_space, self.fed_space.fitted(q)
        return LinkSpace.through(self.arm, q, self.nominal_links, clamped=self.clamped)

    def at_full_limits(self) -> "MotionTask":
        """Return a copy of the task in which steps may use nearly the full joint limits."""
        step = self.settings.step
        return replace(self, settings=replace(self.settings, step=replace(step, limit_share=step.full_limit_share)))

    def bends_all_it_may(self, q: FloatArray) -> bool:
        """Return whether any joint of a configuration, shape (c,), is bent at least as far as planning allows."""
        share = self.settings.step.limit_share
        hair = self.settings.certificate.rounding + 1e-3 * (1.0 - share)
        return bool(np.any(np.abs(q[: self.arm.links]) > (share - hair) * self.arm.bend_limits))

    def gap_about(self, places: FloatArray) -> float:
        """Return the least gap to walls of an arm with its centre line at points (m, 2) [m]; inf without points."""
        if len(places) == 0:
            return np.inf
        _, nearest = self.workspace.nearest(shapely.MultiPoint(places))
        return nearest - self.kept

    @cached_property
    def certificate(self) -> MotionCertificate:
        """Certificate of all limits, which every motion must pass."""
        return self.certificate_with(-np.inf)

    @cached_property
    def _end_finder(self) -> WallFinder:
        """Finder of contacts that measures the gaps at start and goal."""
        return self.finder(0.0, _END_REACH * _SPARE * self.arm.length)

    def finder(self, margin: float, reach: float) -> WallFinder:
        """Return a finder of contacts with a planning margin and a search distance [m]."""
        walls = self.workspace.flat_walls
        return WallFinder(self.arm, walls, self.workspace.clearance, margin, reach)

    def stepper(self, space: LinkSpace, margin: float) -> Stepper:
        """Return the solver of QP steps in the coordinates of a map, with a planning margin in nominal links."""
        kept = margin * space.nominal_length
        finder = self.finder(kept, max(_REACH * space.nominal_length, _REACH_MARGINS * kept))
        return Stepper(space, self.limits(finder), self.settings, finder=finder)

    def limits(
        self, finder: WallFinder, wanted_gap: float = 0.0, certificate: Certificate | None = None
    ) -> tuple[Limit, ...]:
        """Return all limits of the motion.

        Args:
            finder: finder of contacts, with the planning margin and search distance of the contact limit.
            wanted_gap: preferred gap beyond contact [m].
            certificate: certificate of contact; ``contact_certificate`` if None.
        """
        step = self.settings.step
        rows = partial(motion_rows, workspace=self.workspace)
        contact = ContactLimit(finder, certificate or self.contact_certificate, step, rows, wanted_gap, self.gates)
        drawn = () if self.gates is None else (GateRails(self._rails, self.gates, _PLAY * finder.margin),)
        # Last, since joints moved by the user's equations have to be straight again in the guide tube.
        return assembled_limits(self.arm, contact, step, (*drawn, *self.user_limits, *self.held))

    @cached_property
    def _rails(self) -> tuple[FloatArray, ...]:
        """Centre lines of the narrow gates on the tip paths, extended straight at both ends, each (k, 2) [m]."""
        return tuple(rail for path in self.tip_paths for rail in path.rails)

    @cached_property
    def gates(self) -> GateLines | None:
        """Lines across the narrow gates on the tip paths; None without gates."""
        rails = self._rails
        return GateLines.from_rails(rails, self.workspace) if rails else None

    def certificate_with(self, spare: float) -> MotionCertificate:
        """Return a certificate of all limits that requires at least a gap beyond contact, ``spare`` [m]."""
        contact = replace(self.contact_certificate, spare=max(spare, self.contact_certificate.spare))
        return MotionCertificate(self.arm, contact.spare, self.limits(self._end_finder, certificate=contact))

    def program(self, motion: Motion, margin: float | None = None) -> MotionProgram[PlanarSweep]:
        """Return the optimisation problem for a motion: limits, goal and weights, without its keyframes.

        Args:
            motion: certified motion.
            margin: gap beyond contact that constraints require, as a fraction of the arm's length; the default if None.
        """
        margin = _ROW_MARGIN if margin is None else margin
        length = self.arm.length
        # Otherwise the reach of a few long links would include every wall of the workspace.
        link = min(self.arm.link_length, _LARGEST_LINK * length)
        end = motion.curve.pose(motion.unknowns[-1])
        # Rows ask for the wanted gap, with slack at a price; the reach is extended by that gap to include its walls.
        finder = self.finder(margin * length, _ROW_REACH * link + self.wanted_gap)
        optimisation = self.settings.optimisation
        return MotionProgram(
            curve=motion.curve,
            sweep=partial(PlanarSweep, motion.curve),
            limits=self.limits(finder, self.wanted_gap),
            failures=partial(self.failures, motion.curve),
            # Where the goal is a set, the motion keeps the member that it was found for.
            goal=self.limited_goal.nearest_member(end.tip, end.tip_direction),
            end_fixed=self.goal_pose is not None,
            u=np.zeros(0),
            deadline=self.deadline,
            weights=normalised(self.weights),
            wanted_gap=self.wanted_gap,
            row_reach=_ROW_SEEN * link + self.wanted_gap,
            groups=_GROUPS,
            steps=optimisation.steps,
            slowness=self.slowness,
            many=1.5 * optimisation.intervals,
            local_step_reduction=self.gates is not None,
        )

    def clearance_shortfall(self, q: FloatArray) -> FloatArray:
        """Return how much of the preferred clearance each configuration (k, c) lacks, at least 0, shape (k,) [m]."""
        finder = self.finder(0.0, self.wanted_gap)
        gaps = [finder.find(points).gap.min(initial=finder.reach) for points in self.arm.joint_positions_at(q)]
        return self.wanted_gap - np.array(gaps)

    def keyframes_along(
        self, keyframes: FloatArray, spline: BSpline, *, legs: bool
    ) -> tuple[FloatArray, BSpline, tuple[Configuration, ...]]:
        """Return the keyframes (K, c), the joint path, and the K continuous curves nearest to the keyframes.

        Bends of a fed arm inside its guide tube, which are rounding errors, are set to 0.

        Args:
            keyframes: configurations at the keyframes of a motion, shape (K, c).
            spline: joint path near the keyframes.
            legs: unused.
        """
        del legs
        if self.arm.base_axes:
            spline = BSpline(spline.t, np.where(np.abs(spline.c) > TINY, spline.c, 0.0), spline.k)
        return keyframes, spline, nearest_curves(self.arm, keyframes)

    def free(self, q: FloatArray) -> FloatArray:
        """Return 1 for each coordinate of a configuration (c,) that may change, else 0, shape (c,).

        The result is 0 for a clamped base joint, joints in a guide tube and the feed.
        """
        arm = self.arm
        free = np.zeros(len(q))
        free[: arm.links] = ~arm.held(float(arm.coordinates.advance(q)))
        # A clamped base may not be turned, not even by the little that a knot is moved.
        free[0] *= 0.0 if self.clamped else 1.0
        return free

    def with_goal_pose(self, coordinates: FloatArray, q: FloatArray) -> "MotionTask":
        """Return the task with a pose of the whole arm as its goal.

        Args:
            coordinates: coordinates of the pose, shape (p,).
            q: configuration of the pose, shape (c,) [rad, m].
        """
        return replace(self, goal=replace(self.goal, coordinates=coordinates), goal_pose=q)

    @property
    def among_many_walls(self) -> bool:
        """Whether there are so many walls near the arm that goal poses are costly to find and passages are narrow."""
        return len(self.workspace.walls) > self.settings.many_walls


class CachedItems:
    """Iterable of items that are costly to compute; each is computed on first use, and cached.

    Args:
        items: generator of the items.
    """

    def __init__(self, items: Iterable[FloatArray]) -> None:
        self._items = iter(items)
        self._known: list[FloatArray] = []

    def __iter__(self) -> Iterator[FloatArray]:
        """Yield all items, each an array, from the first on."""
        for k in count():
            if k == len(self._known):
                item = next(self._items, None)
                if item is None:
                    return
                self._known.append(item)
            yield self._known[k]


def coarsened(task: MotionTask, links: int) -> MotionTask:
    """Return a planar task for an arm of equal length with ``links`` links; all configurations are resampled."""
    many = task.arm.links

    arm = task.arm.with_links(links)

    def resampled(q: FloatArray) -> FloatArray:
        # Each new heading is the mean of the old ones over its stretch of the arm, from differences of their
        # running integral.
        covered = np.concatenate(([0.0], np.cumsum(task.arm.headings(q))))
        edges = np.interp(np.linspace(0.0, many, links + 1), np.arange(many + 1), covered)
        return arm.bends(np.diff(edges) * links / many)

    return replace(
        task,
        arm=arm,
        start=resampled(task.start),
        goal_pose=None if task.goal_pose is None else resampled(task.goal_pose),
        guesses=CachedItems(resampled(guess) for guess in task.guesses),
        further_guesses=CachedItems(resampled(guess) for guess in task.further_guesses),
        slowness=None if task.slowness is None else task.slowness.resampled(links),
    )
