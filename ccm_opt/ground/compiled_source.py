"""Compiled libraries of C: those that came with the package, else from the cache, else compiled; None for none."""

import ctypes
import hashlib
import logging
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ccm_opt.ground.c_compiler import COMPILER_VARIABLE, CompilerError, find_compiler
from ccm_opt.ground.library_cache import (
    CACHE_VARIABLE,
    PREBUILT,
    cache_folder,
    compile_into,
    is_mine_alone,
    is_whole,
    make_folder,
)
from ccm_opt.ground.machine_code import SUFFIX, best_level, target

logger = logging.getLogger(__name__)
HEADERS = tuple(sorted(Path(__file__).parent.glob("*.h")))
"""What every C file of the package may include, beside the headers of its own folder."""
SLOWER = "several times as long, in space some fifty times"
"""What it costs to do without; measured: 2 times for swan-neck.toml, 45 and 48 for the first two problems in space."""
_one_at_a_time = threading.Lock()  # threads that want the same library wait for the first, and then find it


@dataclass(frozen=True)
class LibraryRecipe:
    """How a library is made.

    Attributes:
        name: what the file's name begins with.
        parts: all that the machine code depends on beside its target.
        files: writes the C files, texts by their names; the first is compiled and includes the others.
    """

    name: str
    parts: tuple[str, ...]
    files: Callable[[], dict[str, str]]

    def file_name(self, flags: tuple[str, ...], chosen: str | None = None) -> str:
        """Name of the library's file for flags, and for a compiler that the user has chosen."""
        digest = hashlib.sha256("\n".join((*self.parts, target(flags), chosen or "")).encode()).hexdigest()
        return f"{self.name}-{digest[:24]}{SUFFIX}"


def source_recipe(source: Path) -> LibraryRecipe:
    """The recipe of a C file of the package."""
    headers = (*HEADERS, *sorted(source.parent.glob("*.h")))
    files = {path.name: path.read_text(encoding="utf-8") for path in (source, *headers)}
    parts = tuple(part for file in files.items() for part in file)
    return LibraryRecipe(source.stem, parts, lambda: files)


def compiled_source(source: Path, symbols: tuple[str, ...]) -> ctypes.PyDLL | None:
    """The library of a C file of the package; its functions take one pointer and return nothing."""
    return _library_of_source(source, symbols, os.environ.get(COMPILER_VARIABLE), cache_folder())


@cache
def _library_of_source(
    source: Path, symbols: tuple[str, ...], chosen: str | None, folder: Path | None
) -> ctypes.PyDLL | None:
    """As ``compiled_source``; looked for once for a compiler and a folder of the cache."""
    del chosen, folder
    return library_of(source_recipe(source), symbols)


def library_of(recipe: LibraryRecipe, symbols: Sequence[str]) -> ctypes.PyDLL | None:
    """The library of a recipe: with the package, from the cache, or compiled first.

    Args:
        recipe: how it is made.
        symbols: functions that take one pointer and return nothing.
    """
    chosen = os.environ.get(COMPILER_VARIABLE)
    with _one_at_a_time:
        if chosen is None:
            library = _loaded(PREBUILT / recipe.file_name(best_level()), symbols)
            if library is not None:
                return library
        if _trouble(chosen, cache_folder()):
            return None
        try:
            return _cached(recipe, symbols, chosen)
        except OSError as error:
            _note_trouble(chosen, cache_folder(), str(error).strip())
            return None


def _cached(recipe: LibraryRecipe, symbols: Sequence[str], chosen: str | None) -> ctypes.PyDLL:
    """The library in the cache, which is compiled first where there is none, a damaged or a doubtful one.

    Raises:
        OSError: there is no making it.
    """
    compiler = find_compiler()
    folder = cache_folder()
    if folder is None:
        raise CompilerError(
            f"the user has no home for compiled libraries: set HOME, or name a folder by {CACHE_VARIABLE}"
        )
    make_folder(folder)
    path = folder / recipe.file_name(best_level(), chosen)
    library = _loaded(path, symbols) if path.exists() and is_mine_alone(path) else None
    if library is None:
        compile_into(path, recipe.files(), compiler, best_level())
        library = _loaded(path, symbols)
    if library is None:
        raise CompilerError(f"what the C compiler {compiler} made cannot be loaded")
    return library


def _loaded(path: Path, symbols: Sequence[str]) -> ctypes.PyDLL | None:
    """A library that keeps the interpreter's lock while it runs, which makes short calls shorter; None if damaged."""
    try:
        return open_with_symbols(path, symbols) if is_whole(path) else None
    except (OSError, AttributeError):
        return None


def open_with_symbols(path: Path, symbols: Sequence[str]) -> ctypes.PyDLL:
    """Load a library whose functions take one pointer and return nothing.

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


def pointer_to(struct: ctypes.Structure) -> ctypes.c_void_p:
    """The address of a structure, which lives as long as the pointer."""
    pointer = ctypes.c_void_p(ctypes.addressof(struct))
    pointer.owner = struct  # type: ignore[attr-defined]  # keeps it alive
    return pointer


_TROUBLES: dict[tuple[str | None, Path | None], str] = {}
"""Why there is no compiling, by compiler and cache: one that failed once is not asked again."""


def _trouble(chosen: str | None, folder: Path | None) -> str | None:
    return _TROUBLES.get((chosen, folder))


def _note_trouble(chosen: str | None, folder: Path | None, reason: str) -> None:
    _TROUBLES[chosen, folder] = reason
    logger.warning("compiled code is not used, and plans take %s: %s", SLOWER, reason)


def forget_troubles() -> None:
    """Ask compilers again that have failed in this process."""
    _TROUBLES.clear()
    _library_of_source.cache_clear()
