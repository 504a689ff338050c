"""The same problem, seed and versions give the same bytes, whatever the surroundings."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import PROBLEMS


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("problem", ["feed-s-duct", "space/elbow"])
def test_surroundings_change_no_byte(problem: str, tmp_path: Path) -> None:
    """Other numbers of threads, hash seeds, working directories: the same ``solution.npz``.

    The first motion is one whose sums two threads share: it differed by 1e-14. The second leaves the plane, past
    meshes.
    """
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    (tmp_path / "elsewhere").mkdir()
    file = PROBLEMS / f"{problem}.toml"
    plain = solved(file, tmp_path / "plain", Path.cwd(), dict.fromkeys(threads, "1") | {"PYTHONHASHSEED": "0"})
    other = solved(
        file,
        tmp_path / "other",
        tmp_path / "elsewhere",
        dict.fromkeys(threads, "2") | {"PYTHONHASHSEED": "7"},
    )
    assert plain == other


def solved(problem: Path, out: Path, working_directory: Path, surroundings: dict[str, str]) -> bytes:
    """``solution.npz`` of a problem, made by a process of its own."""
    command = [sys.executable, "-m", "ccm_opt", "solve", str(problem), "--no-pictures", "--quiet", "--out", str(out)]
    path = os.pathsep.join(filter(None, (str(PROBLEMS.parent), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": path} | surroundings
    ended = subprocess.run(
        command, cwd=working_directory, env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert ended.returncode == 0, ended.stderr
    return (out / problem.stem / "solution.npz").read_bytes()
