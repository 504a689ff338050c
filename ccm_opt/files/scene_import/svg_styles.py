"""What of the styles of an SVG drawing decides whether and how a shape is filled: style sheets, classes, attributes.

Of style sheets, rules are understood whose selectors name an element, classes and an id of one element; a shape that
another rule would hide is taken, since an obstacle too many is better than one too few.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.import_settings import ImportSettings
from ccm_opt.files.scene_import.svg_document import Node

PROPERTIES = frozenset(("clip-path", "display", "fill", "fill-rule", "mask", "transform", "visibility"))
"""Those that matter; of fills only whether there is one, and strokes do not."""
_SIMPLE = re.compile(r"(?P<tag>\*|[\w-]+)?(?P<parts>(?:[.#][\w-]+)*)")
_PART = re.compile(r"[.#][\w-]+")


@dataclass(frozen=True)
class _Rule:
    """One selector with what it says: ``tag`` may be empty, ``classes`` and ``ids`` must all be there."""

    tag: str
    parts: frozenset[str]
    style: dict[str, str]

    @property
    def weight(self) -> tuple[int, int, int]:
        """The specificity of CSS: ids before classes before elements."""
        ids = sum(part.startswith("#") for part in self.parts)
        return ids, len(self.parts) - ids, bool(self.tag)


@dataclass
class StyleSheet:
    """The rules of a drawing that matter.

    Attributes:
        rules: in the order of their weight.
        unread: selectors that could not be read and would hide shapes.
    """

    rules: list[_Rule] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)

    def style_of(self, node: Node, settings: ImportSettings) -> dict[str, str]:
        """The properties of one element, those of its parents left out.

        Raises:
            ProblemError: an attribute is longer than anything that a program writes.
        """
        for key in ("style", "class", "transform"):
            if len(node.attributes.get(key, "")) > settings.longest_attribute:
                raise ProblemError(
                    f"the attribute {key} of an element {node.tag} has {len(node.attributes[key])} characters, at most "
                    f"{settings.longest_attribute} can be read"
                )
        found = {key: node.attributes[key].strip() for key in PROPERTIES if key in node.attributes}
        if self.rules:
            marks = {f".{name}" for name in node.attributes.get("class", "").split()}
            marks.add(f"#{node.attributes.get('id', '')}")
            for rule in self.rules:
                if rule.tag in {"", node.tag} and rule.parts <= marks:
                    found |= rule.style
        return found | _declarations(node.attributes.get("style", ""))


def style_sheet(root: Node, settings: ImportSettings) -> StyleSheet:
    """The style sheet of a drawing.

    Raises:
        ProblemError: it has more rules that matter than can be applied to every element.
    """
    sheet = StyleSheet()
    pending = [root]
    while pending:
        node = pending.pop()
        pending.extend(reversed(node.children))
        if node.tag == "style":
            for rule in _rules(node.text, sheet.unread):
                sheet.rules.append(rule)
            if len(sheet.rules) > settings.most_style_rules:
                raise ProblemError(
                    f"more than {settings.most_style_rules} style rules hide shapes or say how they are filled; save "
                    "it as plain SVG"
                )
    sheet.rules.sort(key=lambda rule: rule.weight)  # stable: of equal weight the later counts
    return sheet


def _rules(text: str, unread: list[str]) -> Iterator[_Rule]:
    """The rules of a sheet that matter; blocks that hold for some media only are skipped."""
    for block in _without_comments(text).split("}"):
        selectors, _, body = block.rpartition("{")
        style = _declarations(body)
        if style.get("fill") not in {None, "none"}:  # what most rules say, and what a shape has by itself
            del style["fill"]
        if not style:
            continue
        for selector in selectors.rpartition("{")[2].split(","):
            match = _SIMPLE.fullmatch(selector.strip())
            if match is None or "@" in selectors:
                if "display" in style or "visibility" in style:
                    unread.append(selector.strip()[:60])
                continue
            tag = match["tag"] or ""
            yield _Rule("" if tag == "*" else tag, frozenset(_PART.findall(match["parts"])), style)


def _without_comments(text: str) -> str:
    # Split at ends of comments: what stands in a piece before the next beginning is no comment.
    return "".join(piece.partition("/*")[0] for piece in text.split("*/"))


def _declarations(text: str) -> dict[str, str]:
    """The properties that matter among ``name: value; …``."""
    found = {}
    for declaration in text.split(";"):
        name, _, value = declaration.partition(":")
        if (key := name.strip().lower()) in PROPERTIES:
            found[key] = value.replace("!important", "").strip()
    return found
