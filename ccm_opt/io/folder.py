"""Atomic writing of output folders.

A new folder is assembled in a temporary folder next to its target, called the workshop, and synced to disk. The new
folder is then exchanged with the old one, atomically if the system supports that, so that readers find either the
old or the new folder, complete. Writers lock the parent folder, one at a time. A workshop that a writer finds is
therefore left over from a killed run: files of the user or of an earlier run in it are put back, the rest is removed.
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
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.problem_data import KEPT_MESHES, stored_meshes
from ccm_opt.io.records import arrays_npz, solution_arrays, solution_json
from ccm_opt.io.robot_models import URDF_MESHES, scene_meshes
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution

_PATIENCE = 60.0
"""Maximum time to wait for another writer in the same parent folder [s]. Heuristic: writing takes milliseconds, on a
slow disk a second or two."""
_LOOK = 0.005
"""Interval between attempts to lock the parent folder [s]. Heuristic."""
WORKSHOP = ".ccm-opt-writing"
"""Suffix of the name of a temporary folder; the name begins with a dot and the name of the target folder."""
_HERE = -100
"""``AT_FDCWD`` of Linux: relative paths start from the working directory."""
_EXCHANGE = 2
"""``RENAME_EXCHANGE`` of Linux: exchange two names atomically."""


def atomic_replace(
    wanted: Path,
    files: Mapping[str, bytes],
    ours: Collection[str],
    chosen: Callable[[Path], Path],
) -> Path:
    """Write a folder atomically, replacing an old one but keeping the user's own entries, and return its path.

    Args:
        wanted: the folder.
        files: content by file name; names with slashes lie in subfolders.
        ours: names of files and folders that a run may write, which are not carried over from the old folder.
        chosen: function called under the lock with ``wanted``; returns the folder to write, ``wanted`` or a sibling,
            or raises if no folder may be written.

    Returns:
        The folder written.

    Raises:
        OSError: the folder cannot be written; the old one is then unchanged.
    """
    wanted.parent.mkdir(parents=True, exist_ok=True)
    with _alone_in(wanted.parent):
        for left in wanted.parent.glob(f".*{WORKSHOP}"):
            with suppress(OSError):  # the next run will try again
                _clear(left, ours)
        target = chosen(wanted)
        workshop = target.with_name(f".{target.name}{WORKSHOP}")
        try:
            _swap(_assembled(workshop, files, target, ours), target)
            _sync(target.parent)
        finally:
            with suppress(OSError):  # the new folder is in place; the next run cleans up
                _clear(workshop, ours)
    return target


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Hold an exclusive lock on a folder during a ``with`` block; without effect on systems that have no file locks.

    Raises:
        TimeoutError: another process holds the lock for too long.
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
                    raise TimeoutError(errno.ETIMEDOUT, "another run is still writing to it") from None
                time.sleep(_LOOK)
            except OSError:  # some network file systems have no locks
                break
        yield
    finally:
        os.close(handle)


def _assembled(workshop: Path, files: Mapping[str, bytes], target: Path, ours: Collection[str]) -> Path:
    """Return the path of a new folder, written and synced in the workshop, with the user's entries of the old folder.

    Args:
        workshop: temporary folder in which the new folder is made.
        files: content by file name; names with slashes lie in subfolders.
        target: the old folder, if there is any.
        ours: names of entries of the old folder that are not carried over.
    """
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
            # Hard links where possible, so that writes to a user's file meanwhile are not lost.
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
    except (OSError, NotImplementedError):  # not every file system has hard links
        shutil.copy2(source, place, follow_symlinks=False)
    return place


def _swap(new: Path, target: Path) -> None:
    """Move a new folder to its target path; any old folder at that path is moved to the new folder's former parent."""
    if not target.exists():
        new.rename(target)
    elif not _exchanged(new, target):
        target.rename(new.with_name("old"))
        new.rename(target)


def _exchanged(one: Path, other: Path) -> bool:
    """Return whether the names of two folders were exchanged atomically; False if the system cannot do that.

    Raises:
        OSError: the exchange failed for another reason.
    """
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
    """Remove a temporary folder, after moving the user's entries and any old folder in it back to their place."""
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
    """Write the directory entries of a folder to disk, if the system can sync folders."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


RECORD = "solution.json"
"""File name of the record of a run, in every output folder; if no plan was found, the record holds the diagnosis."""
ARRAYS = "solution.npz"
TEXTS = (RECORD, "trajectory.csv", "trajectory.yaml", "arm.urdf", "arm.mjcf.xml")
FIGURES = ("plan", "curves", "steps", "links", "space")
"""File names, without suffix, of the still pictures of a plan."""
PICTURES = (
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg", "pdf")),
    "motion.gif",
    "motion.mp4",
    "report.html",
    "simulation.png",
)
POSE_RECORD = "pose.json"
"""File name of the record in the output folder of a static pose; always present."""
POSE_ARRAYS = "pose.npz"
POSE_FILES = (POSE_RECORD, POSE_ARRAYS, "pose.png")
REACH_RECORD = "reach.json"
"""File name of the record in the output folder of a reachability map; always present."""
REACH_FILES = (REACH_RECORD, "reach.npz", "reach.png")
PARETO_RECORD = "pareto.json"
PARETO_FILES = (PARETO_RECORD, "pareto.png", "pareto")
"""Entries that a set of Pareto-optimal plans adds to its recommended plan; the last is a folder with every plan."""
SIZE_RECORD = "size.json"
SIZE_FILES = (SIZE_RECORD, "size.csv", "size.png", "sizes")
"""Entries that the search for the size of an arm adds to the plan that it found; the last is a folder with the plan of
every radius, of the trade-off of length and radius."""
TOLERANCE_FILES = ("tolerance.json", "tolerance.png")
"""Files that the command ``ccm-opt tolerance`` adds to the folder of a plan; a new plan removes them."""
WRITTEN_FILES = frozenset(
    (
        *(*TEXTS, ARRAYS, *PICTURES, *POSE_FILES, *REACH_FILES, *PARETO_FILES, *SIZE_FILES, *TOLERANCE_FILES),
        *(URDF_MESHES, KEPT_MESHES),
    )
)
"""Names of all files and folders that a run may write; any other entry of an old folder is the user's and is kept."""


def write_solution(solution: Solution, out: Path, pictures: Mapping[str, bytes] | None = None) -> Path:
    """Write the output folder of a solved problem: record, arrays, trajectory, models, meshes and pictures.

    Args:
        solution: the verified plan.
        out: parent directory, created if missing.
        pictures: content of pictures by file name.

    Returns:
        The folder written, ``out / <name of the problem>``.

    Raises:
        ProblemError: the folder cannot be written, or a folder without a record of a run is at this path.
    """
    return write_folder(out / solution.problem.name, {**solution_files(solution), **(pictures or {})})


def solution_files(solution: Solution) -> dict[str, bytes]:
    """Return the files of a solved problem, except the pictures, as a mapping from file name to content."""
    problem = solution.problem
    points = controller_points(problem, solution.trajectory, solution.joints, solution.checks)
    csv, yaml = trajectory_texts(points, problem.arm)
    rigid = problem.arm.sections is None
    models = model_texts(problem) if rigid else {}
    texts = {RECORD: solution_json(solution), "trajectory.csv": csv, "trajectory.yaml": yaml, **models}
    files = {name: text.encode() for name, text in texts.items()}
    meshes = (model_meshes(problem) if rigid else {}) | stored_meshes(problem)
    return {**files, ARRAYS: arrays_npz(solution_arrays(solution)), **meshes}


def model_meshes(problem: Problem, folder: str = URDF_MESHES) -> dict[str, bytes]:
    """Return the obstacles' mesh files to which the robot models (URDF, in space also MJCF) refer, by path.

    Args:
        problem: the problem.
        folder: folder of the mesh files, relative to the models.
    """
    return scene_meshes(solid_scene(problem.workspace, problem.arm), folder)


def model_texts(
    problem: Problem, *, obstacles: bool = True, bends_only: bool = False, meshes: str = URDF_MESHES
) -> dict[str, str]:
    """Return the robot models (URDF and MJCF) of a problem's arm and obstacles, as text by file name.

    Raises:
        ProblemError: the arm has sections that bend evenly, which are no chain of rigid links.

    Args:
        problem: the problem.
        obstacles: whether obstacles are included.
        bends_only: whether revolute joints that never bend the arm are left out.
        meshes: folder of the obstacles' mesh files, relative to the models.
    """
    if problem.arm.sections is not None:
        raise ProblemError(
            "sections that bend evenly are no chain of rigid links, so that URDF and MJCF cannot hold them"
        )
    scene = solid_scene(problem.workspace, problem.arm) if obstacles else None
    gravity = problem.simulation.gravity
    return {
        "arm.urdf": urdf_text(problem.arm, problem.name, problem.limits, scene, meshes, bends_only=bends_only),
        "arm.mjcf.xml": mjcf_text(problem.arm, problem.name, gravity, scene, meshes, bends_only=bends_only),
    }


def check_target(target: Path, record: str = RECORD) -> None:
    """Raise an error for an output folder that could not be written, before time is spent on planning.

    Args:
        target: the folder; nothing is written.
        record: name of the file whose presence identifies the folder of an earlier run of the same kind.

    Raises:
        ProblemError: the path is not a folder, is a folder without that record, or cannot be written.
    """
    try:
        os.fsencode(target)
    except UnicodeEncodeError:
        raise ProblemError(
            f"cannot write a folder of the name {target.name!a}: file names here are in "
            f"{sys.getfilesystemencoding()}; set PYTHONUTF8=1, or give the problem another name"
        ) from None
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise ProblemError(f"cannot write {target}: it exists and is not a folder; choose another --out")
    if target.is_dir() and any(target.iterdir()) and not (target / record).is_file():
        raise ProblemError(f"cannot write {target}: the folder holds other files; choose another --out, or empty it")
    # Missing parents will be created in the nearest one that exists, so that one must be writable.
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
    """Write an output folder atomically in place of that of an earlier run, but keep the user's own files in it.

    Args:
        target: path wanted for the folder.
        files: content by file name; names with slashes lie in subfolders.
        record: name of the file whose presence identifies the folder of an earlier run of the same kind.
        beside: function called under the lock with ``target``; returns the folder to write, ``target`` or a sibling.

    Returns:
        The folder written.

    Raises:
        ProblemError: the folder cannot be written; an old one is then unchanged.
    """

    def chosen(wanted: Path) -> Path:
        place = beside(wanted)
        check_target(place, record)
        return place

    try:
        return atomic_replace(target, files, WRITTEN_FILES, chosen)
    except OSError as error:
        raise ProblemError(f"cannot write {target}: {error.strerror or error}; choose another --out") from error
