"""Points of scans, read from files."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.drawing import read_drawing
from ccm_opt.io.raw_mesh import MESHES
from ccm_opt.io.stl_obj_ply import read_ply

_MOST_POINTS = 20_000_000
"""Greatest number of points of a scan. Heuristic: half a gigabyte in memory."""
_SAMPLED = 2000
"""Number of points of which the distance to their nearest neighbour is measured. Heuristic."""
_COVERED = np.sqrt(2.0)
"""Ratio of the spacing of points on a square grid to the least radius with which they cover the surface between them.
Derived: half of the diagonal."""
_HERE = ["0", "0", "0", "1", "0", "0", "0"]
"""Viewpoint of a PCD file whose points are as they are: position, and quaternion w, x, y, z."""
_PCD_TYPES = {"F": "f", "I": "i", "U": "u"}


@dataclass(frozen=True, eq=False)
class Scan:
    """Points of a scan in the unit of its file.

    Attributes:
        points: the points, shape (n, d).
        spacing: median distance of a point from its nearest neighbour.
        content: bytes of the file.
    """

    points: FloatArray
    spacing: float
    content: bytes

    def leaves_gaps(self, radius: float) -> bool:
        """Return whether balls of a radius, in the unit of the file, leave gaps between neighbouring points."""
        return bool(self.spacing > _COVERED * radius)


def read_scan(path: Path, dimension: int = 3) -> Scan:
    """Return the points in a file.

    Args:
        path: a PLY, PCD, XYZ or NPY file, recognised by its suffix.
        dimension: number of coordinates of a point, 3 in space and 2 in the plane, where all points have one height.

    Raises:
        ProblemError: the file cannot be read, or contains no usable points.
    """
    content = read_drawing(path, POINT_READERS, "scan", MESHES.most_bytes, b"\0 \t\r\n")
    try:
        points = POINT_READERS[path.suffix.lower()](content)
        _refuse_unusable(points, dimension)
        points = points if dimension == 3 else _level(points)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    except MemoryError as error:
        raise ProblemError(f"{path.name}: too large to read") from error
    return Scan(points, _median_spacing(points), content)


def _median_spacing(points: FloatArray) -> float:
    """Return the median distance of some points from their nearest neighbours; 0 for a single point."""
    if len(points) == 1:
        return 0.0
    some = points[:: max(1, len(points) // _SAMPLED)]
    distances, _ = cKDTree(points).query(some, k=2)
    return float(np.median(np.asarray(distances)[:, 1]))


def _level(points: FloatArray) -> FloatArray:
    """Return the x and y of points of one height, shape (n, 2).

    Raises:
        ProblemError: the points have different heights.
    """
    low, high = np.min(points[:, 2:], initial=np.inf), np.max(points[:, 2:], initial=-np.inf)
    if high > low:
        raise ProblemError(
            f"its points are {low:g} to {high:g} high; expected one height in the plane: cut a level slice of the scan"
        )
    return np.ascontiguousarray(points[:, :2])


def _refuse_unusable(points: FloatArray, dimension: int) -> None:
    """Raise an error if there are no points, too many, or some that are not finite or too large.

    Raises:
        ProblemError: the points have one of these defects.
    """
    if points.ndim != 2 or points.shape[1] < dimension:
        expected = "three numbers (x, y, z)" if dimension == 3 else "two numbers (x, y)"
        raise ProblemError(f"expected rows of at least {expected}, got an array of shape {points.shape}")
    if len(points) == 0:
        raise ProblemError("it contains no points")
    if len(points) > _MOST_POINTS:
        raise ProblemError(f"it has {len(points)} points; at most {_MOST_POINTS} can be used; thin it")
    broken = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(broken):
        raise ProblemError(f"{len(broken)} of {len(points)} points are not finite, first that of index {broken[0]}")
    if (largest := float(np.abs(points).max())) > MESHES.largest_coordinate:
        raise ProblemError(f"a coordinate is {largest:g}; expected at most {MESHES.largest_coordinate:g}")


def _read_ply_points(content: bytes) -> FloatArray:
    """Return the vertices in a PLY file, shape (n, 3); faces are ignored."""
    return read_ply(content, MESHES).vertices


def _read_xyz(content: bytes) -> FloatArray:
    """Return the numbers of each row of a text, three at most, separated by blanks, commas or semicolons, (n, 2 or 3).

    Raises:
        ProblemError: the rows are not such numbers.
    """
    text = _without_separators(content)
    rows = (row.split() for row in text.splitlines() if row.strip() and not row.lstrip().startswith((b"#", b"//")))
    columns = range(min(3, len(next(rows, ()))))
    try:
        return np.loadtxt(io.BytesIO(text), comments=("#", "//"), usecols=columns, ndmin=2)
    except (ValueError, UnicodeDecodeError) as error:
        raise ProblemError(f"not readable as rows of numbers: {error}") from None


def _without_separators(content: bytes) -> bytes:
    """Return a text with blanks in the place of the commas or semicolons that separate its numbers.

    Raises:
        ProblemError: the numbers have decimal commas.
    """
    lines = [line for line in content.splitlines() if line.strip() and not line.lstrip().startswith((b"#", b"//"))]
    first = lines[0] if lines else b""
    if b"," in first and (b";" in first or any(len(field.split()) > 1 for field in first.split(b","))):
        raise ProblemError("its numbers seem to have decimal commas; write decimal points")
    return re.sub(rb"[,;\t]", b" ", content)


def _read_npy(content: bytes) -> FloatArray:
    """Return the columns of an array in an NPY file, three at most, shape (n, 2 or 3).

    Raises:
        ProblemError: the content is not such an array.
    """
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ProblemError(f"not readable as NPY: {error}") from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.ndim != 2:
        raise ProblemError("expected one array of numbers with a row (x, y, z) per point")
    if 2 <= array.shape[0] <= 3 < array.shape[1]:
        raise ProblemError(f"expected a row of coordinates per point, got the shape {array.shape}; transpose it")
    return array[:, :3].astype(np.float64)


def _read_pcd(content: bytes) -> FloatArray:
    """Return the points in a PCD file of the Point Cloud Library (version 0.7), text or binary, shape (n, 3).

    Points that a scanner marks as missing, by NaN, are left out.

    Raises:
        ProblemError: the content is not PCD, is truncated, or compressed, or has a viewpoint, which programs either
            apply to the points or take for the place of the scanner.
    """
    found = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content, re.MULTILINE)
    if found is None:
        raise ProblemError("not readable as PCD: it has no header that ends with DATA")
    header = {
        words[0]: words[1:]
        for line in content[: found.start()].decode("latin-1").splitlines()
        if (words := line.split()) and not words[0].startswith("#")
    }
    fields, kinds = header.get("FIELDS", []), header.get("TYPE", [])
    sizes, counts = header.get("SIZE", []), header.get("COUNT", ["1"] * len(fields))
    if not {"x", "y", "z"} <= set(fields) or not len(fields) == len(kinds) == len(sizes) == len(counts):
        raise ProblemError("not readable as PCD: its header does not describe the fields x, y and z")
    try:
        row = np.dtype([
            (f"{k}", f"<{_PCD_TYPES[kind]}{int(size)}", (int(count),))
            for k, (kind, size, count) in enumerate(zip(kinds, sizes, counts, strict=True))
        ])  # fmt: skip
        number = int(header["POINTS"][0])
    except (KeyError, ValueError, TypeError, IndexError):
        raise ProblemError("not readable as PCD: its header is damaged") from None
    if (viewpoint := header.get("VIEWPOINT", _HERE)) != _HERE and _numbers(viewpoint) != _numbers(_HERE):
        raise ProblemError(
            f"its VIEWPOINT is {' '.join(viewpoint)}, and whether its points are relative to that is not said; "
            f"transform the points if so, and write VIEWPOINT {' '.join(_HERE)}"
        )
    body = content[found.end() :]
    order = found[1].decode()
    if order == "ascii":
        columns = np.cumsum([0, *map(int, counts)])[[fields.index(axis) for axis in "xyz"]]
        try:
            points = np.loadtxt(io.BytesIO(body), usecols=columns.tolist(), ndmin=2)
        except ValueError as error:
            raise ProblemError(f"not readable as PCD: {error}") from None
    elif order == "binary":
        if len(body) < number * row.itemsize:
            raise ProblemError(f"its header announces {number} points, but the file ends before; it is truncated")
        rows = np.frombuffer(body, row, number)
        points = np.column_stack([rows[f"{fields.index(axis)}"][:, 0].astype(np.float64) for axis in "xyz"])
    else:
        raise ProblemError(f"its data are {order}; save it as binary or ascii")
    if len(points) != number:
        raise ProblemError(f"its header announces {number} points, but it has {len(points)}")
    return points[~np.isnan(points).any(axis=1)]


def _numbers(words: list[str]) -> list[float]:
    """Return words as numbers; none if one is not a number."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


POINT_READERS: Mapping[str, Callable[[bytes], FloatArray]] = {
    ".ply": _read_ply_points,
    ".pcd": _read_pcd,
    ".xyz": _read_xyz,
    ".txt": _read_xyz,
    ".csv": _read_xyz,
    ".npy": _read_npy,
}
"""Readers of points, by file name suffix in lower case."""
