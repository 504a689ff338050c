"""The machine's C compiler: which one, and how it is run so that nothing it does can harm more than its library."""

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ccm_opt.ground.compiler_settings import DEFAULT_COMPILER, CompilerSettings
from ccm_opt.ground.machine_code import FLAGS

COMPILER_VARIABLE = "CCM_OPT_CC"
"""Environment variable that names the compiler to use; empty: compiled code is not used at all."""
COMPILERS = ("gcc", "clang", "cc")


class CompilerError(OSError):
    """There is no compiled library to be had; the message says why, in one line."""


def find_compiler() -> str:
    """Path of the C compiler: ``CCM_OPT_CC`` or the first of gcc, clang, cc.

    Raises:
        CompilerError: there is none.
    """
    chosen = os.environ.get(COMPILER_VARIABLE)
    if chosen == "":
        raise CompilerError(f"{COMPILER_VARIABLE} is empty")
    for name in COMPILERS if chosen is None else (chosen,):
        path = shutil.which(name)
        if path:
            return path
    raise CompilerError("no C compiler was found" if chosen is None else f"{COMPILER_VARIABLE}: no program {chosen}")


def has_compiler() -> bool:
    """Whether there is a C compiler."""
    try:
        find_compiler()
    except CompilerError:
        return False
    return True


def compile_library(
    compiler: str,
    source: Path,
    output: Path,
    flags: tuple[str, ...] = FLAGS,
    settings: CompilerSettings = DEFAULT_COMPILER,
) -> None:
    """Compile one C file into a shared library.

    Raises:
        CompilerError: it cannot be run, refuses, takes too long, or makes nothing.
    """
    command = [compiler, *flags, str(source), "-o", str(output), "-lm"]
    # A file and no pipe: one who waits for the end of a pipe waits for the compiler's children as well.
    with tempfile.TemporaryFile() as words:
        code = _exit_code(command, words.fileno(), settings.time_limit)
        words.seek(0)
        said = words.read(settings.most_words).decode(errors="replace").split("\n")
    if code < 0:
        raise CompilerError(f"the C compiler {compiler} was ended by signal {-code}")
    if code > 0:
        reason = next((line.strip() for line in said if line.strip()), f"exit code {code}")
        raise CompilerError(f"the C compiler failed: {reason}")
    if not output.is_file() or output.stat().st_size == 0:
        raise CompilerError(f"the C compiler {compiler} made no library")


def _exit_code(command: Sequence[str], words: int, time_limit: float) -> int:
    """Run a command to its end or its time limit; whatever ends the wait ends its children with it.

    Args:
        command: program and arguments.
        words: file descriptor that takes all that it says.
        time_limit: [s].
    """
    try:
        process = subprocess.Popen(  # noqa: S603 - our own list
            command, stdin=subprocess.DEVNULL, stdout=words, stderr=words, start_new_session=os.name == "posix"
        )
    except OSError as error:
        raise CompilerError(f"the C compiler {command[0]} cannot be run: {error.strerror or error}") from error
    try:
        return process.wait(time_limit)
    except BaseException as error:
        _end(process)
        if isinstance(error, subprocess.TimeoutExpired):
            raise CompilerError(f"the C compiler {command[0]} took longer than {time_limit:g} s") from error
        raise


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and, where there are groups of processes, its children."""
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
