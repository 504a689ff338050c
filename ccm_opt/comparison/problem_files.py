"""The problems of a comparison as problem files, so that each can be solved, looked at and changed by itself."""

import tomllib
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import tomlkit

from ccm_opt.comparison.suites import Case
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.problem_data import recorded_data
from ccm_opt.files.problem_file.space_problem_data import space_problem_data
from ccm_opt.ground.whole_file import put_file
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.scene.bodies import Body, MeshBody

FOLDER = "problems"
"""In the folder of a comparison."""
MESH_FOLDER = "meshes"
"""In the folder of the problems."""
_DIGITS = 12
"""Of a mesh's hash in its name."""


def write_problems(cases: Sequence[Case], folder: Path) -> tuple[Path, ...]:
    """Write every problem as ``<name>.toml``; angles pass through degrees, so that last bits may differ.

    Args:
        cases: the problems.
        folder: is made where it is not there; files in it that say the same are left as they are.

    Returns:
        The files.

    Raises:
        ProblemError: a file cannot be written, or is there already and says something else.
    """
    files = []
    for case in cases:
        file = folder / f"{case.name}.toml"
        problem = case.problem()
        if isinstance(problem, SpaceProblem):
            for mesh, content in mesh_files(problem).items():
                _write(folder / mesh, content)
        _write(file, problem_text(problem).encode())
        files.append(file)
    return tuple(files)


def problem_text(problem: AnyProblem) -> str:
    """A problem file: the one that a problem was read from, if that says all of it, or a new one."""
    if isinstance(problem, SpaceProblem):
        return tomlkit.dumps(
            space_problem_data(problem, [_mesh_name(each.body) for each in problem.workspace.obstacles])
        )
    data = recorded_data(problem)
    # Other files that a problem names would have to be written too; then its own text does not say all.
    if problem.source and tomllib.loads(problem.source) == data:
        return problem.source
    return tomlkit.dumps(data)


def mesh_files(problem: SpaceProblem) -> dict[str, bytes]:
    """The meshes that a problem needs, by their paths beside its file; the same mesh has the same path everywhere."""
    bodies = [each.body for each in problem.workspace.obstacles]
    return {_mesh_name(body): body.content for body in bodies if isinstance(body, MeshBody)}


def _mesh_name(body: Body) -> str:
    """Path of a mesh; empty for other bodies."""
    if not isinstance(body, MeshBody):
        return ""
    file = PurePosixPath(body.file)
    return f"{MESH_FOLDER}/{file.stem}-{body.digest[:_DIGITS]}{file.suffix}"


def _write(file: Path, content: bytes) -> None:
    try:
        if file.exists():
            if file.read_bytes() == content:
                return
            raise ProblemError(f"{file} is there already and says something else; choose another --out, or remove it")
        file.parent.mkdir(parents=True, exist_ok=True)
        put_file(file, content)
    except OSError as error:
        raise ProblemError(f"cannot write {file}: {getattr(error, 'strerror', None) or error}") from error
