"""Where the record of a failure goes, or a plan that was cut short, when the folder of an earlier result is there."""

import itertools
from pathlib import Path

from ccm_opt.files.export.folder import ARRAYS, POSE_ARRAYS

FAILED = ".failed"
"""Added to the name of a folder whose earlier result stays, for the record of why there is no new one."""
UNFINISHED = ".unfinished"
"""The same for a verified plan whose simulation or pictures were cut short."""


def place_beside(target: Path, ending: str) -> Path:
    """The folder itself, or, where it holds an earlier result, one of nearly the same name beside it.

    Args:
        target: the folder of the result.
        ending: added to its name; a number follows where a result is there too, or something that no run wrote.

    Returns:
        A folder that may be written: it is new, or holds the record of an earlier failure.
    """
    if not holds_result(target):
        return target
    names = (f"{target.name}{ending}" + (f"-{number}" if number > 1 else "") for number in itertools.count(1))
    return next(place for name in names if _may_be_written(place := target.with_name(name)))


def holds_result(folder: Path) -> bool:
    """Whether a folder holds a plan or a pose, which only another plan or pose may replace."""
    return any((folder / arrays).is_file() for arrays in (ARRAYS, POSE_ARRAYS))


def _may_be_written(place: Path) -> bool:
    if not place.exists():
        return not place.is_symlink()
    return place.is_dir() and any(place.glob("*.json")) and not holds_result(place)
