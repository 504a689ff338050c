"""Compiled C: compiled once, trusted only if it is whole and the user's own, and never a reason to fail or to hang."""

import logging
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.dynamics.runtime.forward_dynamics import ForwardDynamics
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.ground import c_compiler, compiled_source, library_cache
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.c_compiler import COMPILER_VARIABLE, CompilerError, compile_library, has_compiler
from ccm_opt.ground.compiled_source import SLOWER, LibraryRecipe, library_of
from ccm_opt.ground.compiler_settings import CompilerSettings
from ccm_opt.ground.library_cache import CACHE_VARIABLE, digest_file, is_whole
from ccm_opt.ground.machine_code import FLAGS, levels_here
from ccm_opt.ground.prebuilding import prebuild, recipes_of_sources
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.scene.surfaces import SurfaceSoup
from tests.dynamics_arms import swan_neck

GRAVITY = np.array([0.0, 0.0, -9.81])
ONE = LibraryRecipe("one", ("one",), lambda: {"one.c": "void one(double *x) { *x = 1.0; }\n"})
needs_compiler = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler")
posix = pytest.mark.skipif(os.name != "posix", reason="scripts that can be run, and owners, are POSIX's")

STRANGE = {
    "does nothing": "exit 0",
    "fails silently": "exit 1",
    "fails with a message": "echo 'out of paper' >&2; exit 1",
    "fails with an empty line": "echo >&2; exit 1",
    "is killed": "kill -9 $$",
    "writes Latin-1": "printf '\\351\\350\\n'; printf '\\351\\n' >&2; exit 1",
    "writes an empty library": 'while [ "$1" != -o ]; do [ -z "$1" ] && exit 0; shift; done; : > "$2"',
    "writes text for a library": 'while [ "$1" != -o ]; do [ -z "$1" ] && exit 0; shift; done; echo hello > "$2"',
    "hangs": "sleep 60",
    "leaves a child that hangs": "sleep 60 & exit 0",
}


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """An empty cache, nothing that came with the package, and no memory of failures."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv(COMPILER_VARIABLE, raising=False)
    monkeypatch.setattr(compiled_source, "PREBUILT", tmp_path / "none")
    compiled_source.forget_troubles()
    yield tmp_path / "cache" / "libraries"
    compiled_source.forget_troubles()


def libraries(folder: Path) -> list[Path]:
    """Compiled libraries of a folder."""
    return [path for path in folder.iterdir() if path.suffix != ".sha256"]


def torques(links: int = 2) -> FloatArray:
    """What inverse dynamics give at rest, compiled or not."""
    return InverseDynamics(swan_neck(links), GRAVITY)(*np.zeros((3, 3 * links)))


def script(folder: Path, body: str, first: str = "#!/bin/sh") -> Path:
    """A compiler of the test's own."""
    path = folder / "strange-cc"
    path.write_text(f"{first}\n{body}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


@posix
@pytest.mark.parametrize("body", STRANGE.values(), ids=STRANGE)
def test_a_strange_compiler_is_no_failure(
    body: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever the compiler does, one line says that compiled code is not used, and the numbers come all the same."""
    monkeypatch.setattr(compile_library, "__defaults__", (FLAGS, CompilerSettings(time_limit=0.5)))
    monkeypatch.setenv(COMPILER_VARIABLE, str(script(tmp_path, body)))
    begun = time.monotonic()
    with caplog.at_level(logging.WARNING):
        assert np.all(np.isfinite(torques()))
        assert np.all(np.isfinite(torques(3)))
        assert library_of(ONE, ("one",)) is None
    assert len(caplog.messages) == 1
    assert "compiled code is not used" in caplog.messages[0]
    assert "\n" not in caplog.messages[0]
    assert time.monotonic() - begun < 30.0  # the child that hangs does so for a minute


def test_a_scene_in_space_tells_it_no_second_time(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """However many scenes numpy searches, one line says that compiled code is not used, and what that costs."""
    monkeypatch.setenv(COMPILER_VARIABLE, "")
    soup = SurfaceSoup(np.eye(3)[None], np.zeros(1), np.zeros(1, dtype=np.intp), ("a triangle",))
    for _ in range(3):
        assert SurfaceTree.of(soup).distances(np.zeros((1, 2, 3)), 1.0) == pytest.approx(1.0 / np.sqrt(3.0))
    assert caplog.messages == [
        f"compiled code is not used, and plans take {SLOWER}: {COMPILER_VARIABLE} is empty",
    ]


@posix
@pytest.mark.parametrize("first", ["#!/nonexistent/sh", "\x7fELF garbage"])
def test_a_compiler_that_cannot_be_run(
    first: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A missing interpreter or a file that is no program is told in one line."""
    monkeypatch.setenv(COMPILER_VARIABLE, str(script(tmp_path, "", first)))
    assert np.all(np.isfinite(torques()))
    assert len(caplog.messages) == 1
    assert "cannot be run" in caplog.messages[0]


@posix
def test_the_compiler_s_words_are_told(tmp_path: Path) -> None:
    """The reason is the first line in which the compiler says something."""
    with pytest.raises(CompilerError, match=r"the C compiler failed: out of paper$"):
        compile_library(str(script(tmp_path, "echo; echo out of paper; exit 3")), Path("x.c"), tmp_path / "x.so")


@posix
def test_the_compiler_s_children_end_with_it(tmp_path: Path) -> None:
    """Past the time limit nothing of the compiler goes on."""
    mark = tmp_path / "still-there"
    compiler = script(tmp_path, f"(sleep 2; touch {mark}) & sleep 60")
    with pytest.raises(CompilerError, match=r"took longer than 0\.2 s"):
        compile_library(str(compiler), Path("x.c"), tmp_path / "x.so", settings=CompilerSettings(time_limit=0.2))
    time.sleep(2.5)
    assert not mark.exists()


@needs_compiler
def test_a_warm_cache_compiles_nothing(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """Other masses, lengths, gravity and numbers of links use the library that is there; nothing else is left."""
    for links in (2, 24, 200):
        ForwardDynamics(replace(swan_neck(links), payload=0.1 * links), GRAVITY)
    assert len(libraries(cache)) == 1
    ForwardDynamics(replace(swan_neck(2), rotor_inertia=1e-4), GRAVITY)
    assert len(libraries(cache)) == 2
    monkeypatch.setattr(compiled_source, "compile_into", _refuse_to_compile)
    assert np.all(np.isfinite(InverseDynamics(swan_neck(2, varied=True), -GRAVITY)(*np.zeros((3, 6)))))


def _refuse_to_compile(*_: object) -> None:
    pytest.fail("compiled although the library is in the cache")


@needs_compiler
@pytest.mark.parametrize("keep", [0.0, 0.25, 0.999])
def test_a_library_cut_short_is_compiled_again(keep: float, cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    """What would end the process at its first missing page is not loaded, but replaced; by another process too."""
    expected = torques()
    (path,) = libraries(cache)
    whole = path.read_bytes()
    put_anew(path, whole[: int(keep * len(whole))])
    ended = subprocess.run([sys.executable, "-c", AGAIN], capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 0, ended.stderr
    assert is_whole(path)
    put_anew(path, whole[:-1] + b"x")
    assert np.array_equal(torques(), expected)
    assert is_whole(path)
    assert not caplog.records


AGAIN = """
from pathlib import Path
from ccm_opt.ground import compiled_source
compiled_source.PREBUILT = Path("none")
from tests.test_compiled_libraries import torques
torques()
"""


def put_anew(path: Path, content: bytes) -> None:
    """Put other bytes in a library's place, but not into the file that this process has loaded."""
    path.unlink()
    path.write_bytes(content)
    path.chmod(0o700)


@needs_compiler
def test_a_library_without_its_digest_is_compiled_again(cache: Path) -> None:
    """One that another version, or somebody else, has put there is not loaded."""
    library_of(ONE, ("one",))
    (path,) = libraries(cache)
    digest_file(path).unlink()
    assert library_of(ONE, ("one",)) is not None
    assert is_whole(path)


@needs_compiler
@posix
@pytest.mark.parametrize("which", ["library", "digest"])
def test_a_pipe_in_the_cache_is_not_waited_for(which: str, cache: Path) -> None:
    """What is no file is not read, but replaced: nobody ever writes to a pipe that was left there."""
    library_of(ONE, ("one",))
    (path,) = libraries(cache)
    place = path if which == "library" else digest_file(path)
    place.unlink()
    os.mkfifo(place, 0o600)
    assert library_of(ONE, ("one",)) is not None
    assert is_whole(path)


@pytest.mark.parametrize("says", ["raises", "tells the tilde"])
def test_an_account_without_a_home_is_no_failure(
    says: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Where there is no place for a cache one line says what to set, and no folder with the name of a tilde is made."""

    def homeless(*_: object, **_options: object) -> str:
        if says == "raises":
            raise RuntimeError("could not determine the home directory")
        return "~/.cache/ccm_opt"

    monkeypatch.delenv(CACHE_VARIABLE)
    monkeypatch.setattr(library_cache.platformdirs, "user_cache_dir", homeless)
    monkeypatch.setattr(compiled_source, "find_compiler", lambda: "cc")
    monkeypatch.chdir(tmp_path)
    assert library_of(ONE, ("one",)) is None
    (message,) = caplog.messages
    assert message.endswith(
        f"the user has no home for compiled libraries: set HOME, or name a folder by {CACHE_VARIABLE}"
    )
    assert not list(tmp_path.iterdir())


@needs_compiler
@posix
def test_what_others_can_write_is_not_loaded(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A library that others can change is made anew; in a folder where others can write nothing is loaded or made."""
    library_of(ONE, ("one",))
    (path,) = libraries(cache)
    path.chmod(0o777)
    before = path.stat().st_ino
    assert library_of(ONE, ("one",)) is not None
    assert path.stat().st_ino != before
    assert path.stat().st_mode & 0o777 == 0o700
    assert not caplog.records
    cache.chmod(0o770)
    assert library_of(ONE, ("one",)) is None
    (message,) = caplog.messages
    assert message.startswith(f"compiled code is not used, and plans take {SLOWER}: others can write in")
    assert message.endswith(f"remove it, or name another folder by {CACHE_VARIABLE}")


@needs_compiler
@posix
def test_a_library_of_another_user_is_not_loaded(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """Whose the folder is decides, whoever may write there."""
    library_of(ONE, ("one",))
    assert cache.stat().st_mode & 0o777 == 0o700
    monkeypatch.setattr(os, "geteuid", lambda: cache.stat().st_uid + 1)
    assert library_of(ONE, ("one",)) is None


@needs_compiler
def test_many_at_once_share_one_library(cache: Path) -> None:
    """Loading the same functions from several threads at once leaves one whole library."""
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: torques(), range(4)))
    assert all(np.array_equal(result, results[0]) for result in results)
    assert len(libraries(cache)) == 1


@needs_compiler
def test_what_a_killed_process_left_is_removed(cache: Path) -> None:
    """Folders of compilers that were killed long ago go with the next compilation; those of others at work stay."""
    old, young = cache / "unfinished-old", cache / "unfinished-young"
    for folder in (old, young):
        folder.mkdir(parents=True)
    cache.chmod(0o700)
    os.utime(old, (0.0, 0.0))
    library_of(ONE, ("one",))
    assert not old.exists()
    assert young.exists()
    shutil.rmtree(young)


@needs_compiler
def test_what_comes_with_the_package_needs_no_compiler(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, cache: Path
) -> None:
    """A library made when the package was built is loaded, with neither compiler nor cache."""
    prebuilt = tmp_path / "prebuilt"
    made = prebuild((ONE,), prebuilt)
    assert len(made) == 2 * len(levels_here())
    monkeypatch.setattr(compiled_source, "PREBUILT", prebuilt)
    monkeypatch.setattr(c_compiler.shutil, "which", lambda _: None)
    assert library_of(ONE, ("one",)) is not None
    assert not cache.exists()
    stale = prebuilt / "one-of-before.so"
    stale.touch()
    monkeypatch.undo()
    prebuild((ONE,), prebuilt)
    assert not stale.exists()


def test_every_c_file_goes_with_the_package() -> None:
    """The files that are compiled at building are those that are asked for at run time."""
    package = Path(library_cache.__file__).parents[1]
    asked = {
        line.split('.with_name("')[1].split('"')[0]
        for path in package.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if '.with_name("' in line and '.c")' in line
    }
    assert {recipe.name + ".c" for recipe in recipes_of_sources()} == asked
