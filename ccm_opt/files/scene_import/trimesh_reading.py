"""Formats of meshes that trimesh reads; it is loaded when the first such mesh is."""

import io
import warnings

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.raw_mesh import RawMesh


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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, skip_materials=True, process=False)
            meshes = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
            found = [RawMesh(np.asarray(each.vertices, np.float64), np.asarray(each.faces, np.intp)) for each in meshes]
    # Whatever a broken file leads a reader of a dozen formats into, to people it is a broken file.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ProblemError(f"not readable as {kind.upper()}: {reason}") from None
    return RawMesh.joined(found)
