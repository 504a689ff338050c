"""Errors that a plan in space survives.

Errors are made one joint after the other, the first one first: what is beyond a joint is turned about it as a whole, in
the shape that it has without errors. So a point P moves by at most Σ ψ_i |P − P_i| over the joints i before it, with
the turns ψ_i of the joints. A joint whose two bends are off by at most δ turns by ψ = 2 acos(cos² ½ δ) ≤ √2 δ about
some axis, for its two axes are at right angles. The sum is convex in P, and so greatest at an end of a link.

The proof is that of the gap, with every gap divided by the lever that errors have there: what is left of it is the
error that it survives. It is certified for the greatest share of the least such error that was met which can be proved.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.verification.body_sides import separations
from ccm_opt.verification.chain_motion import ChainMotion, TimeStretches, carried, chain_points
from ccm_opt.verification.selfcollision import LinkProof, first_distant, segment_distances
from ccm_opt.verification.stretch_proof import Measured, Nearest, Pairs
from ccm_opt.verification.tolerance.error_model import (
    DEFAULT_TOLERANCE,
    ErrorModel,
    ToleranceSettings,
    joint_errors,
    largest_error,
)
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.wall_clearance import CheckedSurfaces, WallProof, exposed_starts

_PROVED_SHARES = (0.998, 0.98, 0.9, 0.5)
"""Shares of the least error that was met in space which are proved, in the order of trying. Taste: the first is the
precision; the others are for motions that stay so long so near that it cannot be had."""

_STEP = 1e-6
"""Turn of a joint by which slopes are taken [rad]."""
_PLACES = 65
"""Along a link, at which its nearest place is looked for."""


@dataclass(frozen=True, eq=False)
class LimitingPair:
    """A link and a triangle, or two links.

    Attributes:
        arm: the arm.
        link: number of the link from 0.
        other: of the other link; of no matter where there is a triangle.
        triangle: shape (3, 3) [m], or None for two links.
    """

    arm: Arm
    link: int
    other: int
    triangle: FloatArray | None

    def worst(self, q: FloatArray, inside: float) -> tuple[float, ...]:
        """Signs of the errors of all bends that lead there soonest, shape (2 links,); 0 where they do not matter.

        Args:
            q: the configuration, shape (c,) [rad, m].
            inside: a joint is held where it is farther than this inside the guide tube [m].
        """
        arm = self.arm
        bends = 2 * arm.links
        turned = q + _STEP * np.eye(bends, len(q))
        distances = self.distances(np.vstack((q, turned)))
        signs = -np.sign(distances[1:] - distances[0])
        out = float(carried(arm, q[None])[0]) + arm.link_length * np.arange(arm.links) - arm.hole
        held = np.repeat(out < -inside, 2) if arm.base_axes else np.zeros(bends, dtype=bool)
        return tuple(float(sign) + 0.0 for sign in np.where(held, 0.0, signs))

    def distances(self, poses: FloatArray) -> FloatArray:
        """Between the axes of both, or of the link and the triangle, in configurations (N, c), shape (N,) [m]."""
        points = chain_points(self.arm, poses)
        start = points[:, self.link]
        end = points[:, self.link + 1]
        if self.triangle is None:
            return segment_distances(start, end, points[:, self.other], points[:, self.other + 1])
        return separations(start, end, np.broadcast_to(self.triangle, (len(poses), 3, 3)))[1]

    def place(self, q: FloatArray) -> tuple[float, ...]:
        """The place on the link's axis that is nearest, shape (3,) [m]."""
        points = chain_points(self.arm, q[None])[0]
        share = np.linspace(0.0, 1.0, _PLACES)[:, None]
        along = (1.0 - share) * points[self.link] + share * points[self.link + 1]
        if self.triangle is None:
            ends = (np.broadcast_to(points[self.other + k], along.shape) for k in (0, 1))
            away = segment_distances(along, along, *ends)
        else:
            away = separations(along, along, np.broadcast_to(self.triangle, (_PLACES, 3, 3)))[1]
        return tuple(float(value) for value in along[np.argmin(away)])


_TURN = np.sqrt(2.0)
"""Turn of a joint for errors of one unit of both of its bends."""
_MOST_NUMBERS = 2_000_000
"""Of an array of distances between joints; more poses than have so many are looked at in parts."""


@dataclass(frozen=True, eq=False)
class ErrorLevers:
    """Levers of pairs in stretches of time.

    Attributes:
        arm: the arm.
        model: what may be wrong.
        inside: a joint has no error where it is farther than this inside the guide tube [m].
    """

    arm: Arm
    model: ErrorModel
    inside: float

    def to_surfaces(self, poses: FloatArray, travels: FloatArray, pairs: Pairs) -> FloatArray:
        """How far the links of pairs move against the scene at most, shape (P,) [m a unit].

        Args:
            poses: base, joints and tip, shape (S, links + 1, 3) [m].
            travels: how far each of them goes from there at most, shape (S, links + 1) [m]; zero for the poses alone.
            pairs: whose stretches are numbers of poses.
        """

        def of_some(sums: FloatArray, from_base: FloatArray, pose: IntArray, link: IntArray, _: IntArray) -> FloatArray:
            model = self.model
            before = link + 1
            turned = np.maximum(sums[pose, link, before], sums[pose, link + 1, before])
            about_base = np.maximum(from_base[pose, link], from_base[pose, link + 1])
            grown = model.stretch * (link + 1)
            return np.asarray(_TURN * turned + model.turns[0] * about_base + grown + model.moves_base)

        return self._of_pairs(of_some, poses, travels, pairs)

    def to_links(self, poses: FloatArray, travels: FloatArray, pairs: Pairs) -> FloatArray:
        """How far the second links of pairs move against the first, nearer to the base; arguments likewise."""

        def of_some(sums: FloatArray, _: FloatArray, pose: IntArray, first: IntArray, second: IntArray) -> FloatArray:
            near = sums[pose, second, second + 1] - sums[pose, second, first + 1]
            far = sums[pose, second + 1, second + 1] - sums[pose, second + 1, first + 1]
            grown = self.model.stretch * (second - first + 1)
            return np.asarray(_TURN * np.maximum(near, far) + grown)

        return self._of_pairs(of_some, poses, travels, pairs)

    @property
    def greatest(self) -> float:
        """The greatest lever that any pose of the arm may have [m a unit]."""
        arm = self.arm
        model = self.model
        turned = arm.link_length * float(np.sum(model.turns[1:] * np.arange(arm.links, 0, -1)))
        about_base = model.turns[0] * (arm.length + max(map(abs, arm.base_range)))
        return float(_TURN * turned + about_base + model.stretch * arm.links + model.moves_base)

    def _of_pairs(
        self,
        of_some: Callable[[FloatArray, FloatArray, IntArray, IntArray, IntArray], FloatArray],
        poses: FloatArray,
        travels: FloatArray,
        pairs: Pairs,
    ) -> FloatArray:
        levers = np.empty(len(pairs))
        size = max(_MOST_NUMBERS // (self.arm.links + 1) ** 2, 1)
        for begin in range(0, len(poses), size):
            some = slice(begin, begin + size)
            which = (pairs.stretch >= begin) & (pairs.stretch < begin + size)
            sums, from_base = self._sums(poses[some], travels[some])
            chosen = pairs.where(which)
            levers[which] = of_some(sums, from_base, chosen.stretch - begin, chosen.link, chosen.other)
        # A lever of nought would make of every gap an endless error.
        return np.maximum(levers, np.finfo(np.float64).tiny ** 0.5)

    def _sums(self, poses: FloatArray, travels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Σ |P_p − P_i| over the joints i before m that may be off, (S, p, m), and |P_p − base|, (S, p) [m]."""
        arm = self.arm
        apart = np.linalg.norm(poses[:, :, None] - poses[:, None, :-1], axis=3)
        apart += travels[:, :, None] + travels[:, None, :-1]
        # No two joints are farther apart than the arm between them is long.
        number = np.arange(arm.links + 1)
        apart = np.minimum(apart, arm.link_length * np.abs(number[:, None] - number[:-1]))
        apart *= (self.model.turns[1:] * self._free(poses, travels))[:, None]
        sums = np.concatenate((np.zeros((*apart.shape[:2], 1)), np.cumsum(apart, axis=2)), axis=2)
        return sums, np.linalg.norm(poses - arm.base, axis=2) + travels

    def _free(self, poses: FloatArray, travels: FloatArray) -> FloatArray:
        """1 for joints that no guide tube holds, 0 for the others, shape (S, links)."""
        arm = self.arm
        if not arm.base_axes:
            return np.ones((len(poses), arm.links))
        carried = (poses[:, 0] - arm.base) @ arm.direction + travels[:, 0]
        out = carried[:, None] + arm.link_length * np.arange(arm.links) - arm.hole
        return np.asarray((out >= -self.inside).astype(np.float64))


def moved_by_joint_errors(arm: Arm, points: FloatArray, size: float, inside: float = 0.0) -> FloatArray:
    """How far errors of the joints move each link of a pose at most, shape (links,) [m].

    Args:
        arm: the arm.
        points: base, joints and tip, shape (links + 1, 3) [m].
        size: of the error of every bend [rad].
        inside: as for ``ErrorLevers``.
    """
    links = np.arange(arm.links)
    pairs = Pairs(np.zeros_like(links), links, links)
    levers = ErrorLevers(arm, joint_errors(arm), inside)
    return size * levers.to_surfaces(points[None], np.zeros((1, arm.links + 1)), pairs)


def survived_by_levers(
    problem: Problem,
    trajectory: JointTrajectory,
    model: ErrorModel,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
    most: float = np.inf,
) -> SurvivedError:
    """The largest error of one kind with which every motion keeps clear, certified at all times.

    Every motion whose coordinates are within the error of the planned ones at all times keeps the clearance from every
    surface, beyond the mount, and two radii between distant links where the arm has to. Joints that a guide tube holds
    straight have no error.

    Args:
        problem: with the arm, its scene and the clearance.
        trajectory: the plan, linear between its samples, which keeps the clearance.
        model: what may be wrong.
        settings: largest errors that are looked at, and the share of one that may be given away.
        most: larger errors are not looked at [unit]; what is survived is told as this.
    """
    motion = ChainMotion(problem.arm, trajectory.time, trajectory.positions)
    numbers = DEFAULT_VERIFICATION.for_problem(problem)
    proofs = _proofs(motion, problem.workspace, model, numbers.inside)
    largest = min(most, largest_error(problem.arm, model, settings))
    verdicts = [proof.prove(0.0, numbers) for proof in proofs]
    if not all(verdict.proved for verdict in verdicts):
        number = next(k for k, verdict in enumerate(verdicts) if not verdict.proved)
        return _named(model, 0.0, proofs[number], verdicts[number].nearest)
    met = [verdict.nearest.gap / proof.unit for verdict, proof in zip(verdicts, proofs, strict=True)]
    if not proofs or min(met) >= largest:
        return SurvivedError(model.name, largest, model.unit, "nothing; larger errors are not looked at", limited=False)
    first = int(np.argmin(met))
    for share in _PROVED_SHARES:
        size = share * met[first]
        if all(proof.prove(size * proof.unit, numbers).proved for proof in proofs):
            break
    else:
        size = 0.0
    return _named(model, size, proofs[first], verdicts[first].nearest)


class _SurfacesWithErrors(WallProof):
    """Gaps to surfaces, as errors that they survive, times the greatest lever.

    Args:
        motion: of the arm.
        workspace: its scene.
        levers: of the errors.
    """

    def __init__(self, motion: ChainMotion, workspace: Workspace, levers: ErrorLevers) -> None:
        super().__init__(motion, CheckedSurfaces.of(workspace), exposed_starts(motion.arm))
        self._workspace = workspace
        self._levers = levers
        self.unit = levers.greatest

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """What is known of the errors that the gaps of pairs survive."""
        travels = self.motion.travels(stretches)
        during = self._levers.to_surfaces(poses, travels, pairs) / self.unit
        middle = self._levers.to_surfaces(poses, np.zeros_like(travels), pairs) / self.unit
        clearance = self._workspace.clearance
        known = super().measure(stretches, poses, pairs, cutoff * during + clearance)
        return _in_error(known, during, middle, clearance)

    def where(self, near: Nearest) -> tuple[str, FloatArray]:
        """What limits the error, in words, and its triangle."""
        return repr(self.surfaces.name_of(near.other)), self.surfaces.parts[near.other - self.surfaces.offsets[-2]]


class _LinksWithErrors(LinkProof):
    """Gaps between links, likewise; arguments as above."""

    def __init__(self, motion: ChainMotion, levers: ErrorLevers) -> None:
        super().__init__(motion, 2.0 * motion.arm.radius)
        self._levers = levers
        self.unit = levers.greatest

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """What is known of the errors that the gaps of pairs survive."""
        travels = self.motion.travels(stretches)
        during = self._levers.to_links(poses, travels, pairs) / self.unit
        middle = self._levers.to_links(poses, np.zeros_like(travels), pairs) / self.unit
        return _in_error(super().measure(stretches, poses, pairs, cutoff * during), during, middle)

    @staticmethod
    def where(near: Nearest) -> tuple[str, None]:
        """What limits the error, in words; it is no triangle."""
        return f"link {near.other + 1}", None


def _in_error(known: Measured, during: FloatArray, middle: FloatArray, taken: float = 0.0) -> Measured:
    """What is known of gaps beyond what is taken, each divided by its share of the greatest lever."""
    return replace(
        known, least=(known.least - taken) / during, most=(known.most - taken) / middle, travel=known.travel / during
    )


def _proofs(
    motion: ChainMotion, workspace: Workspace, model: ErrorModel, inside: float
) -> list[_SurfacesWithErrors | _LinksWithErrors]:
    """What has to be proved: that the arm keeps off the scene, and off itself."""
    arm = motion.arm
    levers = ErrorLevers(arm, model, inside)
    proofs: list[_SurfacesWithErrors | _LinksWithErrors] = []
    if len(workspace.soup) and np.any(exposed_starts(arm) < 1.0):
        proofs.append(_SurfacesWithErrors(motion, workspace, levers))
    if model.with_itself and arm.self_collision and first_distant(arm) < arm.links:
        proofs.append(_LinksWithErrors(motion, levers))
    return proofs


def _named(
    model: ErrorModel, size: float, proof: _SurfacesWithErrors | _LinksWithErrors, near: Nearest
) -> SurvivedError:
    """The error with what limits it."""
    motion = proof.motion
    name, triangle = proof.where(near)
    where = f"link {near.link + 1} to {name} at t = {near.time:.4f} s"
    samples = np.interp(near.time, motion.time, np.arange(len(motion.time)))
    q = np.array([np.interp(samples, np.arange(len(motion.time)), column) for column in motion.positions.T])
    limiting = LimitingPair(motion.arm, near.link, near.other, triangle)
    worst = limiting.worst(q, DEFAULT_VERIFICATION.inside) if np.any(model.turns[1:]) else ()
    link = max(near.link, near.other) if triangle is None else near.link
    return SurvivedError(model.name, size, model.unit, where, near.time, link + 1, worst, limiting.place(q))
