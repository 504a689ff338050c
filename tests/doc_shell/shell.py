"""Bash in a temporary folder with the problems, the examples and a solved plan to which the documentation refers."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from tests.doc_shell.server import READ_ONLY_VARIABLE

ROOT = Path(__file__).parent.parent.parent
CLIENT = Path(__file__).with_name("client.py")
SHOWN_COLUMNS = 100
"""Width of the terminal on which the output in the documentation was printed, in columns."""


class Server:
    """Context manager of the server process that holds the loaded package."""

    def __init__(self, folder: Path) -> None:
        self.address = folder / "server"
        self.programs = folder / "programs"
        self.programs.mkdir()
        for program in ("ccm-opt", "python"):
            script = self.programs / program
            # In isolated mode and without site packages, a client starts in 20 ms.
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "{CLIENT}" {program} "{self.address}" "$@"\n')
            script.chmod(0o755)

    def __enter__(self) -> Self:
        """Start the server process, and wait until it has loaded the package."""
        module = ["-m", "tests.doc_shell.server", str(self.address)]
        self._process = subprocess.Popen(
            [sys.executable, *module], cwd=ROOT, stdout=subprocess.PIPE, text=True, env=environment(self.programs)
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"
        return self

    def __exit__(self, *_: object) -> None:
        """End the server process."""
        self._process.terminate()
        self._process.communicate()


def environment(programs: Path) -> dict[str, str]:
    """Return environment variables for programs of the pages: substitutes first in PATH, one thread, no colours."""
    return {
        **os.environ,
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "MPLBACKEND": "agg",
        "COLUMNS": str(SHOWN_COLUMNS),
        "NO_COLOR": "1",
    }


@dataclass(frozen=True)
class Printed:
    """Output of a command, both streams in one text, and its exit code."""

    text: str
    code: int


class Shell:
    """Runner of code blocks in one folder, in which files of earlier blocks remain, as for a reader of a page."""

    def __init__(self, server: Server, folder: Path, solved: Path | None) -> None:
        self.folder = folder
        self._environment = environment(server.programs)
        for name in ("problems", "examples"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for drawing in (ROOT / "tests" / "data").glob("scene.*"):
            shutil.copy(drawing, folder)
        shutil.copy(Path(__file__).with_name("terms.py"), folder)
        (folder / ".venv").mkdir()
        (folder / ".venv" / "bin").symlink_to(server.programs)
        if solved is not None:
            shutil.copytree(solved, folder / "runs" / solved.name)

    def run(self, commands: str, *, only_read: bool = False) -> Printed:
        """Run commands in bash until one fails; with ``only_read``, scripts stop once their options are parsed."""
        read = {READ_ONLY_VARIABLE: "1"} if only_read else {}
        ended = subprocess.run(
            ["/bin/bash", "-euo", "pipefail", "-c", commands],
            cwd=self.folder,
            env={**self._environment, **read},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        return Printed(ended.stdout, ended.returncode)

    def run_python(self, code: str, name: str) -> Printed:
        """Write Python code to a file of the folder, and run it."""
        (self.folder / name).write_text(code)
        return self.run(f"python {name}")
