"""Compiled C on disk: a library is compiled once for a machine, into the cache, and then loaded.

A library's name is a digest of all that its machine code depends on, so that a change of any of it compiles anew and
nothing is ever stale.
"""

import ctypes
import hashlib
import os
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import platformdirs

from ccm_opt.ground.c_compiler import SUFFIX, compile_library

CACHE_VARIABLE = "CCM_OPT_CACHE"
"""Environment variable that names the folder of the cache."""
LOADING_ERRORS = (OSError, AttributeError, RuntimeError, subprocess.SubprocessError)
"""What may go wrong on the way to a library, none of which is a failure where there is a fall-back."""
_one_at_a_time = threading.Lock()  # threads that want the same library wait for the first, and then find it


def cache_folder_of(kind: str) -> Path:
    """Folder of the libraries of one kind: under ``CCM_OPT_CACHE`` or the user's cache folder."""
    root = os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("ccm_opt", appauthor=False)
    return Path(root) / kind


def library_name(parts: Sequence[str]) -> str:
    """The file name of a library that depends on the parts."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32] + SUFFIX


def opened_or_made(
    path: Path, open_library: Callable[[Path], ctypes.PyDLL], make: Callable[[Path], None]
) -> ctypes.PyDLL:
    """The library at a path, which is made first where there is none or a damaged one.

    Raises:
        OSError, AttributeError, RuntimeError, SubprocessError: there is no making it.
    """
    with _one_at_a_time:
        if path.exists():
            try:
                return open_library(path)
            except (OSError, AttributeError):
                pass  # damaged: it is made anew
        make(path)
        return open_library(path)


def open_with_symbols(path: Path, symbols: Sequence[str]) -> ctypes.PyDLL:
    """Load a library that keeps the interpreter's lock while it runs, which makes short calls shorter.

    Its functions take one pointer and return nothing.

    Raises:
        OSError: it is none.
        AttributeError: it lacks a symbol.
    """
    library = ctypes.PyDLL(str(path))
    for symbol in symbols:
        function = getattr(library, symbol)
        function.restype = None
        function.argtypes = (ctypes.c_void_p,)
    return library


def compile_into(path: Path, files: Mapping[str, str], compiler: str) -> None:
    """Compile C, and put the finished library in its place in one step, so that readers see all or nothing.

    Args:
        path: of the library.
        files: texts by their names; the first is compiled and may include the others.
        compiler: path of the compiler.

    Raises:
        OSError, SubprocessError: it cannot be compiled or written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # Beside its destination, since a rename is atomic within one file system only.
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        output = Path(folder) / path.name
        compile_library(compiler, Path(folder) / next(iter(files)), output)
        output.replace(path)


def first_line(error: BaseException) -> str:
    """What went wrong, in one line; of a compiler that fails its own words."""
    if isinstance(error, subprocess.CalledProcessError) and error.stderr:
        return f"the C compiler failed: {error.stderr.decode(errors='replace').strip().splitlines()[0]}"
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def pointer_to(struct: ctypes.Structure) -> ctypes.c_void_p:
    """The address of a structure, which lives as long as the pointer."""
    pointer = ctypes.c_void_p(ctypes.addressof(struct))
    pointer.owner = struct  # type: ignore[attr-defined]  # keeps it alive
    return pointer
