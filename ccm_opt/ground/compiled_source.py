"""Compiled libraries of C, made when they are first asked for; None where there is no compiling."""

import ctypes
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ccm_opt.ground.c_compiler import find_compiler, machine_code_key
from ccm_opt.ground.library_cache import (
    LOADING_ERRORS,
    cache_folder_of,
    compile_into,
    first_line,
    library_name,
    open_with_symbols,
    opened_or_made,
)

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LibraryRecipe:
    """How a library is made, and what stands in for it.

    Attributes:
        kind: folder of the cache.
        symbols: functions that take one pointer and return nothing.
        parts: all that the machine code depends on beside compiler and processor.
        files: writes the C files, texts by their names; the first is compiled and includes the others.
        otherwise: what happens without the library, for the log.
    """

    kind: str
    symbols: tuple[str, ...]
    parts: tuple[str, ...]
    files: Callable[[], dict[str, str]]
    otherwise: str


def compiled_source(
    source: Path, symbols: tuple[str, ...], kind: str, otherwise: str, headers: tuple[str, ...] = ()
) -> ctypes.PyDLL | None:
    """The library of a C file of the package.

    Args:
        source: of the file.
        symbols: functions that take one pointer and return nothing.
        kind: folder of the cache.
        otherwise: what happens without the library, for the log.
        headers: of this folder that the file includes, by name.
    """
    compiler = find_compiler()
    if compiler is None:
        _log_uncompiled(otherwise, "no C compiler was found")
        return None
    return _library(source, symbols, kind, otherwise, headers, compiler, str(cache_folder_of(kind)))


def library_of(recipe: LibraryRecipe) -> ctypes.PyDLL | None:
    """The library of a recipe, from the cache or compiled first."""
    compiler = find_compiler()
    if compiler is None:
        _log_uncompiled(recipe.otherwise, "no C compiler was found")
        return None
    try:
        return opened_or_made(
            library_path(recipe, compiler),
            lambda path: open_with_symbols(path, recipe.symbols),
            lambda path: compile_into(path, recipe.files(), compiler),
        )
    except LOADING_ERRORS as error:
        _log_uncompiled(recipe.otherwise, first_line(error))
        return None


def library_path(recipe: LibraryRecipe, compiler: str) -> Path:
    """Where the library of a recipe stands, or will; its name is a digest of all that it depends on."""
    return cache_folder_of(recipe.kind) / library_name((*recipe.parts, machine_code_key(compiler)))


@cache
def _library(
    source: Path,
    symbols: tuple[str, ...],
    kind: str,
    otherwise: str,
    headers: tuple[str, ...],
    compiler: str,
    folder: str,
) -> ctypes.PyDLL | None:
    """As ``compiled_source``; looked for once for a compiler and a folder of the cache."""
    del compiler, folder
    here = Path(__file__).parent
    files = {path.name: path.read_text(encoding="utf-8") for path in (source, *(here / name for name in headers))}
    parts = tuple(part for file in files.items() for part in file)
    return library_of(LibraryRecipe(kind, symbols, parts, lambda: files, otherwise))


@cache
def _log_uncompiled(otherwise: str, reason: str) -> None:
    """One line for one reason, however often the library is asked for."""
    logger.warning("%s: %s", otherwise, reason)
