"""A few mutated files of each kind; ``python -m tests.soak`` reads tens of thousands."""

import contextlib
import random
from itertools import islice
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.drawing import ImportOptions, import_scene
from ccm_opt.io.mesh_obstacles import MESH_READERS, read_mesh_file
from ccm_opt.scene.workspace import Obstacle
from tests.fuzz.seeds import WORDS, seeds
from tests.soak.hostile_files import drawings, meshes, problem_files

COUNT = 40


def drawn(seed: int) -> random.Random:
    """What mutations are drawn by."""
    return random.Random(seed)  # noqa: S311 - no secret


@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_mutated_problem_files_are_read_or_refused(seed: int) -> None:
    """No mutation gets anything but a problem or an error of ccm_opt, in seconds."""
    defects = [defect for defect in islice(problem_files(drawn(seed)), COUNT) if defect]
    assert not defects


@pytest.mark.planning
@pytest.mark.parametrize("suffix", [".svg", ".dxf", ".wkt", ".geojson"])
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_mutated_drawings_are_read_or_refused(suffix: str, seed: int) -> None:
    """Likewise for drawings of each format."""
    defects = [defect for defect in islice(drawings(suffix, drawn(seed)), COUNT) if defect]
    assert not defects


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".glb", ".3mf"])
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_mutated_meshes_are_read_or_refused(suffix: str, seed: int) -> None:
    """Likewise for meshes of each format."""
    defects = [defect for defect in islice(meshes(suffix, drawn(seed)), COUNT) if defect]
    assert not defects


@pytest.mark.parametrize("suffix", WORDS)
def test_engines_begin_with_files_that_are_read(tmp_path: Path, suffix: str) -> None:
    """Of the files of each format from which others are made, one at least is read."""
    count = 0
    for content in seeds(suffix):
        path = tmp_path / f"seed{suffix}"
        path.write_bytes(content)
        with contextlib.suppress(ProblemError):
            count += len(read_mesh_file(path).faces if suffix in MESH_READERS else shrunk_portals(path))
    assert count > 0


def shrunk_portals(path: Path) -> tuple[Obstacle, ...]:
    """The obstacles of a drawing."""
    return import_scene(path, ImportOptions()).obstacles
