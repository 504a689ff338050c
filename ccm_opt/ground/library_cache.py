"""Compiled C on disk: where a library stands, whether it can be trusted, and how it gets there.

A library's name is a digest of all that its machine code depends on, so that a change of any of it compiles anew and
nothing is ever stale. Beside it stands the digest of its own bytes: a library that was cut short or changed is not
loaded, since the system would end the process, with no word, at the first missing page.
"""

import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import platformdirs

from ccm_opt.ground.c_compiler import CompilerError, compile_library
from ccm_opt.ground.plain_file import read_plain

CACHE_VARIABLE = "CCM_OPT_CACHE"
"""Environment variable that names the folder of the cache."""
PREBUILT = Path(__file__).with_name("prebuilt")
"""Folder of the libraries that were compiled when the package was built or installed."""
_MOST_BYTES = 2**26
"""No library is nearly as large [bytes]."""
_UNFINISHED = "unfinished-"
_HOUR = 3600.0


def cache_folder() -> Path | None:
    """Folder of the compiled libraries: under ``CCM_OPT_CACHE`` or the user's cache folder; None without a home."""
    root = os.environ.get(CACHE_VARIABLE)
    if not root:
        try:
            root = platformdirs.user_cache_dir("ccm_opt", appauthor=False)
        except RuntimeError:  # an account that the system does not know, as in containers
            return None
        if root.startswith("~"):  # so say versions that do not raise
            return None
    return Path(root) / "libraries"


def digest_file(path: Path) -> Path:
    """Where the digest of a library's bytes stands."""
    return path.with_name(path.name + ".sha256")


def is_whole(path: Path) -> bool:
    """Whether a library has the size and the digest that it had when it was made.

    Raises:
        OSError: what is there cannot be read, or is no file.
    """
    try:
        told = read_plain(digest_file(path), _MOST_BYTES).decode("ascii", errors="replace").split()
        content = read_plain(path, _MOST_BYTES)
    except FileNotFoundError:
        return False
    return told == [hashlib.sha256(content).hexdigest(), str(len(content))]


def is_mine_alone(path: Path) -> bool:
    """Whether a file or folder belongs to the user and nobody else can write there.

    Raises:
        OSError: there is none.
    """
    if os.name != "posix":
        return True  # Windows keeps the user's folders by lists of rights, which other users are not in
    found = path.stat(follow_symlinks=False)
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def make_folder(folder: Path) -> None:
    """Make sure that there is a folder which is the user's alone.

    Raises:
        CompilerError: there is one that is not.
        OSError: there is no making it.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    if not is_mine_alone(folder):
        raise CompilerError(
            f"others can write in {folder}, where compiled libraries are kept: remove it, or name another folder by "
            f"{CACHE_VARIABLE}"
        )


def compile_into(path: Path, files: Mapping[str, str], compiler: str, flags: tuple[str, ...]) -> None:
    """Compile C, and put the finished library in its place in one step, so that readers see all or nothing.

    Args:
        path: of the library.
        files: texts by their names; the first is compiled and may include the others.
        compiler: path of the compiler.
        flags: of the compiler.

    Raises:
        OSError: it cannot be compiled or written; ``CompilerError`` where the compiler is to blame.
    """
    _remove_leftovers(path.parent)
    # Beside its destination, since a rename is atomic within one file system only.
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=_UNFINISHED) as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        output = Path(folder) / path.name
        compile_library(compiler, Path(folder) / next(iter(files)), output, flags)
        output.chmod(0o700)
        content = output.read_bytes()
        digest = digest_file(output)
        digest.write_text(f"{hashlib.sha256(content).hexdigest()} {len(content)}\n", encoding="ascii")
        # A reader between the two sees a library without its digest, and makes it once more.
        digest.replace(digest_file(path))
        output.replace(path)


def _remove_leftovers(folder: Path) -> None:
    """Remove what a process that was killed has left; nothing compiles for an hour."""
    for left in folder.glob(f"{_UNFINISHED}*"):
        try:
            old = time.time() - left.stat().st_mtime > _HOUR
        except OSError:
            continue  # another process has just removed it
        if old:
            shutil.rmtree(left, ignore_errors=True)
