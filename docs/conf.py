import inspect
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import MISSING, fields
from importlib import import_module
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from latex2mathml.converter import convert
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.writers.html5 import HTML5Translator

import ccm_opt
from ccm_opt import __version__

sys.path.insert(0, str(Path(__file__).parent))
from notebook_pages import Notebook, as_page

project = "ccm_opt"
author = "The ccm_opt developers"
copyright = "the ccm_opt developers"  # noqa: A001 - Sphinx reads this name
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "adr/template.md"]
html_theme = "furo"
html_title = f"ccm_opt {__version__}"
html_static_path = ["_static"]
html_css_files = ["front.css"]
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1d56b3", "color-brand-content": "#1d56b3"},
    "dark_css_variables": {"color-brand-primary": "#6ea8fe", "color-brand-content": "#6ea8fe"},
}

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"  # browsers draw it themselves, so that pages are whole without a network

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True  # as they are written: the value of a settings object fills pages
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = True
napoleon_numpy_docstring = False

nitpicky = True
nitpick_ignore_regex = [
    # Types of other packages; links to them would need the network at build time.
    ("py:class", r"(numpy|np|npt|scipy|shapely|matplotlib|pathlib|collections|typing)\b.*"),
    ("py:class", r"(Path|Mapping|Sequence|Callable|BSpline|ndarray|dtype|float64|Any|Number|Figure)"),
    # Classes that no page documents.
    ("py:class", r"ccm_opt\.baseline\.distance\.Precision"),
    ("py:class", r"ccm_opt\.scene\.(walls\.Walls|shells\.Shells)"),
    ("py:class", r"ccm_opt\.viz\.(scene_views\.SceneViews|arm_drawing\.Side)"),
    ("py:class", r"ccm_opt\.scene\.workspace\.Shape"),
    ("py:class", r"ccm_opt\.scene\.distances\.surface_tree\.SurfaceTree"),
    ("py:class", r"ccm_opt\.io\.reading_back\.SavedMotion"),
    ("py:class", r"ccm_opt\.robot\.configuration\.(Curve|SpaceSegment)"),
    ("py:class", r"Solution"),
    # Python's own.
    ("py:class", r"dataclasses\.InitVar"),
    ("py:(class|exc)", r"(Exception|str|int|float|bool|None|object|tuple|dict|optional)"),
]


class SettingsClasses(SphinxDirective):
    """Every class of settings with a table of its fields, so that the page of settings is complete."""

    def run(self) -> list[nodes.Node]:
        """Expand to the description of one class after the other."""
        root = Path(__file__).parent.parent
        lines = [
            line
            for file in sorted((root / "ccm_opt").rglob("*.py"))
            for name in re.findall(r"^class (\w*Settings)\b", file.read_text(), re.MULTILINE)
            for line in class_lines(".".join(file.relative_to(root).with_suffix("").parts), name)
        ]
        container = nodes.container()
        self.state.nested_parse(StringList(lines, __file__), self.content_offset, container)
        return container.children


def class_lines(module: str, name: str) -> Iterator[str]:
    """Lines in reStructuredText that describe a class of settings, with the defaults of its fields."""
    described = getattr(import_module(module), name)
    summary, _, attributes = inspect.getdoc(described).partition("\nAttributes:\n")
    meanings = dict(re.findall(r"^    (\w+): ((?:.+\n?)(?:     .*\n?)*)", attributes, re.MULTILINE))
    yield from (
        f".. py:class:: {described.__module__}.{name}",
        "",
        *(f"   {line}" for line in summary.splitlines()),
        "",
    )
    yield from ("   .. list-table::", "      :header-rows: 1", "      :widths: 20 20 60", "")
    yield from ("      * - field", "        - default", "        - meaning")
    for field in fields(described):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        kind = type(default)
        nested = f":py:class:`~{kind.__module__}.{kind.__name__}`" if kind.__name__.endswith("Settings") else ""
        value = "" if default is MISSING else f"``{default!r}``"
        yield from (f"      * - ``{field.name}``", f"        - {nested or value}".rstrip())
        yield f"        - {' '.join(meanings.get(field.name, '').split())}"
    yield ""


class NotebookParser(MystParser):
    """Reads notebooks as the pages in Markdown that they say."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse the text of a notebook's file."""
        notebook: Notebook = json.loads(inputstring)
        super().parse(as_page(notebook), document)


def draw_math(translator: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula as MathML, in its line or in one of its own."""
    display = "inline" if isinstance(node, nodes.math) else "block"
    formula = convert(node.astext(), display=display)
    # Functions stand apart from what they are of, and primes are raised by their fonts already.
    formula = re.sub(r"<mi>(cos|sin)</mi>", r'<mo lspace="0.17em" rspace="0.17em">\1</mo>', formula)
    formula = re.sub(
        r"<msup>(<mi>[^<]*</mi>)<mi>&#x02032;</mi></msup>", r'\1<mo lspace="0" rspace="0">&#x02032;</mo>', formula
    )
    translator.body.append(formula)
    raise nodes.SkipNode


def use_public_names() -> None:
    """Describe what the package exports under the names by which users import it."""
    for name in ccm_opt.__all__:
        exported = getattr(ccm_opt, name)
        if inspect.isclass(exported) or inspect.isfunction(exported):
            exported.__module__ = "ccm_opt"


def setup(app: Sphinx) -> None:
    """Make the directive and the reader of notebooks known."""
    use_public_names()
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    app.add_html_math_renderer("mathml", (draw_math, None), (draw_math, None))
    app.add_directive("settings-classes", SettingsClasses)
