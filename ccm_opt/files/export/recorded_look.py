"""What pictures of a written plan show besides its motion: its curves, its least gap, the simulated arm in space."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.errors import ProblemError
from ccm_opt.files.export.folder import ARRAYS, RECORD
from ccm_opt.files.export.record_file import read_record
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.problem import Problem
from ccm_opt.solution import NearPlace


def recorded_curves(folder: Path, problem: Problem) -> tuple[Configuration, ...]:
    """The curves behind a plan's keyframes, in order.

    Args:
        folder: an output folder.
        problem: whose base the curves begin at.

    Raises:
        ProblemError: the folder's arrays are not those of curves.
    """
    try:
        with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
            offsets = arrays["segments_offsets"]
            lengths = arrays["segment_lengths"]
            curvatures = arrays["segment_curvatures"]
            knots = arrays["segment_knots"]
            headings = arrays["base_headings"]
            feeds = arrays["keyframe_feeds"] if "keyframe_feeds" in arrays.files else np.zeros(len(headings))
        base = problem.arm.base + feeds[:, None] * (problem.arm.feed_direction if problem.arm.feed else np.zeros(2))
        turns = _turns(lengths, curvatures, knots)
        return tuple(
            _curve(
                place, float(heading) + np.cumsum(turns[a:b]) - turns[a:b], lengths[a:b], curvatures[a:b], knots[a:b]
            )
            for place, heading, (a, b) in zip(base, headings, pairwise(offsets.tolist()), strict=True)
        )
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise ProblemError(f"{folder / ARRAYS}: the curves in it are not readable: {error}") from error


def _curve(
    base: FloatArray, headings: FloatArray, lengths: FloatArray, curvatures: FloatArray, knots: FloatArray
) -> Configuration:
    """A curve from its arrays, ``headings`` being those at which its segments begin."""
    parts = zip(lengths.tolist(), headings.tolist(), curvatures, knots.tolist(), strict=True)
    return Configuration(base, tuple(CurvatureSegment(a, heading, c, tuple(k)) for a, heading, c, k in parts))


def _turns(lengths: FloatArray, curvatures: FloatArray, knots: FloatArray) -> FloatArray:
    """By how much segments turn, shape (S,) [rad]: linear in the curvatures, alike for all of the same knots."""
    kinds, kind = np.unique(knots, axis=0, return_inverse=True)
    of_kinds = [
        [CurvatureSegment(1.0, 0.0, unit, tuple(each)).end_heading for unit in np.eye(5)] for each in kinds.tolist()
    ]
    shares = np.array(of_kinds).reshape(-1, 5)[kind.ravel()]
    return np.asarray(lengths * np.einsum("sk,sk->s", shares, curvatures))


def recorded_simulation(folder: Path, problem: Problem) -> FloatArray | None:
    """Joints and tip of the simulated arm in space, shape (T, links + 1, 3) [m]; None where there is no simulation.

    Args:
        folder: an output folder.
        problem: whose arm it is.

    Raises:
        ProblemError: the folder's arrays are not readable.
    """
    try:
        with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
            angles = np.asarray(arrays["simulated_angles"], dtype=np.float64)
            samples = len(arrays["time"])
            carried = np.asarray(
                arrays["simulated_feed"] if "simulated_feed" in arrays.files else np.zeros(len(angles))
            )
    except (OSError, ValueError, KeyError) as error:
        raise ProblemError(f"{folder / ARRAYS}: the simulation in it is not readable: {error}") from error
    if angles.shape != (samples, 3 * problem.arm.links) or carried.shape != (samples,):
        return None
    return joint_positions_3d(problem.arm, angles, carried)


def recorded_nearest(folder: Path) -> NearPlace | None:
    """Where the least gap of a plan is; None where its record does not say, or nothing is near.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: the record is not readable.
    """
    room = read_record(folder / RECORD).get("room")
    near = room.get("nearest") if isinstance(room, Mapping) else None
    if not isinstance(near, Mapping) or not near.get("link"):
        return None
    try:
        return NearPlace(
            gap=float(near["gap"]),
            wanted=float(near["wanted"]),
            time=float(near["time"]),
            link=int(near["link"]),
            obstacle=str(near.get("obstacle", "")),
            second_link=int(near.get("second_link", 0)),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ProblemError(f"{folder / RECORD}: the least gap in it is not readable: {error}") from error
