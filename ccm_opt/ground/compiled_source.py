"""The library of one C file of the package, compiled when it is first asked for; None where there is no compiling."""

import ctypes
import logging
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


def compiled_source(source: Path, symbols: tuple[str, ...], kind: str, otherwise: str) -> ctypes.PyDLL | None:
    """The library of a C file.

    Args:
        source: of the file.
        symbols: functions that take one pointer and return nothing.
        kind: folder of the cache.
        otherwise: what happens without the library, for the log.
    """
    compiler = find_compiler()
    if compiler is None:
        _log_uncompiled(otherwise, "no C compiler was found")
        return None
    return _library(source, symbols, compiler, str(cache_folder_of(kind)), otherwise)


@cache
def _library(source: Path, symbols: tuple[str, ...], compiler: str, folder: str, otherwise: str) -> ctypes.PyDLL | None:
    """The library, from the cache or compiled first; looked for once for a compiler and a cache."""
    text = source.read_text(encoding="utf-8")
    path = Path(folder) / library_name((machine_code_key(compiler), text))
    try:
        return opened_or_made(
            path, lambda path: open_with_symbols(path, symbols), lambda path: compile_into(path, text, compiler)
        )
    except LOADING_ERRORS as error:
        _log_uncompiled(otherwise, first_line(error))
        return None


@cache
def _log_uncompiled(otherwise: str, reason: str) -> None:
    """One line for one reason, however often the library is asked for."""
    logger.warning("%s: %s", otherwise, reason)
