"""The tutorial: its cells run in order and give what the page shows; it becomes a page for Sphinx."""

import re
from pathlib import Path
from typing import Any

import pytest

from docs.notebook_pages import as_page, read, run, source

TUTORIAL = Path(__file__).parent.parent / "docs" / "tutorial.ipynb"


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[dict[str, Any], dict[str, Any]]:
    """The notebook with outputs of its own, and the namespace in which it ran."""
    monkeypatch.chdir(tmp_path)
    notebook = read(TUTORIAL)
    return notebook, run(notebook)


def words(outputs: list[dict[str, Any]]) -> str:
    """What a cell printed, and what kind of thing it ended with; numbers aside."""
    texts = ["".join(output.get("text", "")) for output in outputs]
    kinds = [",".join(sorted(output.get("data", {}))) for output in outputs]
    return re.sub(r"-?\d+(\.\d+)?", "#", " ".join(texts + kinds))


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_the_tutorial_runs_and_shows_what_it_gives(ran: tuple[dict[str, Any], dict[str, Any]], tmp_path: Path) -> None:
    """Every cell runs, its words are those on the page, and constraint and cost do what the text says of them."""
    notebook, namespace = ran
    shown = [cell for cell in read(TUTORIAL)["cells"] if cell["cell_type"] == "code"]
    given = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for before, now in zip(shown, given, strict=True):
        assert words(before["outputs"]) == words(now["outputs"]), source(now)
    lowest = [namespace[name].joint_positions[:, -1, 1].min() for name in ("solution", "above", "narrow")]
    assert lowest[0] < 0.09 - 1e-3
    assert min(lowest[1:]) > 0.09 - 1e-6
    assert namespace["reach_to_the_left"](namespace["narrow"]) < 0.8 * namespace["reach_to_the_left"](
        namespace["above"]
    )
    assert all(check.passed for check in namespace["checks"])
    assert (tmp_path / "runs" / "under-the-shelf" / "solution.json").is_file()


def test_a_notebook_becomes_a_page() -> None:
    """Text stays, code and prints are blocks, pictures are drawn, tables are tables; a silent cell shows nothing."""
    cells = [
        {"cell_type": "markdown", "source": ["# Title\n", "words"]},
        {"cell_type": "code", "source": ["print('a')\n", "1 + 1"]},
        {"cell_type": "code", "source": ["1 + 1;"]},
        {"cell_type": "code", "source": ["class T:\n    def _repr_html_(self): return '<b>t</b>'\n", "T()"]},
        {"cell_type": "code", "source": ["from matplotlib.figure import Figure\n", "Figure((1, 1))"]},
    ]
    notebook = {"cells": cells}
    run(notebook)
    page = as_page(notebook)
    assert page.startswith("# Title\nwords\n\n```python\nprint('a')\n1 + 1\n```\n\n```text\na\n```\n\n```text\n2\n```")
    assert "```python\n1 + 1;\n```\n\n```python" in page
    assert "```{raw} html\n<b>t</b>\n```" in page
    assert "![](data:image/png;base64,iVBOR" in page


def test_the_tutorial_begins_with_installing_and_has_outputs() -> None:
    """It goes from install to an own problem, an own constraint and an own cost, and is kept with what it shows."""
    page = as_page(read(TUTORIAL))
    headings = re.findall(r"^## (.*)$", page, re.MULTILINE)
    order = [headings.index(each) for each in ("Install", "A problem of your own", "Solve it")]
    order += [headings.index(each) for each in ("A constraint of your own", "A cost of your own")]
    assert order == sorted(order)
    assert page.count("data:image/png") == 3
