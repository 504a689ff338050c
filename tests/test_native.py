"""The compiled library: built by one command, told of in one line where it is missing, and called with what fits."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core import native
from ccm_opt.core.errors import NativeLibraryError
from ccm_opt.core.native import NativeCall
from hatch_build import BuildError, build, find_compiler
from tests.conftest import PROBLEMS

FAILS = "#!/bin/sh\necho warming up >&2\necho 'x.c:1:2: error: out of paper' >&2\nexit 1\n"


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No library where it should be."""
    for kept in (native.native_library, native._native_interface, native._struct_layout):
        kept.cache_clear()
    monkeypatch.setattr(native, "LIBRARY", tmp_path / "_native.so")


@pytest.mark.usefixtures("nowhere")
def test_a_missing_library_is_told_with_what_to_do() -> None:
    """Whoever calls C without a library gets one error that says how to build it."""
    with pytest.raises(NativeLibraryError, match=r"_native.so is missing: .*python hatch_build.py"):
        NativeCall("chain")


@pytest.mark.usefixtures("nowhere")
def test_what_is_no_library_is_told_with_what_to_do() -> None:
    """A file that the system cannot load is no bug but a broken installation."""
    native.LIBRARY.write_text("no library")
    with pytest.raises(NativeLibraryError, match="cannot be loaded"):
        NativeCall("chain")


def test_an_older_library_is_told_with_what_to_do() -> None:
    """A function that the sources have, but the library has not, asks for a build."""
    with pytest.raises(NativeLibraryError, match="older than its source"):
        NativeCall("of_tomorrow")


def test_the_library_has_every_function_that_is_called() -> None:
    """Each name that the package's sources hand to C is one of the library, so that no source of C was left behind."""
    sources = (path.read_text(encoding="utf-8") for path in Path(ccm_opt.__file__).parent.rglob("*.py"))
    called = {name for text in sources for name in re.findall(r'NativeCall\(\s*"(\w+)"', text)}
    assert "pair_proofs" in called
    assert called - set(native._native_interface()) == set()


@pytest.mark.drawn(20, of="dear tests")
def test_the_command_line_tells_a_missing_library_in_one_line(tmp_path: Path) -> None:
    """No traceback: the line says how to build it, and the exit code is that of what cannot be used."""
    script = (
        "from pathlib import Path; from ccm_opt.core import native; native.LIBRARY = Path('none.so');"
        "from ccm_opt.cli import main; main()"
    )
    command = [sys.executable, "-c", script, "solve", str(PROBLEMS / "swan-neck.toml"), "--out", str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 2
    assert "none.so is missing" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_what_c_writes_into_must_fit() -> None:
    """An array of another type or layout would be written out of bounds; it is refused by its name."""
    for array in (np.zeros(8, dtype=np.float32), np.zeros(16)[::2], np.zeros(8, dtype=np.int64)):
        with pytest.raises(TypeError, match="'points' must be a contiguous array of float64"):
            NativeCall("places", points=array)


def test_what_c_reads_is_converted_and_kept() -> None:
    """Whole numbers, other layouts and sequences become what C expects, and live as long as the call."""
    call = NativeCall(
        "curve_shapes", joints=2, links=2, knots=2, spacing=1, lengths=[1, 1], places=[0, 1], shapes=np.zeros((2, 2))
    )
    call()
    assert np.all(np.isfinite(call._kept["shapes"]))


@pytest.mark.skipif(os.name != "posix", reason="scripts that can be run are POSIX's")
def test_a_build_that_fails_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of all that a compiler says the error is told; a compiler that cannot be run is told by its name."""
    compiler = tmp_path / "strange-cc"
    compiler.write_text(FAILS)
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(BuildError, match=r"^the C compiler failed: x\.c:1:2: error: out of paper$"):
        build(tmp_path / "library.so", tmp_path / "work")
    monkeypatch.setenv("CC", str(tmp_path / "none"))
    with pytest.raises(BuildError, match=r"none cannot be run: No such file"):
        build(tmp_path / "library.so", tmp_path / "work")
    assert not (tmp_path / "library.so").exists()


def test_without_a_compiler_the_build_asks_for_zig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Nothing on the path and no wheel of zig: none is found, and building in place says what to install."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("hatch_build.find_spec", lambda _: None)
    assert find_compiler() == []
    with pytest.raises(BuildError, match="pip install ziglang"):
        build(tmp_path / "library.so", tmp_path / "work")
