"""The largest geometric errors that a plan tolerates without contact, certified at all times.

The proof is that for gaps (``gap_proof``), with every gap converted to the largest error that leaves the gap open.
The error that all pairs of bodies are proved to tolerate at all times is certified. The least tolerated error found at
a known place and time shows that no larger error could be certified with these bounds.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory, ToleratedError
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.body_sides import nearest_lines
from ccm_opt.verification.chain_motion import ChainMotion, TimeIntervals, base_displacement, chain_points
from ccm_opt.verification.gap_proof import Measured, Nearest, Pairs
from ccm_opt.verification.selfcollision import LinkProof, distant_pairs, segment_distances, travels_in_frame
from ccm_opt.verification.tolerance.error_model import (
    DEFAULT_TOLERANCE,
    DisplacementBounds,
    ErrorLevers,
    ErrorModel,
    JointRanges,
    ToleranceSettings,
    error_at_contact,
    error_models,
    largest_error,
)
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.wall_clearance import CheckedSurfaces, WallProof, exposed_starts, is_empty, link_axes

_AT_ONCE = 4096
"""Number of pairs per batch when displacements along directions are bounded. Heuristic: about 10 MB."""
_STEP = 1e-6
"""Change of a bend for finite differences of gaps [rad]."""
_PLACES = 65
"""Number of points along a link among which the point nearest to another body is searched for."""


def tolerated_errors(
    problem: Problem, trajectory: JointTrajectory, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> tuple[ToleratedError, ...]:
    """Return the largest tolerated error of every kind, one kind at a time; arguments as for ``tolerated_error``."""
    return tuple(tolerated_error(problem, trajectory, model, settings) for model in error_models(problem.arm).values())


def tolerated_error(
    problem: Problem,
    trajectory: JointTrajectory,
    model: ErrorModel,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
    most: float = np.inf,
) -> ToleratedError:
    """Return the largest error of one kind that causes no contact, certified for all times of a motion.

    Every motion that differs from the planned one by at most this error at all times keeps the clearance from every
    wall, beyond the mount, and, if the arm must avoid itself, a distance of two radii between the axes of links far
    apart along the arm. Joints that a guide tube holds straight have no error.

    Args:
        problem: the problem, with the arm, its scene and the clearance.
        trajectory: the planned motion, linear between its samples, which keeps the clearance.
        model: the error model.
        settings: settings of the search.
        most: largest error that is examined, in the unit of the model; a larger tolerated error is reported as this
            value.
    """
    motion = ChainMotion(problem.arm, trajectory.time, trajectory.positions)
    finely = replace(
        DEFAULT_VERIFICATION,
        report_resolution=0.0,
        report_share=settings.precision,
        most_report_pairs=DEFAULT_VERIFICATION.most_pairs,
    )
    numbers = finely.for_problem(problem)
    levers = ErrorLevers(problem.arm, model, numbers.inside)
    proofs = _proofs(motion, problem.workspace, levers)
    largest = min(most, largest_error(problem.arm, model, settings))
    kept = largest * levers.greatest
    # Values that are not refined below this starting value are at least the largest error examined.
    nearest = Nearest(kept / (1.0 - settings.precision))
    limiting: _SurfacesWithErrors | _LinksWithErrors | None = None
    for proof in proofs:
        verdict = proof.prove(0.0, numbers, nearest)
        if not verdict.proved:
            return _named(model, 0.0, proof, verdict.nearest)
        limiting = proof if verdict.nearest.gap < nearest.gap else limiting
        nearest = verdict.nearest
        kept = min(kept, verdict.kept)
    size = kept / levers.greatest
    if limiting is None or size >= largest:
        return ToleratedError(model.name, largest, model.unit, "nothing; larger errors are not examined", limited=False)
    return _named(model, size, limiting, nearest)


class _SurfacesWithErrors(WallProof):
    """A proof of the largest errors that the gaps to surfaces tolerate.

    Each error is multiplied by the greatest displacement per unit of error, so that it is a length like a gap.

    Args:
        motion: motion of the arm.
        workspace: the scene.
        levers: displacements per unit of error.
    """

    def __init__(self, motion: ChainMotion, workspace: Workspace, levers: ErrorLevers) -> None:
        super().__init__(motion, CheckedSurfaces.from_workspace(workspace), exposed_starts(motion.arm))
        self.of_links = False
        self.clearance = workspace.clearance
        self.levers = levers
        self.unit = levers.greatest

    def measure(
        self, intervals: TimeIntervals, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """Return bounds on the errors that the gaps of links to surfaces tolerate; see ``WallProof.measure``."""
        return _in_errors(self, super().measure, intervals, poses, pairs, cutoff)

    def along_lines(
        self, intervals: TimeIntervals, poses: FloatArray, travels: FloatArray, pairs: Pairs, travel: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the errors tolerated along shortest lines to surfaces, throughout and at mid-interval, each (P,)."""
        del travel
        k, link = pairs.interval, pairs.link
        ends = np.stack(link_axes(poses, pairs, self._exposed), axis=1)
        parts = self.surfaces.edge_parts(pairs.other)
        normals = _lines(ends, parts)
        joint_ranges = JointRanges(k, np.zeros_like(link), link, fixed=True)
        moved = np.maximum(travels[k, link], travels[k, link + 1])
        of_ends = self.levers.along(poses, travels, joint_ranges, ends, moved, normals, outwards=True)
        of_parts = self.levers.along(poses, travels, joint_ranges, parts, np.zeros(len(link)), normals, outwards=False)
        taken = self.motion.arm.radii.take(link) + self.surfaces.rounding.take(pairs.other) + self.clearance
        lost = self._length_loss + self._travel_along(intervals, travels, pairs, normals)
        return _tolerated_between(ends, parts, normals, taken, lost, of_ends, of_parts)

    def _travel_along(
        self, intervals: TimeIntervals, travels: FloatArray, pairs: Pairs, normals: FloatArray
    ) -> FloatArray:
        """Return bounds on the travel of link ends along directions (P, d) from mid-interval, shape (P,) [m].

        Within a step between samples, only the components of the displacements along the directions count.
        """
        k = pairs.interval
        within = ((intervals.high - intervals.low) <= 1.0)[k]
        chords = self.motion.poses(intervals.high) - self.motion.poses(intervals.low)
        travel = np.zeros(len(k))
        for joint in (pairs.link, pairs.link + 1):
            chord = chords[k, joint]
            aside = lengths_of(chord) - np.abs(np.einsum("pd,pd->p", chord, normals))
            travel = np.maximum(travel, travels[k, joint] - 0.5 * np.where(within, aside, 0.0))
        return travel

    def where(self, near: Nearest) -> tuple[str, FloatArray]:
        """Return the name of the obstacle that limits the tolerated error, and its nearest edge or triangle."""
        return repr(self.surfaces.name_of(near.other)), self.surfaces.edge_parts(np.array([near.other]))[0]


class _LinksWithErrors(LinkProof):
    """A proof of the largest errors that the gaps between links tolerate.

    Each error is multiplied by the greatest displacement per unit of error, so that it is a length like a gap.

    Args:
        motion: motion of the arm.
        levers: displacements per unit of error.
    """

    def __init__(self, motion: ChainMotion, levers: ErrorLevers) -> None:
        super().__init__(motion, motion.arm.radii)
        self.of_links = True
        self.clearance = 0.0
        self.levers = levers
        self.unit = levers.greatest

    def measure(
        self, intervals: TimeIntervals, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """Return bounds on the errors that the gaps between links tolerate; see ``LinkProof.measure``."""
        return _in_errors(self, super().measure, intervals, poses, pairs, cutoff)

    def along_lines(
        self, intervals: TimeIntervals, poses: FloatArray, travels: FloatArray, pairs: Pairs, travel: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the errors that links tolerate along shortest lines, throughout intervals and at mid-interval, (P,).

        `travel` is the loss of gap by the motion of the links, shape (P,) [m].
        """
        k, i, j = pairs.interval, pairs.link, pairs.other
        first = np.stack((poses[k, i], poses[k, i + 1]), axis=1)
        second = np.stack((poses[k, j], poses[k, j + 1]), axis=1)
        normals = _lines(second, first)
        joint_ranges = JointRanges(k, i + 1, j, fixed=False)
        # Directions may be fixed in the world or turn with either link; levers grow by that and by the joints' travel.
        turning = 2.0 * travels_in_frame(self.motion, intervals, k, i, j)
        moved = [np.maximum(np.maximum(travels[k, link], travels[k, link + 1]), turning) for link in (j, i)]
        of_second = self.levers.along(poses, travels, joint_ranges, second, moved[0], normals, outwards=True)
        of_first = self.levers.along(poses, travels, joint_ranges, first, moved[1], normals, outwards=False)
        lost = self._length_loss + travel
        taken = self.radii.take(i) + self.radii.take(j)
        return _tolerated_between(second, first, normals, taken, lost, of_second, of_first)

    @staticmethod
    def where(near: Nearest) -> tuple[str, None]:
        """Return the name of the link that limits the tolerated error, and None in place of an edge or triangle."""
        return f"link {near.other + 1}", None


def _in_errors(
    proof: "_SurfacesWithErrors | _LinksWithErrors",
    measure: Callable[..., Measured],
    intervals: TimeIntervals,
    poses: FloatArray,
    pairs: Pairs,
    cutoff: FloatArray | float,
) -> Measured:
    """Return bounds on tolerated errors, from greatest displacements or, where too rough, along shortest lines.

    Args:
        proof: the proof that uses the bounds.
        measure: function that bounds the gaps themselves, as for ``prove_gaps``.
        intervals: time intervals.
        poses: positions of joints and tip at mid-interval, shape (S, links + 1, d) [m].
        pairs: pairs of bodies in the intervals.
        cutoff: tolerated error, times the greatest displacement per unit, above which bounds may be rough [m].
    """
    travels = proof.motion.travels(intervals)
    during, middle = (
        proof.levers.of_pairs(poses, moved, pairs, of_links=proof.of_links) / proof.unit
        for moved in (travels, np.zeros_like(travels))
    )
    known = measure(intervals, poses, pairs, cutoff * during + proof.clearance)
    least = error_at_contact(known.least - proof.clearance, during)
    # Bounds along lines are better than those by levers; for boxes, levers only serve as a first guess at moments.
    counts = np.where(known.exact, least < cutoff, known.travel == 0.0)
    most = np.where(counts, error_at_contact(known.most - proof.clearance, middle), np.inf)
    close = np.flatnonzero(known.exact & (least < cutoff))
    for some in np.split(close, range(_AT_ONCE, len(close), _AT_ONCE)):
        kept, met = proof.along_lines(intervals, poses, travels, pairs.where(some), known.travel[some])
        least[some] = np.maximum(least[some], proof.unit * kept)
        most[some] = np.maximum(most[some], proof.unit * met)
    return replace(known, least=least, most=most)


def _lines(ends: FloatArray, parts: FloatArray) -> FloatArray:
    """Return unit vectors along the shortest lines from parts (P, 2 or 3, d) to segments (P, 2, d), shape (P, d)."""
    dimension = ends.shape[2]
    flat = [(0, 0), (0, 0), (0, 3 - dimension)]
    # An edge is treated as a triangle of zero area.
    corners = np.pad(parts, flat)[:, [0, 1, -1]]
    both = np.pad(ends, flat)
    return nearest_lines(both[:, 0], both[:, 1], corners)[:, :dimension]


def _tolerated_between(
    ends: FloatArray,
    parts: FloatArray,
    normals: FloatArray,
    taken: FloatArray,
    lost: FloatArray,
    of_ends: DisplacementBounds,
    of_parts: DisplacementBounds,
) -> tuple[FloatArray, FloatArray]:
    """Return the largest errors for which a plane with a given normal separates segments from other bodies.

    Either the segment or the other body is taken to be moved by errors; the better bound counts.

    Args:
        ends: ends of the segments, shape (P, 2, d) [m].
        parts: e corners of the other bodies, shape (P, e, d) [m].
        normals: normals of the planes as unit vectors, shape (P, d).
        taken: part of the distance that is not available for errors, shape (P,) [m].
        lost: bounds on the loss of gap between mid-interval and any other time of the interval, shape (P,) [m].
        of_ends: bounds on the distances by which errors move the ends.
        of_parts: bounds on the distances by which errors move the corners.

    Returns:
        Errors tolerated throughout the time intervals, and at mid-interval, each of shape (P,), in the unit of the
        error.
    """
    # Projections are relative to a corner, so that points far from the origin lose no digits.
    origin = parts[:, :1]
    highs = np.einsum("ped,pd->pe", ends - origin, normals)
    lows = np.einsum("ped,pd->pe", parts - origin, normals)
    kept, met = [], []
    for gaps, bounds in (
        (highs - lows.max(axis=1, keepdims=True), of_ends),
        (highs.min(axis=1, keepdims=True) - lows, of_parts),
    ):
        room = gaps - taken[:, None]
        kept.append(error_at_contact(room - lost[:, None], bounds.throughout, bounds.quadratic).min(axis=1))
        met.append(error_at_contact(room, bounds.at_middle, bounds.quadratic).min(axis=1))
    return np.maximum(*kept), np.maximum(*met)


def _proofs(
    motion: ChainMotion, workspace: Workspace, levers: ErrorLevers
) -> list[_SurfacesWithErrors | _LinksWithErrors]:
    """Return the proofs that are needed: that the arm stays clear of the scene and, if required, of itself."""
    arm = motion.arm
    proofs: list[_SurfacesWithErrors | _LinksWithErrors] = []
    if not is_empty(workspace) and np.any(exposed_starts(arm) < 1.0):
        proofs.append(_SurfacesWithErrors(motion, workspace, levers))
    if levers.model.with_itself and arm.self_collision and len(distant_pairs(arm)[0]):
        proofs.append(_LinksWithErrors(motion, levers))
    return proofs


def _named(
    model: ErrorModel, size: float, proof: _SurfacesWithErrors | _LinksWithErrors, near: Nearest
) -> ToleratedError:
    """Return a tolerated error with the bodies that limit the error: a link and an edge or triangle, or two links."""
    motion = proof.motion
    link, other = near.link, near.other
    name, part = proof.where(near)
    q = np.array([np.interp(near.time, motion.time, column) for column in motion.positions.T])

    def away(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the distances of segments from the surface or the other link in poses (N, links + 1, d), (N,) [m]."""
        if part is None:
            return segment_distances(start, end, points[:, other], points[:, other + 1])
        return CheckedSurfaces.between(start, end, np.broadcast_to(part, (len(start), *part.shape)))[1]

    def gap(poses: FloatArray) -> FloatArray:
        """Return the distances of the link from the other body in configurations (N, c), shape (N,) [m]."""
        points = chain_points(motion.arm, poses)
        return away(points, points[:, link], points[:, link + 1])

    worst = _worst_signs(motion.arm, q, gap) if np.any(model.turns[1:]) else ()
    pose = np.repeat(chain_points(motion.arm, q[None]), _PLACES, axis=0)
    share = np.linspace(0.0, 1.0, _PLACES)[:, None]
    along = (1.0 - share) * pose[:, link] + share * pose[:, link + 1]
    nearest = along[np.argmin(away(pose, along, along))]
    return ToleratedError(
        model.name,
        size,
        model.unit,
        f"link {link + 1} to {name} at t = {near.time:.4f} s",
        near.time,
        1 + (max(link, other) if part is None else link),
        worst,
        tuple(float(value) for value in nearest),
    )


def _worst_signs(arm: Arm, q: FloatArray, gap: Callable[[FloatArray], FloatArray]) -> tuple[float, ...]:
    """Return the signs of the bend errors that reduce a gap fastest, shape (bends,); 0 for bends that do not matter.

    Args:
        arm: the arm.
        q: the configuration, shape (c,) [rad, m].
        gap: function that returns the gaps in configurations (N, c), shape (N,) [m].
    """
    bends = arm.coordinates.joints
    distances = gap(np.vstack((q, q + _STEP * np.eye(bends, len(q)))))
    signs = -np.sign(distances[1:] - distances[0])
    out = float(base_displacement(arm, q[None])[0]) + arm.joint_places[:-1] - arm.hole
    # A joint inside the guide tube is held straight and has no error.
    inside = DEFAULT_VERIFICATION.inside
    held = np.repeat(out < -inside, bends // arm.links) if arm.base_axes else np.zeros(bends, dtype=bool)
    return tuple(float(sign) + 0.0 for sign in np.where(held, 0.0, signs))
