"""Notebooks among the pages: their cells run in one namespace, and become text for Sphinx.

A notebook is written by hand but for its outputs; these are filled in by::

    python docs/notebook_pages.py docs/tutorial.ipynb
"""

import ast
import base64
import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

Notebook = dict[str, Any]
"""What a notebook's file holds, https://nbformat.readthedocs.io."""
RESOLUTION = 80
"""Of figures in outputs [dots per inch]: legible at the width of a page, and small enough to be kept."""


def read(file: Path) -> Notebook:
    """A notebook's data."""
    notebook: Notebook = json.loads(file.read_text())
    return notebook


def source(cell: dict[str, Any]) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def run(notebook: Notebook) -> dict[str, Any]:
    """Run all cells of code in their order, and keep what they print and end with as their outputs.

    Args:
        notebook: receives the outputs.

    Returns:
        The namespace in which they ran.
    """
    namespace: dict[str, Any] = {"__name__": "__main__"}
    codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(codes, start=1):
        printed = io.StringIO()
        with redirect_stdout(printed):
            value = _run_cell(source(cell), f"cell {number}", namespace)
        cell["execution_count"] = number
        cell["outputs"] = [*_stream(printed.getvalue()), *_result(value, number)]
    return namespace


def _run_cell(code: str, name: str, namespace: dict[str, Any]) -> object:
    """Run a cell; what its last line says, where that is an expression without a semicolon, is its value."""
    tree = ast.parse(code, name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), namespace)  # noqa: S102 - running the notebook is what this is for
    if not isinstance(last, ast.Expr):
        return None
    value = eval(compile(ast.Expression(last.value), name, "eval"), namespace)  # noqa: S307
    return None if code.rstrip().endswith(";") else value


def _stream(text: str) -> list[dict[str, Any]]:
    return [{"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)}] if text else []


def _result(value: object, number: int) -> list[dict[str, Any]]:
    """A cell's value as text, and as a picture or a table where it is one."""
    if value is None:
        return []
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "savefig"):
        picture = io.BytesIO()
        value.savefig(picture, dpi=RESOLUTION)
        data["image/png"] = base64.b64encode(picture.getvalue()).decode()
    elif hasattr(value, "_repr_html_"):
        data["text/html"] = value._repr_html_().splitlines(keepends=True)
    return [{"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}]


def as_page(notebook: Notebook) -> str:
    """A notebook as a page in Markdown: text, blocks of code, and below each what it printed, drew or gave."""
    parts = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            parts.append(source(cell))
            continue
        parts.append(f"```python\n{source(cell)}\n```")
        parts += [_output(output) for output in cell["outputs"]]
    return "\n\n".join(parts) + "\n"


def _output(output: dict[str, Any]) -> str:
    if output["output_type"] == "stream":
        return f"```text\n{''.join(output['text']).rstrip()}\n```"
    data = output["data"]
    if "image/png" in data:
        return f"![](data:image/png;base64,{data['image/png']})"
    if "text/html" in data:
        return f"```{{raw}} html\n{''.join(data['text/html'])}\n```"
    return f"```text\n{''.join(data['text/plain'])}\n```"


def main() -> None:
    """Fill in the outputs of notebooks."""
    for name in sys.argv[1:]:
        file = Path(name)
        notebook = read(file)
        run(notebook)
        file.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
