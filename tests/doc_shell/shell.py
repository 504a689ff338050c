"""Bash in a folder of its own, with the problems, examples and a solved plan that the pages speak of."""

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
"""Of the terminal on which the pages' output was printed."""


class Server:
    """The process that holds the package; a context."""

    def __init__(self, folder: Path) -> None:
        self.address = folder / "server"
        self.programs = folder / "programs"
        self.programs.mkdir()
        for program in ("ccm-opt", "python"):
            script = self.programs / program
            # Isolated and without site packages, a client starts in 20 ms.
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "{CLIENT}" {program} "{self.address}" "$@"\n')
            script.chmod(0o755)

    def __enter__(self) -> Self:
        """Start it, and wait until it has loaded."""
        module = ["-m", "tests.doc_shell.server", str(self.address)]
        self._process = subprocess.Popen(
            [sys.executable, *module], cwd=ROOT, stdout=subprocess.PIPE, text=True, env=environment(self.programs)
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._process.terminate()
        self._process.communicate()


def environment(programs: Path) -> dict[str, str]:
    """What programs of the pages see: theirs first, the project's modules, one thread, no colours."""
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
    """What a command said: both streams as they came, and how it ended."""

    text: str
    code: int


class Shell:
    """Runs blocks in one folder, as somebody would who follows a page from its top."""

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
        """Run commands; the first that fails ends them. Of scripts perhaps only as far as they read their options."""
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
        """Run Python code as a file in the folder."""
        (self.folder / name).write_text(code)
        return self.run(f"python {name}")
