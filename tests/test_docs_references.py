"""The pages that are made from the parsers of commands and from the schema of problem files are in step with them."""

import inspect
import sys
from pathlib import Path
from types import ModuleType

import pytest
from pydantic import BaseModel

from ccm_opt.cli.commands import app
from ccm_opt.io import arm_tables, goal_tables, option_tables, scene_tables, schema, tool_tables
from ccm_opt.io.quantities import Table

DOCS = Path(__file__).parent.parent / "docs"
PAGE = (DOCS / "problem-file.md").read_text()
CLASSES = {
    name: table
    for module in (arm_tables, goal_tables, option_tables, scene_tables, tool_tables, schema)
    for name, table in inspect.getmembers(module, inspect.isclass)
}
TABLES = [table for table in CLASSES.values() if issubclass(table, Table)]
WRITTEN_OUT = {
    *("CircleTable", "WallTable", "InertiaTable", "GainsTable", "PoseTable", "Table"),
    *("ArmTable", "PlaneBarTable", "ChainTable", "SphereTable", "BarTable", "BaseTable", "SpacePoseTable"),
    *("_RigidTable", "PlaneRigidTable", "SpaceRigidTable"),
}
"""Tables whose keys stand in the row of the key that holds them, and those that others are made from."""


@pytest.fixture(scope="module")
def writer() -> ModuleType:
    """The script that writes the pages."""
    sys.path.insert(0, str(DOCS))
    try:
        import write_references
    finally:
        sys.path.remove(str(DOCS))
    return write_references


def test_pages_are_in_step(writer: ModuleType) -> None:
    """To write the pages anew changes nothing; if this fails, run ``python docs/write_references.py``."""
    for page, text in writer.references().items():
        assert page.read_text() == text, page.name


def test_every_table_of_the_schema_is_shown() -> None:
    """Every table of the schema has its keys on the page of problem files."""
    shown = {mark for mark in WRITTEN_OUT | {table.__name__ for table in TABLES} if f"<!-- keys: {mark}" in PAGE}
    assert shown == {table.__name__ for table in TABLES} - WRITTEN_OUT


@pytest.mark.parametrize("table", [table for table in TABLES if table is not Table], ids=lambda table: table.__name__)
def test_every_key_has_a_meaning(table: type[BaseModel], writer: ModuleType) -> None:
    """Below every key of the schema stands what it means."""
    meanings = writer.key_meanings(table)
    assert set(meanings) == set(table.model_fields)
    assert all(meaning.endswith((".", ".)")) for meaning in meanings.values())


def test_every_command_has_its_section() -> None:
    """The page of commands has a section for each command, with every option that its help knows."""
    page = (DOCS / "commands.md").read_text()
    assert [f"## `{command.name}`" for command in app.registered_commands] == [
        line for line in page.splitlines() if line.startswith("## `")
    ]
    for option in ("--set", "--time-limit", "--quiet", "--workers", "--format", "--angle-noise-deg"):
        assert f"`{option}`" in page
