"""Listens to every function of the proofs and the verifier, and keeps the sum of what each returns."""

import dataclasses
import math
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np
import shapely

import ccm_opt

ROOT = Path(ccm_opt.__file__).parent
PACKAGES = ("verification", "scene.bad_pose", "scene.certificate", "scene.contact_finder")
OWN = tuple(f"ccm_opt.{name}" for name in (*PACKAGES, "problem.solution", "core.errors"))
"""Packages of the types whose fields are recorded; other types, such as arms and workspaces, are inputs."""
DEEPEST = 4
TOLERANCE = 1e-8
"""Tolerated relative difference of a sum, since processors add in different orders."""

UNSTEADY = ("_called", "Message.coefficients")
"""Functions that return arrays which C code has filled only partly, and those whose figures are other ones on other
processors: the coefficients of a message are roundings of its points over powers of the time between them."""

Figure = tuple[int, int, float, float]
"""Number of calls, number of returned numbers, their weighted sum, and the weighted sum of their magnitudes."""


class Recorder:
    """Profiler that sums the numbers that functions return, by function name."""

    def __init__(self) -> None:
        self._names: dict[CodeType, str | None] = {}
        self._figures: dict[str, list[float]] = {}

    def __call__(self, frame: FrameType, event: str, value: object) -> None:
        """Record a return value; called by ``sys.setprofile``."""
        if event != "return":
            return
        code = frame.f_code
        if code not in self._names:
            self._names[code] = _name_of(code)
        name = self._names[code]
        if name is None:
            return
        numbers = np.concatenate([np.zeros(1), *_numbers(value, 0)])
        numbers = np.where(np.isnan(numbers), 7.7, np.clip(numbers, -1e300, 1e300))
        found = self._figures.setdefault(name, [0, 0, 0.0, 0.0])
        weights = np.cos(np.arange(len(numbers)) + 0.1 * found[0])
        weighed = np.where(np.abs(numbers) == 1e300, np.sign(numbers), numbers) * weights  # what is infinite counts 1
        found[0] += 1
        found[1] += len(numbers)
        found[2] += float(np.sum(weighed))
        found[3] += float(np.sum(np.abs(weighed)))

    def figures(self) -> dict[str, Figure]:
        """Return the recorded sums, by function name."""
        return {name: (int(a), int(b), c, d) for name, (a, b, c, d) in sorted(self._figures.items())}


@contextmanager
def listening() -> Iterator[Recorder]:
    """Record the return values of all functions called in a ``with`` block."""
    recorder = Recorder()
    before = sys.getprofile()
    sys.setprofile(recorder)
    try:
        yield recorder
    finally:
        sys.setprofile(before)


def figures_of(scene: Callable[[float], object], scale: float = 1.0) -> dict[str, Figure]:
    """Return the recorded sums of all functions that a scene calls, without those of other scenes.

    Args:
        scene: function of a factor on all lengths of the arm.
        scale: the factor.
    """
    with np.errstate(all="ignore"), listening() as recorder:
        scene(scale)
    return recorder.figures()


def changed(old: Mapping[str, Figure], new: Mapping[str, Figure]) -> list[str]:
    """Return the names of functions whose sums differ, and of those that are only in one of the two records."""
    return [name for name in old if name in new and not _alike(old[name], new[name])]


def _alike(old: Figure, new: Figure) -> bool:
    if tuple(old[:2]) != tuple(new[:2]):
        return False
    most = TOLERANCE * max(old[3], new[3])
    return abs(old[2] - new[2]) <= most and abs(old[3] - new[3]) <= most


def _name_of(code: CodeType) -> str | None:
    path = Path(code.co_filename)
    if not path.is_relative_to(ROOT):
        return None
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    if not module.startswith(PACKAGES):
        return None
    # Anonymous pieces of code are named by where they stand, which moves; their function's value has theirs in it.
    if "<" in code.co_name or code.co_qualname in UNSTEADY:
        return None
    return f"{module}:{code.co_qualname.replace('.<locals>', '')}"


def _numbers(value: Any, depth: int) -> Iterator[np.ndarray]:
    """Yield all numbers in a value as arrays; texts are converted to numbers."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        flat = value.ravel()
        yield from (
            (np.real(flat).astype(np.float64), np.imag(flat).astype(np.float64))
            if value.dtype.kind == "c"
            else (flat.astype(np.float64),)
        )
    elif isinstance(value, (bool, int, float, np.generic)) and not isinstance(value, np.str_):
        yield (
            np.array([float(value)])
            if not isinstance(value, np.complexfloating)
            else np.array([value.real, value.imag])
        )
    elif isinstance(value, str):
        yield np.array([zlib.crc32(value.encode()) / 2.0**32])
    elif isinstance(value, shapely.Geometry):
        yield np.array([value.area, value.length])
    elif depth < DEEPEST:
        for part in _parts(value):
            yield from _numbers(part, depth + 1)


def _is_result(kind: type) -> bool:
    """Return whether a type is that of results, not of settings, whose fields may change."""
    return kind.__module__.startswith(OWN) and not kind.__name__.endswith("Settings")


def _parts(value: Any) -> Iterator[Any]:
    if isinstance(value, (tuple, list)):
        yield float(len(value))
        yield from value
    elif isinstance(value, dict):
        yield from value.values()
    elif dataclasses.is_dataclass(value) and _is_result(type(value)):
        yield from (getattr(value, field.name) for field in dataclasses.fields(value))
    elif value is None:
        yield math.pi
