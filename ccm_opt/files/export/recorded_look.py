"""What pictures of a written plan show besides its motion: its curves, its least gap, the simulated arm in space."""

import json
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ProblemError
from ccm_opt.files.export.folder import ARRAYS, RECORD
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
        spans = list(pairwise(offsets.tolist()))
        return tuple(
            Configuration.chain(place, float(heading), lengths[a:b].tolist(), list(curvatures[a:b]), list(knots[a:b]))
            for place, heading, (a, b) in zip(base, headings, spans, strict=True)
        )
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise ProblemError(f"{folder / ARRAYS}: the curves in it are not readable: {error}") from error


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
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ProblemError(f"{folder / RECORD}: not readable as JSON: {error}") from error
    room = record.get("room")
    near = room.get("nearest") if isinstance(room, Mapping) else None
    if not isinstance(near, Mapping) or not near.get("link"):
        return None
    return NearPlace(
        gap=float(near["gap"]),
        wanted=float(near["wanted"]),
        time=float(near["time"]),
        link=int(near["link"]),
        obstacle=str(near.get("obstacle", "")),
        second_link=int(near.get("second_link", 0)),
    )
