"""Meshes that trimesh reads; it is loaded when the first such mesh is."""

import io
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.raw_mesh import RawMesh

LONGEST_REASON = 100
"""Characters of what trimesh says that are shown."""


def read_by_trimesh(content: bytes, kind: str) -> RawMesh:
    """The mesh of a file, everything in it placed as the file says and put together.

    Materials are not read, so that no other file is.

    Args:
        content: of the file.
        kind: its format as trimesh calls it, the suffix without its dot.

    Raises:
        ProblemError: the file cannot be read.
    """
    import trimesh  # noqa: PLC0415 - takes a second to load

    try:
        with _quiet():
            scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, skip_materials=True, process=False)
            parts = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
            # A part may have vertices and nothing that they belong to.
            meshes = [part for part in parts if len(part.faces)]
            found = [RawMesh(np.asarray(each.vertices, np.float64), np.asarray(each.faces, np.intp)) for each in meshes]
    # Whatever a broken file leads a reader of a dozen formats into, to people it is a broken file.
    except Exception as error:  # noqa: BLE001
        missing = " is missing" if isinstance(error, KeyError) else ""
        reason = f"{' '.join(str(error).split())[:LONGEST_REASON] or type(error).__name__}{missing}"
        raise ProblemError(f"not readable as {kind.upper()}: the file is damaged or cut short ({reason})") from None
    return RawMesh.joined(found)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep trimesh from telling of a broken file in its own words, tracebacks among them."""
    # What its modules log goes up to here, and no further.
    logger = logging.getLogger("trimesh")
    propagated = logger.propagate
    nowhere = logging.NullHandler()
    logger.propagate = False
    logger.addHandler(nowhere)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.propagate = propagated
        logger.removeHandler(nowhere)
