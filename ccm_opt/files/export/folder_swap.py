"""A folder put in the place of another: whole or not at all, whoever else writes there, whatever stops the program.

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

from ccm_opt.files.export.writing_settings import WRITING, WritingSettings

WORKSHOP = ".ccm-opt-writing"
"""Ends the name of a workshop, which begins with a dot and the name of the folder that is made in it."""
_HERE = -100
"""AT_FDCWD of Linux: paths begin where the process is."""
_EXCHANGE = 2
"""RENAME_EXCHANGE of Linux."""


def put_in_place(
    wanted: Path,
    files: Mapping[str, bytes],
    ours: Collection[str],
    chosen: Callable[[Path], Path],
    settings: WritingSettings = WRITING,
) -> Path:
    """Put a folder with these files in its place; entries of an old folder that are not ours stay.

    Args:
        wanted: the folder.
        files: content by file name; a name with slashes lies in folders of the folder.
        ours: names of files and folders that a run writes; they go with the old folder.
        chosen: called when nobody else writes there; gives the folder that is wanted or another one beside it, and
            raises where no place may be taken.
        settings: how long to wait for others.

    Returns:
        The folder.

    Raises:
        OSError: it cannot be written; then the old folder is as it was.
    """
    wanted.parent.mkdir(parents=True, exist_ok=True)
    with _alone_in(wanted.parent, settings):
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
def _alone_in(folder: Path, settings: WritingSettings) -> Iterator[None]:
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
        end = time.monotonic() + settings.patience
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise TimeoutError(errno.ETIMEDOUT, "another run has been writing there for too long") from None
                time.sleep(settings.look)
            except OSError:  # some file systems of networks know no locks
                break
        yield
    finally:
        os.close(handle)


def _assembled(workshop: Path, files: Mapping[str, bytes], target: Path, ours: Collection[str]) -> Path:
    """The new folder in the workshop, on the disk, with what is the user's in the old one."""
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
            if entry.name not in ours:
                _take_along(entry, new / entry.name)
    for folder in (new, *(place for place in new.rglob("*") if place.is_dir() and not place.is_symlink())):
        _sync(folder)
    return new


def _take_along(entry: Path, place: Path) -> None:
    """The same file or folder at another place: what is written to it at either is at both, where that can be."""
    if entry.is_dir() and not entry.is_symlink():
        shutil.copytree(entry, place, symlinks=True, copy_function=_link_or_copy)
    else:
        _link_or_copy(str(entry), str(place))


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
