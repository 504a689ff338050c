"""Keyframes that keep users' terms and places to pass."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.space_cost import SpaceMotionCost
from ccm_opt.planning.space_rows import KeyframeRows
from ccm_opt.planning.space_step import SpaceStepper
from ccm_opt.planning.space_sweep import SpaceSweep
from ccm_opt.planning.space_tracking import moved_onto_terms

if TYPE_CHECKING:
    from ccm_opt.ik.functions import CompiledCost


@dataclass(frozen=True, eq=False)
class UserKeyframes:
    """The user's terms over K + 1 keyframes; the first is the start, which is given.

    Attributes:
        user: constraints and costs.
        u: path parameters of the keyframes, shape (K + 1,).
    """

    user: UserLimit
    u: FloatArray

    def _at(self, keyframe: int) -> UserLimit:
        """The constraints at a keyframe; the last is the goal."""
        if keyframe == len(self.u) - 1:
            return self.user.placed_at_goal()
        return self.user.placed(float(self.u[keyframe]))

    def rows(self, sweep: SpaceSweep) -> KeyframeRows:
        """Equations of every keyframe, and gaps that are not far from closing, as turns of the whole arm."""
        settings = self.user.settings
        p = sweep.unknowns.shape[1]
        numbers: tuple[list[int], list[int]] = ([], [])
        rows: tuple[list[FloatArray], list[FloatArray]] = ([np.zeros((0, p))], [np.zeros((0, p))])
        lower: tuple[list[FloatArray], list[FloatArray]] = ([np.zeros(0)], [np.zeros(0)])
        for k in range(1, len(self.u)):
            pose = sweep.poses[k]
            here = self._at(k)
            now = here.values(pose.q)
            scale = here.turns(now.equation_slopes)
            numbers[0].extend([k] * len(scale))
            rows[0].append(now.equation_slopes @ pose.slopes / scale[:, None])
            lower[0].append(np.zeros(len(scale)))
            scale = here.turns(now.gap_slopes)
            near = now.gaps < settings.far * scale
            numbers[1].extend([k] * int(np.sum(near)))
            rows[1].append(now.gap_slopes[near] @ pose.slopes / scale[near, None])
            # Without slack: a gap inside its margin may only not shrink, or there would be no step at all.
            lower[1].append(np.minimum(settings.margin - now.gaps[near] / scale[near], 0.0))
        return KeyframeRows(
            np.array([*numbers[0], *numbers[1]], dtype=np.intp),
            np.vstack((*rows[0], *rows[1])),
            np.concatenate((*lower[0], *lower[1])),
            len(numbers[0]),
        )

    # ------------------------------------------------------------ back onto what steps leave by their square
    def restored(self, stepper: SpaceStepper, unknowns: FloatArray) -> FloatArray:
        """Inner keyframes put on their equations and out of broken gaps; where that fails they stay as they are."""
        restored = unknowns.copy()
        for k in range(1, len(self.u) - 1):
            moved = moved_onto_terms(stepper, self._at(k), stepper.pose(restored[k]))
            if moved is not None:
                restored[k] = moved.v
        return restored

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether all equations are met, and no gap is broken."""
        return all(self._at(k).miss(sweep.configurations[k]) <= 0.0 for k in range(1, len(self.u)))

    # ------------------------------------------------------------ costs
    @cached_property
    def _costs(self) -> "tuple[tuple[CompiledCost, FloatArray], ...]":
        """All costs, soft constraints among them, each with its weights at the keyframes, a mean over its places."""
        found = []
        for cost in self.user.terms.all_costs:
            applies = cost.applies(self.u).astype(np.float64)
            found.append((cost, cost.cost.weight * applies / max(float(applies.sum()), 1.0)))
        return tuple(found)

    def value(self, sweep: SpaceSweep) -> float:
        """What the user's costs make of a motion."""
        return sum(float(weights @ cost.values(sweep.configurations, self.u)) for cost, weights in self._costs)

    def model(self, sweep: SpaceSweep) -> tuple[FloatArray, FloatArray]:
        """Gradient, shape (K + 1, p), and convex part of the Hessian, a block a keyframe, shape (K + 1, p, p)."""
        frames, p = sweep.unknowns.shape
        gradient = np.zeros((frames, p))
        blocks = np.zeros((frames, p, p))
        for cost, weights in self._costs:
            for k in np.flatnonzero(weights[1:]) + 1:
                first, second = cost.second_order(sweep.configurations[k], float(self.u[k]))
                if not (np.isfinite(first).all() and np.isfinite(second).all()):
                    continue  # there it says nothing of where to go; a motion at which its value is NaN is refused
                # The nearest positive semidefinite matrix drops the negative eigenvalues: programs are convex.
                sizes, vectors = np.linalg.eigh(second)
                factor = sweep.slopes[k].T @ (vectors * np.sqrt(np.maximum(sizes, 0.0)))
                gradient[k] += weights[k] * first @ sweep.slopes[k]
                blocks[k] += weights[k] * factor @ factor.T
        return gradient, blocks


@dataclass(frozen=True, eq=False)
class CostWithTerms:
    """The cost of a motion with what the user adds to it.

    Attributes:
        plain: without the user.
        terms: the user's.
    """

    plain: SpaceMotionCost
    terms: UserKeyframes

    def value(self, sweep: SpaceSweep) -> float:
        """Value of a motion."""
        return self.plain.value(sweep) + self.terms.value(sweep)

    def model(self, sweep: SpaceSweep) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
        """As that of the plain cost."""
        gradient, blocks, row, column = self.plain.model(sweep)
        of_user, bent = self.terms.model(sweep)
        blocks = blocks.copy()
        blocks[row == column] += bent
        return gradient + of_user, blocks, row, column


@dataclass(frozen=True, eq=False)
class PassingKeyframes:
    """Keyframes at which the tip passes places.

    Attributes:
        keyframe: of each place, shape (m,).
        places: shape (m, 3) [m].
        reach: how far off the tip may be at that keyframe, shape (m,) [m].
    """

    keyframe: IntArray
    places: FloatArray
    reach: FloatArray

    @classmethod
    def of(cls, sweep: SpaceSweep, keyframe: IntArray, places: FloatArray, wanted: float) -> "PassingKeyframes":
        """Keyframes that stay as near as is wanted [m], or as near as they are."""
        away = np.linalg.norm(sweep.points[keyframe, -1] - places, axis=1)
        return cls(keyframe, places, np.maximum(wanted, away))

    def rows(self, sweep: SpaceSweep) -> KeyframeRows:
        """Six rows a place: the tip stays in the cube that fits into the ball, or leaves it no farther on any axis."""
        moved = np.flatnonzero(self.keyframe > 0)
        keyframe = self.keyframe[moved]
        unit = sweep.stepper.unit
        off = (sweep.points[keyframe, -1] - self.places[moved]) / unit
        most = np.maximum(self.reach[moved, None] / (np.sqrt(3.0) * unit), np.abs(off))
        slopes = sweep.moving[keyframe, -1] / unit
        p = slopes.shape[-1]
        return KeyframeRows(
            np.repeat(keyframe, 6),
            np.concatenate((slopes, -slopes), axis=1).reshape(-1, p),
            np.concatenate((-most - off, off - most), axis=1).ravel(),
            0,
        )

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether the tip is within reach of every place at its keyframe."""
        away = np.linalg.norm(sweep.points[self.keyframe, -1] - self.places, axis=1)
        return bool(np.all(away <= self.reach * (1.0 + 1e-9)))
