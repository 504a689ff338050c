"""Parsing of XML files within limits on their size, so that a small file cannot expand to a huge tree."""

from xml.etree import ElementTree as ET
from xml.parsers import expat  # bounds how entities multiply, and loads no external ones

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import IMPORT

FOREIGN = ""
"""Tag given to elements outside the known namespaces, in which programs store their own data."""
_SEPARATOR = " "
"""Separator that the parser puts between namespace and name; a namespace contains no blank."""


def parsed_xml(content: bytes, known: str = "") -> tuple[ET.Element, str]:
    """Return the outermost element of an XML file and its namespace, with namespaces removed from all tags.

    Args:
        content: content of the file.
        known: namespace whose elements keep their tags, besides that of the outermost element; others become
            ``FOREIGN``.

    Raises:
        ProblemError: the content is not XML, or exceeds a limit of ``ImportBounds``.
    """
    builder = _Builder(content.count(b"&"), known)
    parser = expat.ParserCreate(namespace_separator=_SEPARATOR)
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.tree.data
    parser.EntityDeclHandler = builder.entity
    try:
        parser.Parse(content, True)  # noqa: FBT003 - the parser takes no keyword
        root = builder.tree.close()
    except (expat.ExpatError, ValueError, LookupError) as error:  # encodings that nobody knows too
        raise ProblemError(f"not readable as XML: {error}") from None
    return root, builder.namespace


class _Builder:
    """Parser target that builds the element tree of an XML file and enforces limits on its size.

    Args:
        references: upper bound on the number of entity references in the text.
        known: namespace whose elements keep their tags, besides that of the outermost element.
    """

    def __init__(self, references: int, known: str) -> None:
        self.known = known
        self.tree = ET.TreeBuilder()
        self.namespace = ""
        self.count = self.depth = self.entity_length = 0
        self.references = references

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Open an element as a child of the element that is currently open.

        Raises:
            ProblemError: the document has too many elements, or they are nested too deep.
        """
        namespace, _, tag = name.rpartition(_SEPARATOR)
        self.namespace = self.namespace if self.count else namespace
        self.count += 1
        self.depth += 1
        if self.count > IMPORT.most_nodes:
            raise ProblemError(f"it has more than {IMPORT.most_nodes} elements; simplify it")
        if self.depth > IMPORT.deepest:
            raise ProblemError(f"its elements are nested more than {IMPORT.deepest} deep")
        self.tree.start(tag if namespace in {self.namespace, self.known} else FOREIGN, attributes)

    def end(self, name: str) -> None:
        """Close the element that is currently open."""
        self.depth -= 1
        self.tree.end(name)

    def entity(self, _name: str, _parameter: bool, value: str | None, *_others: object) -> None:
        """Refuse a declared entity that could expand a small file too much: a nested one, or a long one used often.

        Raises:
            ProblemError: the entity is refused.
        """
        self.entity_length += len(value or "")
        if "&" in (value or "") or self.references * self.entity_length > IMPORT.most_bytes:
            raise ProblemError("its entities expand to too much text; save it without")
