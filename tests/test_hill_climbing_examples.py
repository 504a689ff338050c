"""The examples that draw the paper's figures run and say what the paper says (Figures 3 to 5)."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.drawn(2, of="examples")
@pytest.mark.parametrize(
    ("example", "picture", "words"),
    [
        ("05_figure_3.py", "figure-3.png", ("arrived", "SCM-0 stopped")),
        ("06_figure_4.py", "figure-4.png", ("SCM-1 selects right",)),
        pytest.param("07_figure_5.py", "figure-5.png", ("5 merge and climb",), marks=pytest.mark.planning),
    ],
)
def test_the_figures_are_drawn(example: str, picture: str, words: tuple[str, ...], tmp_path: Path) -> None:
    """Each example writes its picture into the folder it is given and prints how its climbs ended."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / example), str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert all(word in done.stdout for word in words)
    assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
