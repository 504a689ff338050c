"""Output folders, whole or not at all.

The new folder is assembled in a workshop beside the place, and is on the disk before it changes places with the old one
in one step, where the system has such a step. Until then everything is as it was; from then on everything is new. One
writer at a time works in a folder of results: the others wait. So a workshop that a writer finds was left by one that
was killed: what of the user's or of an earlier run it still holds is put back, the rest is removed.
"""

import ctypes
import errno
import os
import shutil
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.controller_points import controller_points, trajectory_texts
from ccm_opt.io.problem_data import KEPT_MESHES, stored_meshes
from ccm_opt.io.records import arrays_npz, solution_arrays, solution_json
from ccm_opt.io.robot_models import URDF_MESHES, mjcf_text, scene_meshes, urdf_text
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution

_PATIENCE = 60.0
"""How long others who write to the same place are waited for [s]. Taste: a folder takes milliseconds, on a slow disk a
second or two."""
_LOOK = 0.005
"""Time between two looks whether they are done [s]. Taste."""
WORKSHOP = ".ccm-opt-writing"
"""Ends the name of a workshop, which begins with a dot and the name of the folder that is made in it."""
_HERE = -100
"""AT_FDCWD of Linux: paths begin where the process is."""
_EXCHANGE = 2
"""RENAME_EXCHANGE of Linux."""


def atomic_replace(
    wanted: Path,
    files: Mapping[str, bytes],
    ours: Collection[str],
    chosen: Callable[[Path], Path],
) -> Path:
    """Put a folder with these files in its place; entries of an old folder that are not ours stay.

    Args:
        wanted: the folder.
        files: content by file name; a name with slashes lies in folders of the folder.
        ours: names of files and folders that a run writes; they go with the old folder.
        chosen: called when nobody else writes there; gives the folder that is wanted or another one beside it, and
            raises where no place may be taken.

    Returns:
        The folder.

    Raises:
        OSError: it cannot be written; then the old folder is as it was.
    """
    wanted.parent.mkdir(parents=True, exist_ok=True)
    with _alone_in(wanted.parent):
        for left in wanted.parent.glob(f".*{WORKSHOP}"):
            with suppress(OSError):  # then the next run tries again
                _clear(left, ours)
        target = chosen(wanted)
        workshop = target.with_name(f".{target.name}{WORKSHOP}")
        try:
            _swap(_assembled(workshop, files, target, ours), target)
            _sync(target.parent)
        finally:
            with suppress(OSError):  # what is in its place counts; the next run clears up
                _clear(workshop, ours)
    return target


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Work in a folder while nobody else who asks here does; where the system knows no locks, just work.

    Raises:
        TimeoutError: somebody else does for too long.
    """
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        end = time.monotonic() + _PATIENCE
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise TimeoutError(errno.ETIMEDOUT, "another run has been writing there for too long") from None
                time.sleep(_LOOK)
            except OSError:  # some file systems of networks know no locks
                break
        yield
    finally:
        os.close(handle)


def _assembled(workshop: Path, files: Mapping[str, bytes], target: Path, ours: Collection[str]) -> Path:
    """Return the new folder in the workshop, on the disk, with what is the user's in the old one."""
    new = workshop / "new"
    new.mkdir(parents=True)
    for name, content in files.items():
        place = new / name
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    if target.is_dir():
        for entry in target.iterdir():
            # What is written to a file of the user's at either place is at both, where that can be.
            if entry.name in ours:
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.copytree(entry, new / entry.name, symlinks=True, copy_function=_link_or_copy)
            else:
                _link_or_copy(str(entry), str(new / entry.name))
    for folder in (new, *(place for place in new.rglob("*") if place.is_dir() and not place.is_symlink())):
        _sync(folder)
    return new


def _link_or_copy(source: str, place: str) -> str:
    try:
        os.link(source, place, follow_symlinks=False)
    except (OSError, NotImplementedError):  # not every file system knows links
        shutil.copy2(source, place, follow_symlinks=False)
    return place


def _swap(new: Path, target: Path) -> None:
    """The new folder into its place, what was there into the workshop."""
    if not target.exists():
        new.rename(target)
    elif not _exchanged(new, target):
        target.rename(new.with_name("old"))
        new.rename(target)


def _exchanged(one: Path, other: Path) -> bool:
    """Let two folders change names in one step; whether the system can."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    if rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0:
        return True
    if ctypes.get_errno() in {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EPERM}:
        return False
    raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(other))


def _clear(workshop: Path, ours: Collection[str]) -> None:
    """Put back what a workshop still holds of the user's, or of an earlier run that lost its place, and remove it."""
    if not workshop.is_dir():
        return
    target = workshop.with_name(workshop.name.removeprefix(".").removesuffix(WORKSHOP))
    old = workshop / "old"
    if old.is_dir() and not target.exists():
        old.rename(target)
    if target.is_dir():
        for entry in [entry for side in (workshop / "new", old) if side.is_dir() for entry in side.iterdir()]:
            place = target / entry.name
            if entry.name not in ours and not place.exists() and not place.is_symlink():
                entry.rename(place)
    shutil.rmtree(workshop, ignore_errors=True)


def _sync(folder: Path) -> None:
    """Let the entries of a folder be on the disk, where the system can say so of folders."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


RECORD = "solution.json"
"""Always there; why there is no plan stands here too."""
ARRAYS = "solution.npz"
TEXTS = (RECORD, "trajectory.csv", "trajectory.yaml", "arm.urdf", "arm.mjcf.xml")
FIGURES = ("plan", "curves", "steps", "links", "space")
"""Still pictures of a plan, each of which may have one of several formats."""
PICTURES = (
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg", "pdf")),
    "motion.gif",
    "motion.mp4",
    "report.html",
    "simulation.png",
)
POSE_RECORD = "pose.json"
"""Of the folder of a pose; always there."""
POSE_ARRAYS = "pose.npz"
POSE_FILES = (POSE_RECORD, POSE_ARRAYS, "pose.png")
REACH_RECORD = "reach.json"
"""Of the folder of a map of reach; always there."""
REACH_FILES = (REACH_RECORD, "reach.npz", "reach.png")
PARETO_RECORD = "pareto.json"
PARETO_FILES = (PARETO_RECORD, "pareto.png", "pareto")
"""Beside the recommended one of several plans; the last is a folder with a folder for each plan."""
TOLERANCE_FILES = ("tolerance.json", "tolerance.png")
"""What ``ccm-opt tolerance`` writes beside a plan; a new plan takes them away."""
WRITTEN_FILES = frozenset(
    (*TEXTS, ARRAYS, *PICTURES, *POSE_FILES, *REACH_FILES, *PARETO_FILES, *TOLERANCE_FILES, URDF_MESHES, KEPT_MESHES)
)
"""Files and folders that a run writes; anything else in an old folder is the user's and is kept."""


def write_solution(solution: Solution, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the folder of a solved problem.

    Args:
        solution: the verified plan.
        out: the directory that holds the folder; it is made when it is not there.
        pictures: content of pictures by file name.

    Returns:
        The folder, ``out / <problem's name>``.

    Raises:
        ProblemError: when the folder cannot be written, or another folder is in its place.
    """
    return write_folder(out / solution.problem.name, {**solution_files(solution), **(pictures or {})})


def solution_files(solution: Solution) -> dict[str, bytes]:
    """Return the content of every file of a solved problem but the pictures, by file name."""
    problem = solution.problem
    csv, yaml = trajectory_texts(controller_points(problem, solution.trajectory, solution.joints, solution.checks))
    texts = {RECORD: solution_json(solution), "trajectory.csv": csv, "trajectory.yaml": yaml, **model_texts(problem)}
    files = {name: text.encode() for name, text in texts.items()}
    meshes = model_meshes(problem) | stored_meshes(problem)
    return {**files, ARRAYS: arrays_npz(solution_arrays(solution)), **meshes}


def model_meshes(problem: Problem, folder: str = URDF_MESHES) -> dict[str, bytes]:
    """Return meshes of the obstacles in the URDF, in space also in the MJCF; ``folder`` is in front of their names."""
    return scene_meshes(solid_scene(problem.workspace, problem.arm), folder)


def model_texts(
    problem: Problem, *, obstacles: bool = True, bends_only: bool = False, meshes: str = URDF_MESHES
) -> dict[str, str]:
    """Return descriptions of a problem's arm and obstacles for other programs, by file name; meshes are in a folder."""
    scene = solid_scene(problem.workspace, problem.arm) if obstacles else None
    gravity = problem.simulation.gravity
    return {
        "arm.urdf": urdf_text(problem.arm, problem.name, problem.limits, scene, meshes, bends_only=bends_only),
        "arm.mjcf.xml": mjcf_text(problem.arm, problem.name, gravity, scene, meshes, bends_only=bends_only),
    }


def check_target(target: Path, record: str = RECORD) -> None:
    """Refuse a place where a folder could not be written, before any work is done for it; writes nothing.

    Args:
        target: the folder.
        record: name of the record by which a folder of an earlier run of the same kind is known.

    Raises:
        ProblemError: when something else is in the place, or nothing can be written there.
    """
    try:
        os.fsencode(target)
    except UnicodeEncodeError:
        raise ProblemError(
            f"cannot write a folder of the name {target.name!a}: file names here are in "
            f"{sys.getfilesystemencoding()}; set PYTHONUTF8=1, or give the problem another name"
        ) from None
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise ProblemError(f"cannot write {target}: something that is not a folder has that name; choose another --out")
    if target.is_dir() and any(target.iterdir()) and not (target / record).is_file():
        raise ProblemError(f"cannot write {target}: it is a folder of something else; choose another --out or clear it")
    # Parents that are missing will be made, in the nearest one that exists.
    nearest = next((parent for parent in target.absolute().parents if parent.exists()), Path("/"))
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise ProblemError(f"cannot write {target}: {nearest} is not a writable folder; choose another --out")


def write_folder(
    target: Path,
    files: Mapping[str, bytes],
    record: str = RECORD,
    *,
    beside: Callable[[Path], Path] = Path,
) -> Path:
    """Put a folder with these files in its place; a folder of an earlier run gives way, the user's files in it stay.

    Args:
        target: the folder.
        files: content by file name; a name with slashes lies in folders of the folder.
        record: name of the record of this kind of folder, see ``check_target``.
        beside: another place for the folder, where that is to be left alone; asked when nobody else writes there.

    Returns:
        The folder.

    Raises:
        ProblemError: when it cannot be written; then the old folder, if any, is as it was.
    """

    def chosen(wanted: Path) -> Path:
        place = beside(wanted)
        check_target(place, record)
        return place

    try:
        return atomic_replace(target, files, WRITTEN_FILES, chosen)
    except OSError as error:
        raise ProblemError(f"cannot write {target}: {error.strerror or error}; choose another --out") from error
