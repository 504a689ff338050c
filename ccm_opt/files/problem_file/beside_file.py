"""Files that a problem file names: they lie beside it, or in folders below, unless more is allowed."""

import os
from pathlib import Path

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath


def place_beside(
    name: str, folder: Path | None, path: KeyPath, kind: str, issues: Issues, *, allow_outside: bool
) -> Path | None:
    """Where a file lies.

    Args:
        name: its path as the problem file gives it.
        folder: of the problem file; None where there is none.
        path: of the key that names the file.
        kind: what is expected, with an example: "a drawing, for example 'scene.svg'".
        issues: receives why there is no file that may be read.
        allow_outside: whether it may lie outside that folder.

    Returns:
        The file, which may be missing; None where it may not be read.
    """
    if folder is None:
        issues.add(path, "a path beside the problem file, but this problem was not read from a file")
        return None
    place = folder / name
    try:
        is_folder = os.path.isdir(place)  # noqa: PTH112 - pathlib's raises where the user may not look
        # A problem file from somebody else must not read what lies elsewhere, by a link neither.
        inside = os.path.realpath(place).startswith(os.path.join(os.path.realpath(folder), ""))  # noqa: PTH118
    except ValueError as error:  # a path with a zero byte in it
        issues.add(path, f"{name!r} is no path: {error}")
        return None
    if is_folder:
        issues.add(path, f"{name!r} is a directory; expected {kind}")
        return None
    if not allow_outside and not inside:
        issues.add(
            path,
            f"{name!r} is outside the folder of the problem file; copy it there, or allow it by --allow-outside "
            "(in Python allow_outside=True)",
        )
        return None
    return place
