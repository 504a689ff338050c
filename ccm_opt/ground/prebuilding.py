"""Compile the libraries that go with the package, when a wheel is built or the package installed."""

from collections.abc import Sequence
from pathlib import Path

from ccm_opt.ground.c_compiler import find_compiler
from ccm_opt.ground.compiled_source import LibraryRecipe, source_recipe
from ccm_opt.ground.library_cache import compile_into, digest_file
from ccm_opt.ground.machine_code import levels_here

PACKAGE = Path(__file__).parents[1]
PARTS_OF_OTHERS = PACKAGE / "dynamics" / "runtime"
"""Folder of the C files that are no library by themselves."""


def recipes_of_sources() -> tuple[LibraryRecipe, ...]:
    """The recipes of all C files of the package that are a library by themselves."""
    sources = sorted(path for path in PACKAGE.rglob("*.c") if path.parent != PARTS_OF_OTHERS)
    return tuple(source_recipe(source) for source in sources)


def prebuild(recipes: Sequence[LibraryRecipe], folder: Path) -> tuple[Path, ...]:
    """Compile libraries for every kind of processor that this system may have.

    Args:
        recipes: of the libraries.
        folder: where they go; what is there of another state of the sources is removed.

    Returns:
        The libraries and the files with their digests.

    Raises:
        OSError: they cannot be compiled or written; ``CompilerError`` where the compiler is to blame.
    """
    compiler = find_compiler()
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    for recipe in recipes:
        for flags in levels_here():
            path = folder / recipe.file_name(flags)
            compile_into(path, recipe.files(), compiler, flags)
            made.extend((path, digest_file(path)))
    for stale in set(folder.iterdir()) - set(made):
        stale.unlink()
    return tuple(made)
