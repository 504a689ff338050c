"""Runs of ``ccm-opt`` commands in the process of the tests, and checks of the pictures that commands write."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ccm_opt.cli.commands import app


@dataclass(frozen=True)
class Ran:
    """Result of a command.

    Attributes:
        code: exit code.
        out: text on standard output.
        err: text on standard error.
    """

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, object]:
        """The single result of a command with ``--json``."""
        (found,) = json.loads(self.out)["results"]
        assert isinstance(found, dict)
        return found


class CommandLine:
    """Runner of ``ccm-opt`` commands in the process of the tests."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str | Path) -> Ran:
        """Run one command with its arguments, and return exit code and output."""
        with pytest.raises(SystemExit) as ended:
            app(list(map(str, arguments)))
        told = self._capsys.readouterr()
        return Ran(int(ended.value.code or 0), told.out, told.err)


def brightness(file: Path) -> float:
    """Return the fraction of the pixels of a picture that are not white."""
    with Image.open(file) as picture:
        return float(np.mean(np.asarray(picture.convert("L")) < 250))
