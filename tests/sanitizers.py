"""``python -m tests.sanitizers`` runs the tests that reach C with a library that watches its memory and its numbers.

It is compiled by gcc or clang with AddressSanitizer and UndefinedBehaviorSanitizer into a folder of its own; the first
finding ends the run, with the place in the source. Arguments are those of pytest; without any, the modules below run.
"""

# ruff: noqa: T201 - it prints what it does
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from ccm_opt.core.native import LIBRARY
from hatch_build import build, find_compiler

# ``WIDE`` is empty, since it selects machine code at load time, before the sanitizers are initialised.
FLAGS = (
    "-O1",
    "-g",
    "-DWIDE=",
    "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
)
MODULES = (
    "native_bounds",
    "native",
    "near_pairs",
    "wall_proofs",
    "motion_certificate",
    "motion_connect",
    "sweep_planes",
    "surface_tree",
    "space_kinematics",
    "curve_space",
    "space_curve_map",
    "space_certificate",
    "followable_ways",
    "dynamics",
    "planar_dynamics",
    "simulation",
)


def main(arguments: list[str]) -> int:
    """Compile the C library with sanitizers, run tests with it, and return the exit code of pytest."""
    root = Path(__file__).parents[1]
    with tempfile.TemporaryDirectory() as folder:
        watched = Path(folder) / LIBRARY.name
        build(watched, Path(folder) / "objects", FLAGS)
        # Test libraries in C++ throw exceptions, for which the sanitizer needs libstdc++ to be loaded first.
        asked = [[*find_compiler(), f"-print-file-name={name}"] for name in ("libasan.so", "libstdc++.so")]
        found = [subprocess.run(each, capture_output=True, text=True, check=True).stdout.strip() for each in asked]
        environment = os.environ | {
            "CCM_OPT_NATIVE": str(watched),
            "LD_PRELOAD": ":".join(found),
            "PYTHONMALLOC": "malloc",
            "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1",
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }
        tests = arguments or [f"tests/test_{module}.py" for module in MODULES]
        # A library that is none of the sanitizers' is not told of here.
        command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:faulthandler", *tests]
        code = subprocess.run(command, cwd=root, env=environment, check=False).returncode
    print("sanitizers: no finding" if code == 0 else f"sanitizers: pytest ended with {code}")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
