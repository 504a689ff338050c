"""Reads the arrays of an archive that somebody else may have made: nothing but expected ones, of a bounded size."""

import warnings
import zipfile
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.errors import ProblemError

MOST_BYTES_OF_ARRAYS = 2**29
"""Arrays that take more are not unpacked: a minute of motion of the longest arm takes less."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""How numpy packs arrays; no other program has to unpack them in another way."""


def read_archive(path: Path, known: Collection[str]) -> dict[str, npt.NDArray[np.generic]]:
    """The arrays of a file, by name, as they stand there.

    Args:
        path: of the archive.
        known: names of the arrays that it may hold.

    Raises:
        ProblemError: it cannot be read, or holds anything else.
    """
    if not path.is_file():
        raise ProblemError(f"{path}: there is no such file; expected a folder written by 'ccm-opt solve'")
    try:
        members = _members(path)
        _check_members(path, members, {f"{name}.npy" for name in known})
        arrays = _arrays(path)
    except ProblemError:
        raise
    except Exception as error:  # archives and their heads are parsed by others, with errors of a dozen kinds
        raise ProblemError(f"{path}: not readable as arrays: {error}") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):
            raise ProblemError(f"{path}: not readable as arrays: '{name}' is no array")
    return arrays


def _members(path: Path) -> Sequence[zipfile.ZipInfo]:
    """What is in an archive; nothing of it is unpacked."""
    if not zipfile.is_zipfile(path):
        raise ProblemError(f"{path}: not readable as arrays: it is not an .npz archive")
    with zipfile.ZipFile(path) as archive:
        return archive.infolist()


def _arrays(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    """All that an archive unpacks to."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of what numpy warns, and takes it all the same, it has not written
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}


def _check_members(path: Path, members: Sequence[zipfile.ZipInfo], known: Collection[str]) -> None:
    """Refuse, unread, an archive with anything but the arrays of the format, or with more than a plan can hold."""
    names = [member.filename for member in members]
    strange = next((name for name in names if name not in known or names.count(name) > 1), None)
    if strange is not None:
        raise ProblemError(f"{path}: holds '{strange[:60]}', which is none of the arrays of a plan, or is there twice")
    packed = next((member.filename for member in members if member.compress_type not in _METHODS), None)
    if packed is not None:
        raise ProblemError(f"{path}: '{packed}' is packed in a way that numpy does not pack arrays in")
    size = sum(member.file_size for member in members)
    if size > MOST_BYTES_OF_ARRAYS:
        raise ProblemError(f"{path}: its arrays take {size} bytes unpacked, at most {MOST_BYTES_OF_ARRAYS} are read")
