"""Reads drawings in well-known text: one geometry, or several one after the other."""

import re
from typing import TYPE_CHECKING

import shapely
from shapely.errors import GEOSException

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.features import shapes_of
from ccm_opt.files.scene_import.found_shapes import DrawingContent, Shape
from ccm_opt.files.scene_import.import_settings import ImportSettings

if TYPE_CHECKING:
    from ccm_opt.problem import LeftOut


def read_wkt(content: bytes, distance: float, settings: ImportSettings) -> DrawingContent:
    """The shapes of a WKT file, named ``geometry 1``, ``geometry 2``, … in their order.

    Args:
        content: of the file; an ``SRID=…;`` in front of a geometry is skipped.
        distance: not used: the geometries have no curves.
        settings: bounds.

    Raises:
        ProblemError: the text is no WKT, or exceeds a bound.
    """
    del distance
    # A comma stands between any two places.
    if (commas := content.count(b",")) > settings.most_points:
        raise ProblemError(f"it holds {commas} places, at most {settings.most_points} can be read; simplify it")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ProblemError("this is not a text file in UTF-8; expected WKT") from None
    shapes: list[Shape] = []
    left_out: list[LeftOut] = []
    for k, piece in enumerate(_pieces(text), start=1):
        if _depth(piece) > settings.deepest:
            raise ProblemError(f"geometry {k}: its brackets are nested more than {settings.deepest} deep; divide it")
        shapes += shapes_of(_geometry(piece), f"geometry {k}", left_out)
    return DrawingContent(tuple(shapes), tuple(left_out))


def _pieces(text: str) -> list[str]:
    """The texts of the geometries: lines are joined until their brackets balance."""
    pieces: list[str] = []
    lines: list[str] = []
    still_open = 0
    for line in text.splitlines():
        if line.strip():
            lines.append(line.strip())
        still_open += line.count("(") - line.count(")")
        # Balanced brackets end a geometry; one without any, such as POINT EMPTY, ends with its line.
        if lines and still_open <= 0:
            pieces.append(_bare(" ".join(lines)))
            lines = []
            still_open = 0
    return [*pieces, _bare(" ".join(lines))] if lines else pieces


def _bare(piece: str) -> str:
    """A geometry without the number of its coordinate system, and without what ends it."""
    return re.sub(r"^SRID=\d+;", "", piece.rstrip(";"), flags=re.IGNORECASE)


def _depth(text: str) -> int:
    """How deep brackets are nested."""
    depth = 0
    deepest = 0
    for bracket in re.findall(r"[()]", text):
        depth += 1 if bracket == "(" else -1
        deepest = max(deepest, depth)
    return deepest


def _geometry(text: str) -> shapely.Geometry:
    try:
        return shapely.from_wkt(text)
    except (GEOSException, NotImplementedError, ValueError, TypeError) as error:
        # No more of the text than the word that it begins with: it may be somebody's secret, and no drawing at all.
        shown = (
            text.split("(", maxsplit=1)[0].split(maxsplit=1)[0][:20] if text.split("(", maxsplit=1)[0].split() else "("
        )
        reason = str(error).replace("ParseException: ", "")
        raise ProblemError(
            f"'{shown}' cannot be read as well-known text: {reason}; expected for example POLYGON ((0 0, …))"
        ) from None
