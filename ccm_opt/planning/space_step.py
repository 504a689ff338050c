"""One step of a motion in space: a small convex quadratic program, taken as far as the certificate allows."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import CurveMap, feed_to_next_stop
from ccm_opt.planning.limits.limit import UNBOUNDED, LimitRows, best_change
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_REACH = 0.35
"""Gap from which on walls are left out [u]."""
_PAIR_REACH = 0.35
"""The same of links to each other [u]."""
_PULL = 30.0
"""Weight that draws out what lies within the margin."""
_TRAVEL = 1.5
"""Farthest way of a joint in a step [u]."""
_EVENNESS = 1e-4
"""Weight on its differences from knot to knot."""
_SPARE_TURN = 0.005
"""Of the joint limits that rows leave [rad]."""
_RIDGE = 1e-8
"""On every unknown, so that the program has one answer."""
_BACKTRACKS = 4
"""How often a step is halved before it is given up."""

_TRAVEL_NEAR_WALLS = 0.8
"""The same where walls or other links are within reach."""
_STILL_TURNS = 0.01
"""Weight on the turns of the links."""
_STILL_MOVES = 0.01
"""Weight on the ways of the joints."""


@dataclass(frozen=True, eq=False)
class SpaceStepper:
    """Takes certified steps.

    Attributes:
        curve: the map from unknowns to configurations.
        tree: of the surfaces.
        certificate: of steps.
        margin: gap that steps keep beyond contact [m].
        settings: numbers of the search.
        user: the user's constraints; None where there are none.
    """

    curve: CurveMap
    tree: SurfaceTree
    certificate: SpaceCertificate
    margin: float
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    user: UserLimit | None = None

    @property
    def unit(self) -> float:
        """u, length of a nominal link [m]."""
        return self.curve.nominal_length

    @cached_property
    def kept(self) -> float:
        """Distance from the axes of the links that surfaces have to keep [m]."""
        return self.curve.arm.radius + self.certificate.gap

    @cached_property
    def _per_link(self) -> float:
        """Nominal links to a link: weights of sums over links do not depend on how many there are."""
        return NOMINAL_LINKS / self.curve.arm.links

    def pose(self, v: FloatArray) -> Pose:
        """The pose of unknowns."""
        return self.curve.pose(v)

    def step(self, pose: Pose, terms: Sequence[Term], *, certified: bool = True) -> Pose:
        """The best step for some terms that keeps all limits, as far as it is certified; the same pose if none is.

        Args:
            pose: where to step from.
            terms: what draws the arm on.
            certified: whether the step has to be certified; a pose that is only looked for may pass through walls.
        """
        settings = self.settings.step
        clear = self._clearance_rows(pose)
        parts = [clear, self._limit_rows(pose)]
        if self.user is not None:
            parts.append(self.user.step_rows(self.user.values(pose.q), pose.slopes, pose.turning, settings.turn))
        delta = best_change([*terms, *self._still_terms(pose)], parts, _RIDGE)
        if delta is None:
            return pose
        delta = self._scaled(pose, delta, near_walls=len(clear.lower) > 0)
        return self._taken(pose, delta) if certified else self.pose(pose.v + delta)

    def _scaled(self, pose: Pose, delta: FloatArray, *, near_walls: bool) -> FloatArray:
        """The step no longer than its linearisation is good for."""
        settings = self.settings.step
        travel = _TRAVEL_NEAR_WALLS if near_walls else _TRAVEL
        turns = np.linalg.norm(pose.turning @ delta, axis=1)
        moves = np.linalg.norm(pose.moving @ delta, axis=1)
        excess = max(float(np.max(turns)) / settings.turn, float(np.max(moves)) / (travel * self.unit))
        arm = self.curve.arm
        if arm.base_axes:
            fed = float(pose.slopes[-1] @ delta)
            feed = float(pose.q[-1])
            most = min(feed_to_next_stop(self.curve, feed, forward=fed > 0.0), settings.feed * self.unit)
            excess = max(excess, abs(fed) / most)
        return delta / max(excess, 1.0)

    def _taken(self, pose: Pose, delta: FloatArray) -> Pose:
        """The pose after as much of a step as is certified."""
        settings = self.settings
        for k in range(_BACKTRACKS + 1):
            trial = self.onto_equations(self.pose(pose.v + delta * 0.5**k))
            if not self.within_limits(trial.q) or (self.user is not None and not self.user.keeps(pose.q, trial.q)):
                continue
            if self.certificate.safe(pose.q, trial.q, settings.certificate.step_depth):
                return trial
        return pose

    def onto_equations(self, pose: Pose) -> Pose:
        """The pose moved onto the user's equations by Newton's method of least change; as it is where that fails."""
        user = self.user
        if user is None or not user.rows.equal.any():
            return pose
        start = pose
        for _ in range(user.settings.newton_steps):
            now = user.values(pose.q)
            if float(np.max(np.abs(now.equations), initial=0.0)) <= user.settings.met:
                return pose
            rows = now.equation_slopes @ pose.slopes
            scale = user.turns(now.equation_slopes)
            pose = self.pose(pose.v + least_change(pose, rows / scale[:, None], -now.equations / scale, self.unit))
            if not float(np.max(np.abs(pose.q - start.q))) <= user.settings.keyframe_turn:
                return start
        return start

    def within_limits(self, q: FloatArray) -> bool:
        """Whether a configuration keeps the limits of its coordinates."""
        arm = self.curve.arm
        slack = 1e-9
        return bool(np.all(q >= arm.lower_limits - slack) and np.all(q <= arm.upper_limits + slack))

    # ------------------------------------------------------------ what every step keeps
    def _clearance_rows(self, pose: Pose) -> LimitRows:
        """Rows n·δP ≥ −share (gap − margin) off walls and other links, and what pulls out of the margin."""
        settings = self.settings.step
        reach = self.kept + self.margin + _REACH * self.unit
        mounted, segments = self.curve.arm.exposed_links(pose.points)
        begins = self.curve.arm.mount_end[1]
        planes = self.tree.planes(segments, reach, settings.planes)
        moving = pose.moving
        link = planes.link + mounted
        share = np.where(planes.link == 0, begins + (1.0 - begins) * planes.share, planes.share)[:, None, None]
        at_plane = (1.0 - share) * moving[link] + share * moving[link + 1]
        rows = [np.einsum("rd,rdp->rp", planes.normal, at_plane)]
        gaps = [planes.gap - self.kept]
        arm = self.curve.arm
        if arm.self_collision:
            near = self.certificate.motion.near_pairs(
                pose.points, 2.0 * arm.radius + self.margin + _PAIR_REACH * self.unit
            )
            first = near.first_at[:, None, None]
            second = near.second_at[:, None, None]
            apart = (1.0 - first) * moving[near.first] + first * moving[near.first + 1]
            apart = apart - (1.0 - second) * moving[near.second] - second * moving[near.second + 1]
            rows.append(np.einsum("rd,rdp->rp", near.normal, apart))
            gaps.append(near.distance - 2.0 * arm.radius)
        matrix = np.concatenate(rows)
        spare = np.concatenate(gaps) - self.margin
        missing = spare < 0.0
        pull = Term(matrix[missing], -spare[missing], _PULL / self.unit**2)
        unbounded = np.full(len(spare), UNBOUNDED)
        return LimitRows(matrix, -settings.share * np.maximum(spare, 0.0), unbounded, pulls=(pull,))

    def _limit_rows(self, pose: Pose) -> LimitRows:
        """Rows of the coordinates, and what they may lose and gain."""
        arm = self.curve.arm
        # A little is left to what the linear rows do not know: the shape of a fed arm changes with its feed.
        spare = np.append(np.full(2 * arm.links, _SPARE_TURN), np.zeros(len(arm.base_axes)))
        low = np.minimum(arm.lower_limits + spare - pose.q, 0.0)
        high = np.maximum(arm.upper_limits - spare - pose.q, 0.0)
        return LimitRows(pose.slopes, low, high)

    def _still_terms(self, pose: Pose) -> list[Term]:
        """What keeps the arm still, and its bends small and even, where nothing else asks for more."""
        settings = self.settings.step
        p = len(pose.v)
        turning = pose.turning.reshape(-1, p)
        moving = pose.moving.reshape(-1, p)
        curvature = self._curvature_rows
        across = self._curvature_differences
        scale = self._per_link
        return [
            Term(turning, np.zeros(len(turning)), _STILL_TURNS * scale),
            Term(moving, np.zeros(len(moving)), _STILL_MOVES * scale / self.unit**2),
            Term(curvature, -curvature @ pose.v, settings.bends),
            Term(across, -across @ pose.v, _EVENNESS),
        ]

    @cached_property
    def _curvature_rows(self) -> FloatArray:
        """Bends of a nominal link by the curvature at each knot, shape (2 knots, p)."""
        return self.unit * self.curve.curvature_rows

    @cached_property
    def _curvature_differences(self) -> FloatArray:
        """Their differences from knot to knot, shape (2 knots − 2, p)."""
        return self.unit * self.curve.curvature_differences


def least_change(pose: Pose, rows: FloatArray, change: FloatArray, unit: float) -> FloatArray:
    """The change of the unknowns that moves the links least and changes rows by given amounts, shape (p,).

    Args:
        pose: where it is taken.
        rows: shape (k, p).
        change: of them, shape (k,).
        unit: length of a nominal link [m].
    """
    spread = np.linalg.solve(moved_metric(pose, unit), rows.T)
    # Least squares, because rows may say the same thing twice.
    return np.asarray(spread @ np.linalg.lstsq(rows @ spread, change, rcond=1e-12)[0])


def moved_metric(pose: Pose, unit: float) -> FloatArray:
    """How much the unknowns move and turn the links, squared, shape (p, p)."""
    p = len(pose.v)
    turning = pose.turning.reshape(-1, p)
    moving = pose.moving.reshape(-1, p) / unit
    metric = turning.T @ turning + 0.01 * moving.T @ moving
    return np.asarray(metric + 1e-9 * np.trace(metric) * np.eye(p))
