"""Write what the pages say of commands, options and keys anew, from the parsers and the schema themselves.

Run it from the project's folder after a change of either::

    python docs/write_references.py
"""

from pathlib import Path

from command_page import command_page
from key_tables import key_meanings, with_key_tables

__all__ = ["key_meanings", "references"]

DOCS = Path(__file__).parent


def references() -> dict[Path, str]:
    """Every page that is made, or in which tables are, with its text."""
    page = DOCS / "problem-file.md"
    return {DOCS / "commands.md": command_page(), page: with_key_tables(page.read_text())}


if __name__ == "__main__":
    for page, text in references().items():
        page.write_text(text)
