"""Whether an installed wheel brings its compiled C, and loads it; for cibuildwheel.

python tests/prebuilt_wheel.py
"""

# ruff: noqa: T201 - a script that stands alone, and prints its result
from ccm_opt.core.native import LIBRARY, NativeCall

if __name__ == "__main__":
    NativeCall("near_pairs")
    print(f"{LIBRARY.name} is there, {LIBRARY.stat().st_size // 1024} KiB")
