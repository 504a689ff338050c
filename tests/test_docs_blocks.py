"""Every block of code in the pages runs, in a folder of its own."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomlkit

from ccm_opt.io.reading import load_problem, problem_from_mapping
from tests.doc_blocks import PAGES, ROOT, Block, exchanges, matches, runnable_blocks
from tests.doc_shell.shell import Server, Shell

WITH_BLOCKS = [page for page in PAGES if any(block.mark != "not run" for block in runnable_blocks(page))]
NOT_RUN = 20
"""Blocks that cannot be run in a test; each says why in the comment above it."""
EXIT_CODES_SHOWN = {0, 2, 3, 4}
"""Of commands in console blocks, which may show what a failure looks like."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The process that holds the package."""
    with Server(tmp_path_factory.mktemp("shell")) as running:
        yield running


@pytest.fixture(scope="module")
def solved(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plan that the pages go on with."""
    folder = tmp_path_factory.mktemp("solved")
    printed = Shell(server, folder, None).run("ccm-opt solve problems/swan-neck.toml --no-pictures")
    assert printed.code == 0, printed.text
    return folder / "runs" / "swan-neck"


@pytest.mark.parametrize("page", WITH_BLOCKS, ids=lambda page: str(page.relative_to(ROOT)))
def test_blocks_of_a_page_run(page: Path, server: Server, solved: Path, tmp_path: Path) -> None:
    """From top to bottom, every block of a page does what it is said to do."""
    shell = Shell(server, tmp_path, solved)
    done: set[str] = set()
    for block in runnable_blocks(page):
        # Where a gallery of problems is tested with one of them, once is enough.
        again = block.mark == "run with" and block.tested_code() in done
        if block.mark != "not run" and not again:
            run_block(block, shell)
            done.add(block.tested_code())


def run_block(block: Block, shell: Shell) -> None:
    """Run one block and judge it by its kind."""
    code = block.tested_code()
    if block.language == "toml":
        read_problem(block, code, shell)
    elif block.language == "console":
        for exchange in exchanges(code):
            printed = shell.run(exchange.command)
            assert printed.code in EXIT_CODES_SHOWN, f"{block.place}\n{printed.text}"
            assert matches(exchange.output, printed.text), f"{block.place}: {exchange.command}\n{printed.text}"
    else:
        if block.language == "python":
            printed = shell.run_python(code, file_of(block))
        else:
            printed = shell.run(code, only_read=block.mark == "only read")
        assert printed.code == 0, f"{block.place}\n{code}\nexit code {printed.code}\n{printed.text}"
        if block.mark != "only read":
            assert all((shell.folder / picture).is_file() for picture in block.tested_pictures()), block.place


def file_of(block: Block) -> str:
    """The file that a block of Python is said to be in its first line, for commands further down, or one of its own."""
    named = re.match(r"# (\w+\.py)$", block.code, re.MULTILINE)
    return named[1] if named else f"block_{block.line}.py"


def read_problem(block: Block, code: str, shell: Shell) -> None:
    """Read a problem file; an excerpt takes the place of the same tables of the swan's neck, or goes into a problem."""
    if block.mark == "excerpt of":
        original = ROOT / "problems" / block.note.strip()
        merged = _merged(tomlkit.parse(original.read_text()).unwrap(), tomlkit.parse(code).unwrap())
        assert problem_from_mapping(merged, block.place, original.parent).name
        return
    whole = tomlkit.parse((ROOT / "problems" / "swan-neck.toml").read_text()).unwrap()
    excerpt = tomlkit.parse(code).unwrap()
    file = shell.folder / f"block_{block.line}.toml"
    file.write_text(tomlkit.dumps(excerpt if "schema" in excerpt else {**whole, **excerpt}))
    assert load_problem(file).name


def _merged(whole: dict[str, Any], excerpt: dict[str, Any]) -> dict[str, Any]:
    """Return tables with the values of an excerpt, which replace those of equal keys at every depth."""
    both = {
        key: _merged(whole[key], value) if isinstance(value, dict) and isinstance(whole.get(key), dict) else value
        for key, value in excerpt.items()
    }
    return {**whole, **both}


@pytest.mark.planning
def test_blocks_that_are_not_run_are_few_and_say_why() -> None:
    """As many blocks as are known are left out, each with its reason."""
    left_out = [block for page in PAGES for block in runnable_blocks(page) if block.mark == "not run"]
    assert all(len(block.note) > 10 for block in left_out)
    assert len(left_out) == NOT_RUN, "\n".join(f"{block.place}: {block.note}" for block in left_out)
