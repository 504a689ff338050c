"""Records as they are read back."""

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
from ccm_opt.problem.solution import Check, NearPlace, SurvivedError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import CurvatureSegment

MOST_BYTES = 2**26
"""Larger records are not read. Derived: ten times what a drawing of as many vertices as are allowed takes as JSON."""


def read_record(path: Path) -> Mapping[str, object]:
    """The record of a folder.

    Args:
        path: of ``solution.json``.

    Raises:
        ProblemError: it is not there, or not readable.
    """
    try:
        content = read_plain(path, MOST_BYTES).decode("utf-8")
        record = json.loads(content, parse_constant=_refuse_constant, object_pairs_hook=_each_once)
    except FileNotFoundError:
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'") from None
    except NotADirectoryError:
        raise ProblemError(f"{path.parent}: this is no folder; expected a folder written by 'ccm-opt solve'") from None
    except (OSError, ValueError, RecursionError) as error:
        raise ProblemError(f"{path}: not readable as JSON: {error}") from error
    if not isinstance(record, Mapping):
        raise ProblemError(f"{path}: expected a JSON object, got {type(record).__name__}")
    return record


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no JSON")


def _each_once(pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    """A table; of a key that is there twice other programs would take the other value."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key '{twice[:60]}' is there twice")
    return table


CONSTRAINT_PREFIX = "constraint "
"""In front of the name of a user's constraint, in the name of its check."""


@dataclass(frozen=True)
class RecordedResults:
    """Results as a record has them.

    Attributes:
        figures: of merit, by name; those that are not finite are None.
        checks: in the order of the record; numbers that are not finite are nan.
        verdict: on the simulation, by the names of ``SimulationVerdict``.
        tolerance: errors that are survived; none where nobody asked.
        data: all of the record.
    """

    figures: Mapping[str, float | None]
    checks: tuple[Check, ...]
    verdict: Mapping[str, object]
    tolerance: tuple[SurvivedError, ...]
    data: Mapping[str, object]

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the user's constraints that the plan was made to keep, in order."""
        names = [check.name for check in self.checks if check.name.startswith(CONSTRAINT_PREFIX)]
        return tuple(name.removeprefix(CONSTRAINT_PREFIX) for name in names)


def recorded_results(folder: Path) -> RecordedResults:
    """The results in a folder.

    Args:
        folder: an output folder.

    Raises:
        ProblemError: when there is no readable record, or these are not what they should be.
    """
    record: Mapping[str, Any] = read_record(folder / RECORD)
    try:
        figures = {name: _number(value) for name, value in record["metrics"].items()}
        verdict = {str(name): value for name, value in record["simulation"].items()}
        verdict["outcome"] = str(verdict["outcome"])
        tolerance = tuple(_survived(each) for each in _listed(record.get("tolerance", [])))
        return RecordedResults(figures, tuple(map(_check, _listed(record["checks"]))), verdict, tolerance, record)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        what = "metrics, checks, tolerance or simulation are not readable"
        raise ProblemError(f"{folder / RECORD}: {what}: {error}") from error


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {type(value).__name__}")
    return value


def _check(data: Mapping[str, Any]) -> Check:
    worst, limit = (_number(data[name]) for name in ("worst", "limit"))
    return Check(
        str(data["name"]),
        math.nan if worst is None else worst,
        math.nan if limit is None else limit,
        str(data["unit"]),
        str(data["where"]),
        passed=data["passed"] is True,
    )


def _survived(data: Mapping[str, Any]) -> SurvivedError:
    """An error, its size in degrees being the same as that in radians, where there is one."""
    size, degrees = (_number(data.get(name)) for name in ("size", "size_deg"))
    if size is None or (degrees is not None and not math.isclose(degrees, math.degrees(size), rel_tol=1e-9)):
        raise ValueError(f"the size of an error is {size!r}, in degrees {degrees!r}")
    return SurvivedError(str(data["name"]), size, str(data["unit"]), str(data["where"]))


def _number(value: object) -> float | None:
    """A number; None for what is not finite, which stands as null."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"expected a number or null, got {value!r:.60}")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("a number is too large")
    return number


def recorded_curves(arrays: Mapping[str, FloatArray], arm: Arm) -> tuple[Configuration, ...]:
    """The curves behind a plan's keyframes, in order; none in space, where a folder has none.

    Args:
        arrays: of the motion.
        arm: whose base the curves begin at.

    Raises:
        ProblemError: the arrays are not those of curves.
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
