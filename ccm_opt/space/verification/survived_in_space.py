"""The largest errors with which a timed motion in space keeps its clearance, and off itself, at all times.

The proof is that of the gap, with every gap divided by the lever that errors have there: what is left of it is the
error that it survives. It is certified for the greatest share of the least such error that was met which can be proved.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.scene import SpaceWorkspace
from ccm_opt.space.verification.checked_surfaces import CheckedSurfaces
from ccm_opt.space.verification.error_levers import ErrorLevers
from ccm_opt.space.verification.limiting_pair import LimitingPair
from ccm_opt.space.verification.space_chain_motion import SpaceChainMotion, TimeStretches
from ccm_opt.space.verification.space_clearance import SurfaceProof, exposed_shares
from ccm_opt.space.verification.space_contact import axis_distances, first_apart, relative_travels
from ccm_opt.space.verification.space_proof_settings import DEFAULT_SPACE_PROOF
from ccm_opt.space.verification.stretch_proof import Measured, StretchPairs, prove_stretches
from ccm_opt.verification.bisection import Nearest, Verdict
from ccm_opt.verification.rounding import distance_rounding
from ccm_opt.verification.tolerance.error_model import (
    ErrorModel,
    base_heading_error,
    base_position_error,
    joint_errors,
    link_length_errors,
    wall_errors,
)
from ccm_opt.verification.tolerance.tolerance_settings import DEFAULT_TOLERANCE, ToleranceSettings
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

MODELS = (joint_errors, link_length_errors, base_heading_error, base_position_error, wall_errors)
"""Everything that may be wrong with the geometry."""


def survived_errors_in_space(
    problem: SpaceProblem, trajectory: JointTrajectory, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> tuple[SurvivedError, ...]:
    """The largest errors of every kind, one kind at a time; arguments as for ``survived_error_in_space``."""
    return tuple(survived_error_in_space(problem, trajectory, make(problem.arm), settings) for make in MODELS)


def survived_error_in_space(
    problem: SpaceProblem,
    trajectory: JointTrajectory,
    model: ErrorModel,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
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
    """
    motion = SpaceChainMotion(problem.arm, trajectory.time, trajectory.positions)
    numbers = DEFAULT_VERIFICATION.for_problem(problem)
    proofs = _proofs(motion, problem.workspace, model, numbers.inside)
    largest = _largest(problem.arm, model, settings)
    verdicts = [proof.proved(0.0, numbers) for proof in proofs]
    if not all(verdict.proved for verdict in verdicts):
        number = next(k for k, verdict in enumerate(verdicts) if not verdict.proved)
        return _named(model, 0.0, proofs[number], verdicts[number].nearest)
    met = [verdict.nearest.gap / proof.unit for verdict, proof in zip(verdicts, proofs, strict=True)]
    if not proofs or min(met) >= largest:
        return SurvivedError(model.name, largest, model.unit, "nothing; larger errors are not looked at", limited=False)
    first = int(np.argmin(met))
    for share in settings.proved_shares:
        size = share * met[first]
        if all(proof.proved(size * proof.unit, numbers).proved for proof in proofs):
            break
    else:
        size = 0.0
    return _named(model, size, proofs[first], verdicts[first].nearest)


def _largest(arm: SpaceArm, model: ErrorModel, settings: ToleranceSettings) -> float:
    """Errors above this are not looked at [unit]."""
    turned = float(np.sum(model.turns))
    return settings.largest_turn / turned if turned > 0.0 else settings.largest_length * arm.length


class _SurfacesWithErrors(SurfaceProof):
    """Gaps to surfaces, as errors that they survive, times the greatest lever.

    Args:
        motion: of the arm.
        workspace: its scene.
        levers: of the errors.
    """

    def __init__(self, motion: SpaceChainMotion, workspace: SpaceWorkspace, levers: ErrorLevers) -> None:
        super().__init__(motion, CheckedSurfaces.of(workspace.soup), exposed_shares(motion.arm))
        self._workspace = workspace
        self._levers = levers
        self.unit = levers.greatest

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: StretchPairs, cutoff: FloatArray | float
    ) -> Measured:
        """What is known of the errors that the gaps of pairs survive."""
        travels = self.motion.travels(stretches)
        during = self._levers.to_surfaces(poses, travels, pairs) / self.unit
        middle = self._levers.to_surfaces(poses, np.zeros_like(travels), pairs) / self.unit
        clearance = self._workspace.clearance
        known = super().measure(stretches, poses, pairs, cutoff * during + clearance)
        return _in_error(known, during, middle, clearance)

    def proved(self, least: float, settings: VerificationSettings) -> Verdict:
        """Whether all gaps survive an error, times the greatest lever."""
        return self.prove(least, settings, DEFAULT_SPACE_PROOF)

    def where(self, near: Nearest) -> tuple[str, FloatArray]:
        """What limits the error, in words, and its triangle."""
        number = near.other - self.surfaces.offsets[-2]
        name = self._workspace.soup.names[self.surfaces.owner[number]]
        return repr(name), self.surfaces.triangles[number]


class _LinksWithErrors:
    """Gaps between links, likewise; arguments as above."""

    def __init__(self, motion: SpaceChainMotion, levers: ErrorLevers) -> None:
        self.motion = motion
        self._levers = levers
        self.unit = levers.greatest

    def proved(self, least: float, settings: VerificationSettings) -> Verdict:
        """Whether all gaps survive an error, times the greatest lever."""
        motion = self.motion
        arm = motion.arm
        blocks = TimeStretches.blocks(len(motion.time), DEFAULT_SPACE_PROOF.block)
        first, second = np.triu_indices(arm.links, first_apart(arm.link_length, arm.radius))
        stretch = np.repeat(np.arange(len(blocks)), len(first))
        pairs = StretchPairs(stretch, np.tile(first, len(blocks)), np.tile(second, len(blocks)))
        return prove_stretches(motion, blocks, pairs, self._measure, least, settings)

    def _measure(self, stretches: TimeStretches, poses: FloatArray, pairs: StretchPairs, _: float) -> Measured:
        motion = self.motion
        k = pairs.stretch
        i = pairs.link
        j = pairs.other
        apart = axis_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1]) - 2.0 * motion.arm.radius
        lost = 2.0 * motion.rounding + distance_rounding(float(np.max(np.abs(motion.points))))
        travels = motion.travels(stretches)
        during = self._levers.to_links(poses, travels, pairs) / self.unit
        middle = self._levers.to_links(poses, np.zeros_like(travels), pairs) / self.unit
        exact = np.ones(len(pairs), dtype=bool)
        return _in_error(
            Measured(apart - lost, apart, relative_travels(motion, stretches, pairs), exact), during, middle
        )

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
    motion: SpaceChainMotion, workspace: SpaceWorkspace, model: ErrorModel, inside: float
) -> list[_SurfacesWithErrors | _LinksWithErrors]:
    """What has to be proved: that the arm keeps off the scene, and off itself."""
    arm = motion.arm
    levers = ErrorLevers(arm, model, inside)
    proofs: list[_SurfacesWithErrors | _LinksWithErrors] = []
    if len(workspace.soup) and np.any(exposed_shares(arm) < 1.0):
        proofs.append(_SurfacesWithErrors(motion, workspace, levers))
    if model.with_itself and arm.self_collision and first_apart(arm.link_length, arm.radius) < arm.links:
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
