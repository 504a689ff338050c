"""The pages name files, functions and packages that exist, and keep one form."""

import csv
import re
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *ROOT.glob("*.md")])
USERS_OWN = {"mine.py", "my-scene.toml", "room.toml", "problem.toml", "runs/swan-neck/", "DIR/", "DIR/<name>/"}
"""Names in examples that stand for files of the user."""
WIDTH = 120


def page_id(page: Path) -> str:
    """Path of a page within the project."""
    return str(page.relative_to(ROOT))


def prose(page: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines of a page outside its blocks of code."""
    inside = False
    for number, line in enumerate(page.read_text().splitlines(), start=1):
        if line.lstrip().startswith("```"):
            inside = not inside
        elif not inside:
            yield number, line


def names_in_code(page: Path) -> Iterator[str]:
    """What stands between backticks in the prose of a page."""
    for _, line in prose(page):
        yield from re.findall(r"`([^`]+)`", line)


@pytest.fixture(scope="module")
def known_paths() -> set[str]:
    """Every file and folder of the project, each with all ends of its path."""
    folders = [ROOT / name for name in ("ccm_opt", "docs", "examples", "problems", "tests")]
    entries = [entry for folder in folders for entry in (folder, *folder.rglob("*"))] + list(ROOT.glob("*.*"))
    ends = set()
    for entry in entries:
        parts = entry.relative_to(ROOT).parts
        ends.update("/".join(parts[k:]) for k in range(len(parts)))
    return ends


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_named_files_exist(page: Path, known_paths: set[str]) -> None:
    """Every path to a file or folder that a page names in code exists."""
    paths = {name for name in names_in_code(page) if re.fullmatch(r"[\w./<>-]+(\.(py|c|toml)|/)", name)}
    missing = {path for path in paths - USERS_OWN if path.strip("./").rstrip("/") not in known_paths}
    assert not missing


def test_named_functions_exist() -> None:
    """Every dotted name that begins in ``ccm_opt`` exists."""
    names = {name for page in PAGES for name in names_in_code(page) if re.fullmatch(r"ccm_opt(\.\w+)+", name)}
    assert not {name for name in names if not resolves(name)}


def test_python_interface_describes_everything_once() -> None:
    """What the page of the Python interface describes exists, and is described once."""
    named = re.findall(r"^\.\. auto\w+:: (\S+)", (DOCS / "api.md").read_text(), re.MULTILINE)
    assert len(named) > 40
    assert sorted(set(named)) == sorted(named)
    assert not {name for name in named if not resolves(name)}


def test_named_members_exist() -> None:
    """Every ``Class.member`` that a page names is a class of the package with such a field, property or method."""
    source = "\n".join(file.read_text() for file in (ROOT / "ccm_opt").rglob("*.py"))
    bodies = dict(re.findall(r"^class (\w+)\b.*:\n((?:(?: .*)?\n)+)", source, re.MULTILINE))
    names = {name for page in PAGES for name in names_in_code(page) if re.fullmatch(r"[A-Z][a-z]\w+\.[a-z]\w+", name)}
    assert len(names) > 15
    assert not {
        name
        for name, (owner, member) in ((name, name.split(".")) for name in names)
        if not re.search(rf"^    (?:def {member}\(|{member}\b.*[:=])", bodies.get(owner, ""), re.MULTILINE)
    }


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for attribute in parts[k:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if not hasattr(found, attribute) and attribute not in fields:
                return False
            found = getattr(found, attribute, None)
        return True
    return False


def test_architecture_shows_every_floor() -> None:
    """Every package that the contracts put on a floor stands in the architecture's table of floors."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(contract for contract in contracts if contract["name"].startswith("Packages"))["layers"]
    packages = {name.strip().removeprefix("ccm_opt.") for layer in layers for name in layer.split("|")}
    named = set(names_in_code(DOCS / "architecture.md"))
    assert packages <= named


@pytest.mark.parametrize("file", sorted((DOCS / "benchmarks").glob("*.csv")), ids=lambda file: file.name)
def test_raw_results_are_tables_that_a_page_links(file: Path) -> None:
    """Every file of raw results has rows as long as its header, and the page of benchmarks links it."""
    header, *rows = list(csv.reader(file.read_text().splitlines()))
    assert rows
    assert all(len(row) == len(header) for row in rows)
    assert f"(benchmarks/{file.name})" in (DOCS / "benchmarks.md").read_text()


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_pages_keep_one_form(page: Path) -> None:
    """Lines of prose fit into one width, and decimals have a leading zero."""
    lines = [(number, line) for number, line in prose(page) if not re.match(r"\s*(\||!\[|\$\$|#|<!--)|.* => ", line)]
    assert not [number for number, line in lines if len(line) > WIDTH]
    assert not [number for number, line in prose(page) if re.search(r"(?<![\w.\])])\.\d", line)]
