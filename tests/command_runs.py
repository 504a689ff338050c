"""Runs of the command line in the tests' own process, and a look at the pictures that they leave."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ccm_opt.cli.commands import app


@dataclass(frozen=True)
class Ran:
    """What a command did.

    Attributes:
        code: exit code.
        out: on standard output.
        err: on standard error.
    """

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, object]:
        """The only result of a run with ``--json``."""
        (found,) = json.loads(self.out)["results"]
        assert isinstance(found, dict)
        return found


class CommandLine:
    """Runs commands in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str | Path) -> Ran:
        """Run one command."""
        with pytest.raises(SystemExit) as ended:
            app(list(map(str, arguments)))
        told = self._capsys.readouterr()
        return Ran(int(ended.value.code or 0), told.out, told.err)


def brightness(file: Path) -> float:
    """How much of a picture is not white, from 0 to 1."""
    with Image.open(file) as picture:
        return float(np.mean(np.asarray(picture.convert("L")) < 250))
