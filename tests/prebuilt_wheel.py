"""Whether an installed wheel brings all of its compiled C, for every processor of this kind; for cibuildwheel.

python tests/prebuilt_wheel.py
"""

# ruff: noqa: T201 - a script that stands alone, and prints its result
import sys

from ccm_opt.dynamics.runtime.compiled_library import every_recipe
from ccm_opt.ground.compiled_source import open_with_symbols
from ccm_opt.ground.library_cache import PREBUILT, is_whole
from ccm_opt.ground.machine_code import best_level, levels_here
from ccm_opt.ground.prebuilding import recipes_of_sources


def main() -> int:
    """Look for every library; the exit code is 1 where one is missing or cannot be loaded."""
    recipes = (*recipes_of_sources(), *every_recipe())
    missing = [
        recipe.name for recipe in recipes for flags in levels_here() if not is_whole(PREBUILT / recipe.file_name(flags))
    ]
    if missing:
        print(f"missing in {PREBUILT}: {', '.join(missing)}")
        return 1
    for recipe in recipes:
        open_with_symbols(PREBUILT / recipe.file_name(best_level()), ())
    print(f"{len(recipes)} libraries, each for {len(levels_here())} kinds of processor")
    return 0


if __name__ == "__main__":
    sys.exit(main())
