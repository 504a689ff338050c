"""The last resort: RRT-Connect between the start and poses at the goal, in the unknowns of the curve.

Two trees grow in turn, each by an edge towards a draw and then as far as it goes towards the new leaf of the other
(J. Kuffner and S. LaValle, RRT-Connect, 2000). Every edge is certified in continuous time.
"""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.settings import SpaceConnectSettings
from ccm_opt.planning.space_sweep import edge_is_safe, in_pieces
from ccm_opt.planning.step import SpaceStepper

_EXTENSION = 2.0
"""Longest edge, in the norm of turns of the links [rad]."""


@dataclass(eq=False)
class _Tree:
    """Unknowns that are reached, each from one before it."""

    leaves: list[FloatArray]
    parents: list[int]

    def nearest(self, v: FloatArray, root: FloatArray) -> int:
        """Number of the leaf nearest to unknowns; distances are those of v times the root of the metric."""
        apart = (np.stack(self.leaves) - v) @ root
        return int(np.argmin(np.einsum("kp,kp->k", apart, apart)))

    def branch(self, leaf: int) -> list[FloatArray]:
        """From a leaf back to its root."""
        found = []
        while leaf >= 0:
            found.append(self.leaves[leaf])
            leaf = self.parents[leaf]
        return found


@dataclass(eq=False)
class Connect:
    """Grows two trees until they meet.

    Args:
        stepper: in whose unknowns they grow.
        start: where the motion begins.
        goals: poses at the goal.
        rng: for the draws.
        settings: of the sampler.
    """

    stepper: SpaceStepper
    start: Pose
    goals: list[Pose]
    rng: np.random.Generator
    settings: SpaceConnectSettings
    _root: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        metric = self.stepper.space.metric(self.start)
        self._root = np.linalg.cholesky(metric + 1e-6 * np.trace(metric) / len(metric) * np.eye(len(metric)))

    def path(self, deadline: Deadline) -> list[Pose] | None:
        """Poses from the start to one of the goals; None where the draws or the time end first."""
        first = _Tree([self.start.v], [-1])
        second = _Tree([goal.v for goal in self.goals], [-1] * len(self.goals))
        from_start = True
        for _ in range(self.settings.draws):
            if deadline.passed():
                return None
            growing, other = (first, second) if from_start else (second, first)
            reached = self._extended(growing, self._draw())
            if reached is not None:
                met = self._connected(other, growing.leaves[reached])
                if met is not None:
                    leaves = (reached, met) if from_start else (met, reached)
                    way = [*first.branch(leaves[0])[::-1], *second.branch(leaves[1])[1:]]
                    return [self.stepper.pose(v) for v in in_pieces(self.stepper, np.stack(way))]
            from_start = not from_start
        return None

    def _draw(self) -> FloatArray:
        """Unknowns between and around the start and the goals."""
        goal = self.goals[int(self.rng.integers(len(self.goals)))]
        share = self.rng.uniform(-0.2, 1.2)
        middle = self.start.v + share * (goal.v - self.start.v)
        if self.settings.base_share > 0.0 and self.rng.uniform() < self.settings.base_share:
            return self._turned(middle)
        spread = self.rng.normal(size=len(middle))
        apart = float(np.linalg.norm((goal.v - self.start.v) @ self._root))
        size = self.rng.uniform(0.1, 1.0) * max(apart, 1.0)
        direction = np.linalg.solve(self._root.T, spread)
        return np.asarray(middle + size * direction / np.sqrt(len(middle)))

    def _turned(self, v: FloatArray) -> FloatArray:
        """Unknowns whose base points anywhere."""
        most = np.minimum(self.stepper.curve.arm.base_limit, (np.pi, 0.5 * np.pi))
        return np.concatenate((self.rng.uniform(-most, most), v[2:]))

    def _extended(self, tree: _Tree, target: FloatArray) -> int | None:
        """Number of the new leaf, one edge nearer to a target; None where there is no way."""
        near = tree.nearest(target, self._root)
        way = target - tree.leaves[near]
        length = float(np.linalg.norm(way @ self._root))
        if length < 1e-9:
            return near
        v = tree.leaves[near] + way * min(1.0, _EXTENSION / length)
        if not edge_is_safe(self.stepper, tree.leaves[near], v, self.stepper.settings.certificate.step_depth):
            return None
        tree.leaves.append(v)
        tree.parents.append(near)
        return len(tree.leaves) - 1

    def _connected(self, tree: _Tree, target: FloatArray) -> int | None:
        """Number of the leaf at which a tree meets a target; None where it does not."""
        while True:
            reached = self._extended(tree, target)
            if reached is None:
                return None
            if float(np.linalg.norm((tree.leaves[reached] - target) @ self._root)) < 1e-6:
                return reached
