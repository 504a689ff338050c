"""The record of an output folder, read back: results of the solve, checks and curves."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import read_plain
from ccm_opt.io.folder import ARRAYS, RECORD
from ccm_opt.problem.solution import Check, NearPlace, ToleratedError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import CurvatureSegment

MOST_BYTES = 2**26
"""Maximum size of a JSON record [bytes]. Derived: ten times that for a drawing of the maximum number of vertices."""


def read_record(path: Path) -> Mapping[str, object]:
    """Return the parsed JSON record of an output folder.

    Args:
        path: path of ``solution.json``.

    Raises:
        ProblemError: the record is missing or not readable.
    """
    try:
        content = read_plain(path, MOST_BYTES).decode("utf-8")
        record = json.loads(content, parse_constant=_refuse_constant, object_pairs_hook=_each_once)
    except FileNotFoundError:
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'") from None
    except NotADirectoryError:
        raise ProblemError(
            f"{path.parent}: this is not a folder; expected a folder written by 'ccm-opt solve'"
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise ProblemError(f"{path}: not readable as JSON: {error}") from error
    if not isinstance(record, Mapping):
        raise ProblemError(f"{path}: expected a JSON object, got {type(record).__name__}")
    return record


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not valid JSON")


def _each_once(pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    """Return a JSON object as a dictionary; repeated keys, which programs interpret differently, are refused.

    Raises:
        ValueError: a key is repeated.
    """
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key '{twice[:60]}' occurs twice")
    return table


CONSTRAINT_PREFIX = "constraint "
"""Prefix of the names of checks of the user's own constraints; the name of the constraint follows."""


@dataclass(frozen=True)
class RecordedResults:
    """The results stored in the record of an output folder.

    Attributes:
        figures: figures of merit by name; None for those that are not finite.
        checks: verifier's checks in the order of the record; NaN for numbers that are not finite.
        verdict: outcome of the simulation, by the field names of ``SimulationVerdict``.
        tolerance: maximum errors of each kind that the motion tolerates; empty if they were not requested.
        data: the whole record.
        timings: CPU time of each stage of planning, by stage name [s].
        versions: versions of the packages with which the plan was made, by name.
        timed_by: methods that timed the parts of the motion, in order.
    """

    figures: Mapping[str, float | None]
    checks: tuple[Check, ...]
    verdict: Mapping[str, object]
    tolerance: tuple[ToleratedError, ...]
    data: Mapping[str, object]
    timings: Mapping[str, float]
    versions: Mapping[str, str]
    timed_by: tuple[str, ...]

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the user's constraints on the plan, in the order of the record."""
        names = [check.name for check in self.checks if check.name.startswith(CONSTRAINT_PREFIX)]
        return tuple(name.removeprefix(CONSTRAINT_PREFIX) for name in names)


def recorded_results(folder: Path) -> RecordedResults:
    """Return the results stored in the record of an output folder.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: the record is missing or unreadable, or its results are malformed.
    """
    record: Mapping[str, Any] = read_record(folder / RECORD)
    try:
        figures = {name: number_or_none(value) for name, value in record["metrics"].items()}
        verdict = {str(name): value for name, value in record["simulation"].items()}
        verdict["outcome"] = str(verdict["outcome"])
        tolerance = tuple(_tolerated_error(each) for each in _listed(record.get("tolerance", [])))
        checks = tuple(map(_check, _listed(record["checks"])))
        timings = {str(name): number_or_none(value) or 0.0 for name, value in record.get("timings", {}).items()}
        versions = {str(name): str(value) for name, value in record.get("versions", {}).items()}
        timed_by = tuple(map(str, _listed(record.get("timed_by", []))))
        return RecordedResults(figures, checks, verdict, tolerance, record, timings, versions, timed_by)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        what = "metrics, checks, tolerance or simulation are not readable"
        raise ProblemError(f"{folder / RECORD}: {what}: {error}") from error


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {type(value).__name__}")
    return value


def _check(data: Mapping[str, Any]) -> Check:
    worst, limit = (number_or_none(data[name]) for name in ("worst", "limit"))
    return Check(
        str(data["name"]),
        math.nan if worst is None else worst,
        math.nan if limit is None else limit,
        str(data["unit"]),
        str(data["where"]),
        passed=data["passed"] is True,
    )


def _tolerated_error(data: Mapping[str, Any]) -> ToleratedError:
    """Return an error that a plan tolerates, read from its entry in the record.

    Raises:
        ValueError: the size is missing, or differs from the size in degrees.
    """
    size, degrees = (number_or_none(data.get(name)) for name in ("size", "size_deg"))
    if size is None or (degrees is not None and not math.isclose(degrees, math.degrees(size), rel_tol=1e-9)):
        raise ValueError(f"the size of an error is {size!r} rad, but {degrees!r} degrees")
    link = data.get("link")
    return ToleratedError(
        str(data["name"]),
        size,
        str(data["unit"]),
        str(data["where"]),
        time=number_or_none(data.get("time")),
        link=None if link is None else int(link),
        worst=tuple(map(float, data.get("worst", ()))),
        place=tuple(map(float, data.get("place", ()))),
        limited=data.get("limited", True) is True,
    )


def number_or_none(value: object) -> float | None:
    """Return a number in a record as a float, or None for null, which stands for a number that was not finite.

    Raises:
        TypeError: the value is neither a number nor null.
        ValueError: the number is too large for a double.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r:.60}")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("a number is too large")
    return number


def recorded_curves(arrays: Mapping[str, FloatArray], arm: Arm) -> tuple[Configuration, ...]:
    """Return the backbone curves to which a plan's keyframes were fitted, in order; empty for arms in space.

    Args:
        arrays: arrays of ``solution.npz``, by name.
        arm: the arm, whose base is the start of every curve.

    Raises:
        ProblemError: the arrays do not describe curves.
    """
    if "base_headings" not in arrays:
        return ()
    headings = arrays["base_headings"]
    lengths, curvatures, knots = (arrays[f"segment_{what}"] for what in ("lengths", "curvatures", "knots"))
    feeds = arrays.get("keyframe_feeds", np.zeros(len(headings)))
    base = arm.base + feeds[:, None] * (arm.direction if arm.feed else np.zeros(2))
    try:
        turns = _turns(lengths, curvatures, knots)
        spans = pairwise(arrays["segments_offsets"].astype(np.intp).tolist())
        return tuple(
            _curve(
                place, float(heading) + np.cumsum(turns[a:b]) - turns[a:b], lengths[a:b], curvatures[a:b], knots[a:b]
            )
            for place, heading, (a, b) in zip(base, headings, spans, strict=True)
        )
    except (ValueError, IndexError) as error:
        raise ProblemError(f"{ARRAYS}: the curves in it are not readable: {error}") from error


def _curve(
    base: FloatArray, headings: FloatArray, lengths: FloatArray, curvatures: FloatArray, knots: FloatArray
) -> Configuration:
    """Return a planar backbone curve from the arrays of its S segments.

    Args:
        base: start of the curve, shape (2,) [m].
        headings: heading at the start of each segment, shape (S,) [rad].
        lengths: lengths of the segments, shape (S,) [m].
        curvatures: curvatures of the segments, shape (S, 5) [1/m].
        knots: knots of the segments, shape (S, 3).
    """
    parts = zip(lengths.tolist(), headings.tolist(), curvatures, knots.tolist(), strict=True)
    return Configuration(base, tuple(CurvatureSegment(a, heading, c, tuple(k)) for a, heading, c, k in parts))


def _turns(lengths: FloatArray, curvatures: FloatArray, knots: FloatArray) -> FloatArray:
    """Return the change of heading along each of S curvature segments, shape (S,) [rad].

    It is the integral of the curvature, which is linear in the five curvature values. The integrals of the five basis
    splines are therefore computed once for all segments with equal knots.

    Args:
        lengths: lengths of the segments, shape (S,) [m].
        curvatures: curvature values of the segments, shape (S, 5) [1/m].
        knots: knots of the segments, as fractions of the length, shape (S, 3).
    """
    kinds, kind = np.unique(knots, axis=0, return_inverse=True)
    of_kinds = [
        [CurvatureSegment(1.0, 0.0, unit, tuple(each)).end_heading for unit in np.eye(5)] for each in kinds.tolist()
    ]
    shares = np.array(of_kinds).reshape(-1, 5)[kind.ravel()]
    return np.asarray(lengths * np.einsum("sk,sk->s", shares, curvatures))


def recorded_nearest(folder: Path) -> NearPlace | None:
    """Return the place of minimum clearance of a plan; None if the record has none, or nothing is near the arm.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: the record is missing or unreadable.
    """
    room = read_record(folder / RECORD).get("room")
    near = room.get("nearest") if isinstance(room, Mapping) else None
    if not isinstance(near, Mapping) or not near.get("link"):
        return None
    try:
        link, second = int(near["link"]), int(near.get("second_link", 0))
        return NearPlace(
            gap=float(near["gap"]),
            wanted=float(near["wanted"]),
            time=float(near["time"]),
            link=link,
            obstacle=str(near.get("obstacle", "")),
            second_link=second,
            name=str(near.get("name", f"link {link}")),
            second_name=str(near.get("second_name", f"link {second}" if second else "")),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ProblemError(f"{folder / RECORD}: the least gap in it is not readable: {error}") from error
