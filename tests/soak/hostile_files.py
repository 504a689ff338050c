"""Mutated problem files, drawings and meshes: each is read, or refused by an error of ccm_opt, and soon."""

import random
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ccm_opt import load_problem
from ccm_opt.core.errors import CcmError
from ccm_opt.io.drawing import ImportOptions, import_scene
from ccm_opt.io.mesh_obstacles import read_mesh_file, repaired_mesh
from tests.conftest import PROBLEMS
from tests.fuzz.seeds import seeds
from tests.soak.mutations import mutated

LONGEST = 5.0
"""CPU time that reading one file may take [s]."""
DRAWINGS = Path(__file__).parents[1] / "data"


@dataclass(frozen=True)
class Defect:
    """A file that was not dealt with as it should be.

    Attributes:
        what: an exception that is none of ours, or how long it took.
        content: of the file.
        suffix: of the file's name.
    """

    what: str
    content: bytes
    suffix: str


def problem_files(generator: random.Random) -> Iterator[Defect | None]:
    """Mutated problem files without end; None for each that was dealt with."""
    seeds = [path.read_bytes() for path in sorted(PROBLEMS.glob("*.toml"))]
    yield from _read_for_ever(seeds, ".toml", load_problem, generator)


def drawings(suffix: str, generator: random.Random) -> Iterator[Defect | None]:
    """Mutated drawings of one format without end; None for each that was dealt with."""
    seeds = [path.read_bytes() for folder in (DRAWINGS, PROBLEMS) for path in sorted(folder.glob(f"*{suffix}"))]
    options = ImportOptions(scale=0.001)
    yield from _read_for_ever(seeds, suffix, lambda path: import_scene(path, options), generator)


def meshes(suffix: str, generator: random.Random) -> Iterator[Defect | None]:
    """Mutated meshes of one format without end; None for each that was dealt with."""
    yield from _read_for_ever(seeds(suffix), suffix, lambda path: repaired_mesh(read_mesh_file(path)), generator)


def _read_for_ever(
    seeds: list[bytes], suffix: str, read: Callable[[Path], object], generator: random.Random
) -> Iterator[Defect | None]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"mutated{suffix}"
        while True:
            content = mutated(generator.choice(seeds), generator)
            path.write_bytes(content)
            what = _trouble(read, path)
            yield Defect(what, content, suffix) if what else None


def _trouble(read: Callable[[Path], object], path: Path) -> str:
    """What went wrong in reading a file; empty where it was read or refused as it should be."""
    begun = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # what is refused in the end must not have been computed with before
            read(path)
    except CcmError as error:
        if not str(error).strip():
            return "refused without a word"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:200]} ({Path(place.filename).name}, line {place.lineno})"
    spent = time.process_time() - begun
    return f"took {spent:.1f} s" if spent > LONGEST else ""
