"""The user's hard constraints as a limit, with the costs that go with them.

Gaps are treated as clearances are: they keep a margin where there is room for it. Equations are rows that a step has
to meet; after it Newton's method brings the coordinates back onto them.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, Limit, LimitRows, MotionCost
from ccm_opt.planning.limits.limit_stack import overbent
from ccm_opt.planning.limits.user_motion_rows import (
    UserCosts,
    intervals_with_broken_gaps,
    refuse_broken_goal,
    refuse_broken_start,
    slope_norms,
)
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.settings import UserLimitSettings

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms
    from ccm_opt.ik.row_set import RowSet, RowValues
    from ccm_opt.planning.swept_motion import Sweep

_JOINT_SHARE = 0.995
"""Share of a joint limit to which bends beyond that are brought back; what splines overshoot stays below the limit.
Taste."""

_KNOT_RESERVES = 4.0
"""Reserves to which a knot of the smooth path is moved that has less than half of that. Measured: with 2 a path at the
edge of a camera's view was refused, with 4 it is laid."""


@dataclass(frozen=True, eq=False)
class UserLimit(Limit):
    """All constraints and costs of one problem.

    Attributes:
        terms: the constraints and costs, compiled.
        settings: numbers.
        u: path parameter at which the constraints are looked at.
        at_goal: whether those at the goal are meant, not those on the way.
    """

    terms: "UserTerms"
    settings: UserLimitSettings = field(default_factory=UserLimitSettings)
    u: float = 0.0
    at_goal: bool = False

    @property
    def parametric(self) -> bool:
        """Whether anything depends on the path parameter."""
        return self.terms.parametric

    @property
    def resamples(self) -> bool:
        """No: quantities are symbols of an arm with a given number of links."""
        return False

    @property
    def moves_keyframes(self) -> bool:
        """Yes: a step of the optimisation leaves equations by its square."""
        return True

    @property
    def shapes_path(self) -> bool:
        """Whether there are equations, or anything that depends on the path parameter."""
        return bool(self.terms.path_rows.equal.any()) or self.terms.parametric

    @property
    def breaks(self) -> tuple[float, ...]:
        """Path parameters inside (0, 1) at which a term begins or ends to apply."""
        return tuple(self.terms.breaks.tolist())

    @property
    def rows(self) -> "RowSet":
        """Rows of the constraints, on the way or at the goal."""
        return self.terms.goal_rows if self.at_goal else self.terms.motion_rows

    def placed(self, u: float) -> "UserLimit":
        """The constraints at another place of the motion."""
        return replace(self, u=u)

    def placed_at_goal(self) -> "UserLimit":
        """The constraints at the goal."""
        return replace(self, u=1.0, at_goal=True)

    def values(self, headings: FloatArray) -> "RowValues":
        """Rows at link headings, shape (links,) [rad]."""
        return self.rows.at(headings, self.u)

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """Equations, asked to be met at once or half a turn of it, and a row for each gap that could close."""
        del jacobians
        settings = self.settings
        before = self.values(pose.headings)
        # A gap is compared in radians of the whole arm, that is divided by the norm of its slope: so the one margin
        # suits gaps in metres, radians or any other unit.
        equations, target = self._independent(space, before, turn)

        scale = slope_norms(before.gap_slopes)
        # Cauchy–Schwarz: n links that turn by at most t each close a gap of unit slope by t √n to first order; the
        # factor 2 leaves room for its curvature.
        farthest = 2.0 * turn * np.sqrt(space.arm.links)  # what a step can close at most
        # Negated, so that a gap that is NaN keeps its row and is refused, instead of passing unseen.
        within = ~(before.gaps > (settings.margin + farthest) * scale)
        scale = scale[within]
        gaps = before.gaps[within] / scale
        rows = before.gap_slopes[within] @ space.matrix / scale[:, None]
        # Never above 0: δ = 0 stays feasible even inside the margin, where the pull asks for more room instead.
        lower = np.minimum(-0.5 * (gaps - settings.margin), 0.0)

        def keeps(trial: Pose) -> bool:
            return self._keeps(before, self.values(trial.headings))

        return LimitRows(
            np.vstack((equations, rows)),
            np.concatenate((target, lower)),
            np.concatenate((target, np.full(len(rows), UNBOUNDED))),
            len(target),
            (self._pull(rows, gaps, turn),),
            keeps,
        )

    def _pull(self, rows: FloatArray, gaps: FloatArray, turn: float) -> Term:
        """Ask gaps inside their margin to open, broken ones urgently."""
        margin = self.settings.margin
        near = gaps < margin
        short = margin - gaps[near]
        urgency = np.where(gaps[near] < 0.0, self.settings.urgency, 1.0)
        # Half of a shortfall at a time moves the arm gently; a broken gap has to be opened at once.
        wanted = np.where(gaps[near] < 0.0, short, 0.5 * short)
        return Term(urgency[:, None] * rows[near], urgency * np.minimum(wanted, turn), self.settings.pull_weight)

    def _independent(self, space: LinkSpace, values: "RowValues", turn: float) -> tuple[FloatArray, FloatArray]:
        """Orthonormal combinations of the equations' rows, and what they have to change by.

        Equations far from met ask for half of the largest turn of a link, so that the QP stays feasible.
        """
        slopes = values.equation_slopes @ space.matrix
        if not len(slopes):
            return slopes, values.equations

        # Dependent equations would make the QP degenerate. With J = U S Vᵀ, J δ = −c becomes Vᵀ δ = −S⁻¹ Uᵀ c on the
        # directions whose singular value counts.
        left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
        kept = sizes > self.settings.rank * max(float(sizes[0]), TINY)
        target = -(left.T @ values.equations)[kept] / sizes[kept]

        most = float(np.max(np.abs(space.matrix @ (right[kept].T @ target)), initial=0.0))
        return right[kept], target * min(1.0, 0.5 * turn / max(most, TINY))

    def _keeps(self, before: "RowValues", after: "RowValues") -> bool:
        """Whether every gap keeps its share of the margin, or no less than it had, and equations are met or nearer."""
        settings = self.settings
        # A pose that begins inside the margin may stay there, but not lose more.
        floor = np.minimum(settings.keep_share * settings.margin * slope_norms(before.gap_slopes), before.gaps)
        if not np.isfinite(after.violation) or not np.all(after.gaps >= floor - TINY):
            return False

        # Far from the equations the sum decides: one of them may grow for a step while the others shrink.
        met = np.max(np.abs(after.equations), initial=0.0) <= settings.met
        return bool(met or np.abs(after.equations).sum() < np.abs(before.equations).sum())

    def restored(self, space: LinkSpace, v: FloatArray, most: float) -> FloatArray:
        """Coordinates moved onto the equations, shape (p,); as they are where that fails."""
        moved = self.moved_onto_rows(space, v, most, gaps=False)
        return v if moved is None else moved

    def moved_onto_rows(self, space: LinkSpace, v: FloatArray, most: float, *, gaps: bool) -> FloatArray | None:
        """Coordinates moved onto the equations by Newton's method of least change of the links, shape (p,).

        Args:
            space: the link space.
            v: shape (p,).
            most: largest turn of a link on the way [rad].
            gaps: whether to move out of broken gaps, and back within joint limits, too.

        Returns:
            None when that does not converge within ``most``.
        """
        start = v
        # The side to which each bend was too large on the way; ``overbent`` adds to it and takes nothing out.
        held = np.zeros(space.arm.links)
        for _ in range(self.settings.newton_steps):
            headings = space.headings(v)
            values = self.values(headings)
            if not np.isfinite(values.violation):
                return None
            slopes = values.equation_slopes @ space.matrix
            # Newton: J δ = −c, with the rows of broken gaps and bent joints below those of the equations.
            change = -values.equations
            if gaps:
                slopes, change = self.missed(space, headings)
                limits = _JOINT_SHARE * space.bend_limits
                turned, back = overbent(limits, space.bends(headings), held, self.settings.met)
                slopes = np.vstack((slopes, turned @ space.matrix[: space.arm.links]))
                change = np.append(change, back)
            if np.max(np.abs(change), initial=0.0) <= self.settings.met:
                return v
            v = v + _least_change(space, v, slopes, change)
            # Farther away lies perhaps another branch of the equations, and nothing is known of what is between.
            if np.max(np.abs(space.matrix @ (v - start))) > most:
                return None
        return None

    # ------------------------------------------------------------ at the goal
    def miss(self, headings: FloatArray) -> float:
        """By how much the worst row is missed, beyond what counts as met."""
        miss = self.values(headings).violation
        return 0.0 if miss <= self.settings.met_at_goal else miss

    def mending(self, space: LinkSpace, headings: FloatArray, most: float) -> tuple[FloatArray, FloatArray]:
        """Rows of all that is missed, per radian, shape (k, p), and what they should gain, at most ``most`` [rad]."""
        values = self.values(headings)
        margins = self.settings.margin * slope_norms(values.gap_slopes)
        short = values.gaps < margins
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[short]))
        scale = slope_norms(slopes)
        wanted = np.append(-values.equations, margins[short] - values.gaps[short]) / scale
        return slopes @ space.matrix / scale[:, None], np.clip(wanted, -most, most)

    def missed(self, space: LinkSpace, headings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slopes of the equations and of broken gaps, shape (k, p), and by how much they have to change."""
        values = self.values(headings)
        broken = values.gaps < 0.0
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken])) @ space.matrix
        # Aimed a little beyond 0, else rounding would leave the gap broken and Newton would go on in vain.
        aim = self.settings.keep_share * self.settings.margin * slope_norms(values.gap_slopes[broken])
        return slopes, np.append(-values.equations, aim - values.gaps[broken])

    # ------------------------------------------------------------ the optimisation of a motion
    def _at_keyframe(self, k: int, u: FloatArray) -> "UserLimit":
        """The constraints at a keyframe; the last is the goal."""
        return self.placed_at_goal() if k == len(u) - 1 else self.placed(float(u[k]))

    def keyframe_equations(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Equations of every keyframe, their slopes of norm 1."""
        keyframes: list[int] = []
        rows = [np.zeros((0, sweep.space.dimension))]
        # Rows of norm 1 keep the QP well scaled whatever the user measures in. Keyframe 0 is the start, which is fixed.
        for k in range(1, len(u)):
            slopes = self._at_keyframe(k, u).values(sweep.headings[k]).equation_slopes @ sweep.space.matrix
            rows.append(slopes / slope_norms(slopes)[:, None])
            keyframes += [k] * len(slopes)
        zero = np.zeros(len(keyframes))
        return (KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(rows), zero, zero),)

    def keyframe_rows(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Gaps of every keyframe that are not far from closing, per radian of the whole arm."""
        keyframes: list[int] = []
        rows = [np.zeros((0, sweep.space.dimension))]
        least = [np.zeros(0)]
        for k in range(1, len(u)):
            values = self._at_keyframe(k, u).values(sweep.headings[k])
            scale = slope_norms(values.gap_slopes)
            near = values.gaps < self.settings.far * scale
            scale = scale[near]
            rows.append(values.gap_slopes[near] @ sweep.space.matrix / scale[:, None])
            # These rows are hard and have no slack: a gap inside its margin may only not shrink, or there would be no
            # feasible step.
            least.append(np.minimum(self.settings.margin - values.gaps[near] / scale, 0.0))
            keyframes += [k] * len(scale)
        lower = np.concatenate(least)
        upper = np.full(len(lower), UNBOUNDED)
        return (KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(rows), lower, upper),)

    def costs(self, space: LinkSpace, u: FloatArray) -> tuple[MotionCost, ...]:
        """The user's costs, soft constraints among them."""
        return (UserCosts(space, self.terms, u),)

    def restored_keyframes(self, space: LinkSpace, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Inner keyframes put on their equations and out of broken gaps; where that fails they stay as they are."""
        restored = coordinates.copy()
        for k in range(1, len(u) - 1):
            limit = self._at_keyframe(k, u)
            moved = limit.moved_onto_rows(space, restored[k], self.settings.keyframe_turn, gaps=True)
            if moved is not None:
                restored[k] = moved
        return restored

    def holds(self, sweep: "Sweep", before: "Sweep", u: FloatArray) -> bool:
        """Whether all equations are met, and no gap is broken."""
        del before
        return all(self._at_keyframe(k, u).miss(sweep.headings[k]) <= 0.0 for k in range(1, len(u)))

    # ------------------------------------------------------------ between keyframes
    def failures(self, headings: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals in which a gap falls below its reserve; samples need no bisection."""
        del depth
        return intervals_with_broken_gaps(self.terms.path_rows, headings, self.settings)

    # ------------------------------------------------------------ the smooth path
    def missed_on_path(self, headings: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Slopes by the link headings of equations and broken gaps, shape (k, links), and what they have to change."""
        values = self.terms.path_rows.at(headings, u)
        settings = self.settings
        reserve = settings.reserve * settings.keep_share * settings.margin * slope_norms(values.gap_slopes)
        # The certificate asks for the reserve, by the steepest slope at the ends; beside its knots a path has less gap
        # than at them.
        broken = values.gaps < 0.5 * _KNOT_RESERVES * reserve
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken]))
        return slopes, np.append(-values.equations, _KNOT_RESERVES * reserve[broken] - values.gaps[broken])

    def misses_path(self, headings: FloatArray, u: FloatArray) -> BoolArray:
        """At which samples a row is missed by more than its share of what is allowed."""
        rows = self.terms.path_rows
        table = rows.table(headings, u)
        miss = np.where(rows.equal, np.abs(table), -table)
        missed: BoolArray = np.any(miss > self.settings.path_share * self.settings.allowed, axis=1)
        return missed

    # ------------------------------------------------------------ ends and words
    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hard constraints."""
        return tuple(hard.constraint.name for hard in self.terms.hard)

    @property
    def advice(self) -> tuple[str, ...]:
        """What would help when no motion is found."""
        return ("relax the constraints, or make them soft",)

    def refuse_ends(self, start: FloatArray, goal: FloatArray | None) -> None:
        """Refuse a start or a whole-arm goal that breaks a constraint, and terms that are not finite at the start."""
        refuse_broken_start(self.terms, start, self.settings.allowed)
        if goal is not None:
            refuse_broken_goal(self.terms, goal, self.settings.allowed)

    def worst(self, headings: FloatArray) -> tuple[str, float]:
        """Name of the constraint that is missed most in radians of the arm, and its miss in the user's unit."""
        rows = self.rows
        table = rows.table(headings[None], self.u)[0]
        miss = np.where(rows.equal, np.abs(table), np.maximum(-table, 0.0))
        # The table holds NaN where a row does not apply at this u.
        if np.all(np.isnan(miss)):
            return "", 0.0
        k = int(np.nanargmax(miss / self._slope_norms(headings)))
        return rows.names[k], float(miss[k])

    def describe(self, headings: FloatArray) -> str:
        """The constraint that is missed, or else at its bound, in words; empty when none is."""
        name, miss = self.worst(headings)
        if miss > self.settings.met:
            return f"constraint '{name}' is missed by {miss:.3g}"
        rows = self.rows
        turns = rows.table(headings[None], self.u)[0] / self._slope_norms(headings)
        near = ~rows.equal & (turns < 2.0 * self.settings.margin)
        return f"constraint '{rows.names[int(np.flatnonzero(near)[0])]}' is at its bound" if near.any() else ""

    def _slope_norms(self, headings: FloatArray) -> FloatArray:
        """Norm of the slope of every row, whether it applies here or not, shape (rows,)."""
        return slope_norms(np.asarray(self.rows.slopes(headings, self.u)[1]))


def _least_change(space: LinkSpace, v: FloatArray, slopes: FloatArray, change: FloatArray) -> FloatArray:
    """Least change of the links, from coordinates v, that changes rows by given amounts, shape (p,)."""
    # min ½ δᵀ M δ subject to S δ = c, M the metric of the turns of the links: δ = M⁻¹ Sᵀ (S M⁻¹ Sᵀ)⁻¹ c. Least squares,
    # because the user may ask for the same thing twice.
    scale = np.maximum(np.linalg.norm(slopes, axis=1), TINY)
    scaled = slopes / scale[:, None]
    spread = space.spread(v, scaled)
    least: FloatArray = spread @ np.linalg.lstsq(scaled @ spread, change / scale, rcond=1e-10)[0]
    return least
