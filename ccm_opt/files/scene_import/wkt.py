"""Reads drawings in well-known text: one geometry, or several one after the other."""

import re

import numpy as np
import shapely
from shapely.errors import GEOSException

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.features import shapes_of
from ccm_opt.files.scene_import.found_shapes import Shape


def read_wkt(content: bytes, distance: float) -> list[Shape]:
    """The shapes of a WKT file, named ``geometry 1``, ``geometry 2``, … in their order.

    Args:
        content: of the file; an ``SRID=…;`` in front of a geometry is skipped.
        distance: not used: the geometries have no curves.

    Raises:
        ProblemError: the text is no WKT.
    """
    del distance
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ProblemError("this is not a text file in UTF-8; expected WKT") from None
    shapes: list[Shape] = []
    for k, piece in enumerate(_pieces(text), start=1):
        shapes += shapes_of(_geometry(piece), f"geometry {k}")
    return shapes


def _pieces(text: str) -> list[str]:
    """The texts of the geometries: lines are joined until their brackets balance."""
    pieces = []
    piece = ""
    for line in text.splitlines():
        piece = f"{piece} {line}".strip()  # a geometry may go over several lines
        # Balanced brackets end a geometry; one without any, such as POINT EMPTY, ends with its line.
        if piece and piece.count("(") <= piece.count(")"):
            pieces.append(re.sub(r"^SRID=\d+;", "", piece.rstrip(";"), flags=re.IGNORECASE))
            piece = ""
    return [*pieces, piece] if piece else pieces


def _geometry(text: str) -> shapely.Geometry:
    try:
        with np.errstate(invalid="ignore"):  # NaN is refused later, by name
            return shapely.from_wkt(text)
    except (GEOSException, NotImplementedError, ValueError, TypeError) as error:
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        reason = str(error).replace("ParseException: ", "")
        raise ProblemError(
            f"'{shown}' cannot be read as well-known text: {reason}; expected for example POLYGON ((0 0, …))"
        ) from None
