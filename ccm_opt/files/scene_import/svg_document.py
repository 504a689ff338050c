"""Parses SVG text into a tree of plain nodes, whose depth and number are bounded while they are read."""

from dataclasses import dataclass, field
from xml.parsers import expat  # bounds how entities multiply, and loads no external ones

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.import_settings import ImportSettings

NAMESPACE = "http://www.w3.org/2000/svg"
FOREIGN = ""
"""Tag of elements that are not in the namespace of SVG: what editors keep for themselves."""
_SEPARATOR = " "
"""Between namespace and name, as the parser reports them; a blank is in no namespace."""


@dataclass
class Node:
    """An element of a document.

    Attributes:
        tag: name without namespace; ``FOREIGN`` for elements of other namespaces.
        attributes: by name; those of other namespaces have it in front, with a blank between.
        children: elements in it, in order.
        text: characters directly in it, kept for titles and style sheets alone.
    """

    tag: str
    attributes: dict[str, str]
    children: list["Node"] = field(default_factory=list)
    text: str = ""


def parsed_document(content: bytes, settings: ImportSettings) -> Node:
    """The outermost element of an SVG file.

    Args:
        content: of the file.
        settings: bounds.

    Raises:
        ProblemError: the content is no XML, no SVG, or exceeds a bound.
    """
    builder = _Builder(settings)
    parser = expat.ParserCreate(namespace_separator=_SEPARATOR)
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.text
    parser.EntityDeclHandler = builder.entity
    builder.references = content.count(b"&")
    try:
        parser.Parse(content, True)  # noqa: FBT003 - the parser takes no keyword
    except (expat.ExpatError, ValueError, LookupError) as error:  # encodings that nobody knows too
        raise ProblemError(f"not readable as XML: {error}") from None
    root = builder.root
    if root is None or root.tag != "svg":
        raise ProblemError(f"expected the outermost element svg, got {'nothing' if root is None else root.tag}")
    if builder.namespace not in {NAMESPACE, ""}:
        raise ProblemError(
            f"the outermost element is in the namespace '{builder.namespace[:80]}'; expected '{NAMESPACE}', without "
            "which no program shows the drawing"
        )
    return root


class _Builder:
    """Receives what the parser finds; ``root`` is the tree in the end."""

    def __init__(self, settings: ImportSettings) -> None:
        self.settings = settings
        self.root: Node | None = None
        self.namespace = ""
        self.open: list[Node] = []
        self.count = 0
        self.references = 0
        self.entity_length = 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Add an element to the one that is open."""
        self.count += 1
        if self.count > self.settings.most_nodes:
            raise ProblemError(f"it holds more than {self.settings.most_nodes} elements; simplify the drawing")
        if len(self.open) >= self.settings.deepest:
            raise ProblemError(f"its elements are nested more than {self.settings.deepest} deep; ungroup some")
        namespace, _, tag = name.rpartition(_SEPARATOR)
        if self.root is None:
            self.namespace = namespace
        node = Node(tag if namespace in {self.namespace, NAMESPACE} else FOREIGN, attributes)
        if self.open:
            self.open[-1].children.append(node)
        else:
            self.root = node
        self.open.append(node)

    def end(self, _name: str) -> None:
        """Close the element that is open."""
        self.open.pop()

    def text(self, text: str) -> None:
        """Keep the characters that count."""
        node = self.open[-1]
        if node.tag in {"title", "style"} and len(node.text) <= self.settings.longest_text:
            node.text += text

    def entity(self, _name: str, _parameter: bool, value: str | None, *_others: object) -> None:
        """Refuse abbreviations that make a small file large: such as hold others, or are long and often used."""
        if value is None:
            return
        self.entity_length += len(value)
        if "&" in value or self.references * self.entity_length > self.settings.most_bytes:
            raise ProblemError("its entities would make it too large to read; save it as plain SVG")
