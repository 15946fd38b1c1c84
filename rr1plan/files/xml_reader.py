"""A small, strict XML reader whose elements record their line.

Built on expat, so that every message can contain file:line. Document type declarations, and with them entities, are
rejected: there are no expansion bombs, and no other files are read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from rr1plan.checks import file_path, number_in
from rr1plan.errors import FormatError
from rr1plan.files.file_access import read_bytes

MAX_BYTES = 64 * 1024 * 1024
MAX_DEPTH = 100


@dataclass(eq=False)
class Element:
    """An XML element: its tag, attributes, children and position."""

    tag: str
    attributes: dict[str, str]
    line: int
    file: str | None
    children: list[Element] = field(default_factory=list)

    def error(self, message: str) -> FormatError:
        """A `FormatError` at this element's position, to be raised by the caller."""
        return FormatError(message, self.file, self.line)

    @property
    def at(self) -> tuple[str, int]:
        """Its file and line, for messages in the log."""
        return self.file or "the document", self.line

    def all(self, tag: str) -> Iterator[Element]:
        """The children with a tag, in order."""
        return (child for child in self.children if child.tag == tag)

    def child(self, tag: str) -> Element | None:
        """The one child with a tag, or None.

        Raises:
            FormatError: there are several.
        """
        found = list(self.all(tag))
        if len(found) > 1:
            raise found[1].error(f"<{self.tag}> has {len(found)} <{tag}> elements, expected at most one")
        return found[0] if found else None

    def required(self, tag: str) -> Element:
        """The one child with a tag.

        Raises:
            FormatError: there is none, or there are several.
        """
        child = self.child(tag)
        if child is None:
            raise self.error(f"<{self.tag}>{self._called()} has no <{tag}>")
        return child

    def text(self, name: str) -> str:
        """An attribute that must be present and not empty.

        Raises:
            FormatError: it is missing or empty.
        """
        value = self.attributes.get(name, "").strip()
        if not value:
            raise self.error(f"<{self.tag}>{self._called()} has no attribute {name!r}")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number in an attribute; `default` if the attribute is missing.

        Raises:
            FormatError: missing without a default, not a number, NaN or infinite.
        """
        if default is not None and name not in self.attributes:
            return default
        return self._finite(name, self.text(name))

    def positive(self, name: str) -> float:
        """A finite positive number in an attribute.

        Raises:
            FormatError: missing, not a number, NaN, infinite, zero or negative.
        """
        value = self.number(name)
        if value <= 0.0:
            raise self.error(f"<{self.tag}> {name}={self.attributes[name]!r}, expected a number above zero")
        return value

    def vector(self, name: str, size: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """`size` finite numbers in an attribute; `default` if the attribute is missing.

        Raises:
            FormatError: missing without a default, another count, or a number that is not finite.
        """
        if default is not None and name not in self.attributes:
            return default
        words = self.text(name).split()
        if len(words) != size:
            raise self.error(f"<{self.tag}> {name}={self.attributes[name]!r}, expected {size} numbers")
        return tuple(self._finite(name, word) for word in words)

    def _finite(self, name: str, word: str) -> float:
        try:
            value = number_in(word)
        except ValueError:
            raise self.error(f"<{self.tag}> {name}={word!r} is not a number") from None
        if not math.isfinite(value):
            raise self.error(f"<{self.tag}> {name}={word!r}, expected a finite number")
        return value

    def _called(self) -> str:
        name = self.attributes.get("name")
        return "" if name is None else f" {name!r}"


class _Builder:
    """Expat's callbacks: grows the tree."""

    def __init__(self, parser: expat.XMLParserType, file: str | None) -> None:
        self.parser = parser
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.parser.CurrentLineNumber, self.file)
        if len(self.open) >= MAX_DEPTH:
            raise element.error(f"elements are nested deeper than {MAX_DEPTH}")
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end(self, _tag: str) -> None:
        self.open.pop()


def parse_xml(data: bytes, root: str | None, file: str | Path | None = None) -> Element:
    """Parse a document.

    Args:
        data: The document's bytes.
        root: The required tag of its outermost element; None for any.
        file: Its origin, for messages.

    Raises:
        FormatError: too long, not well-formed, another root, a DOCTYPE, or nested too deep.
    """
    name = None if file is None else str(file)
    if len(data) > MAX_BYTES:
        raise FormatError(f"is {len(data)} bytes long, expected at most {MAX_BYTES}", name)
    parser = expat.ParserCreate()
    builder = _Builder(parser, name)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    _run(parser, data, name)
    assert builder.root is not None  # expat refuses a document without elements
    if root is not None and builder.root.tag != root:
        raise builder.root.error(f"the outermost element is <{builder.root.tag}>, expected <{root}>")
    return builder.root


def _run(parser: expat.XMLParserType, data: bytes, file: str | Path | None) -> None:
    """Parse all of it; a document type or an entity stops the parser."""

    def refuse_doctype(*_arguments: object) -> None:
        message = "has a DOCTYPE; document types and entities are refused, try removing it"
        raise FormatError(message, file, parser.CurrentLineNumber)

    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.EntityDeclHandler = refuse_doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise FormatError(f"is not well-formed XML: {what}", file, error.lineno) from error
    except FormatError:
        raise
    except (LookupError, ValueError) as error:
        raise FormatError(f"has an encoding that cannot be read: {error}", file) from error


def root_tag(data: bytes, file: str | Path | None = None) -> str:
    """The tag of the outermost element; "" if the document ends before one.

    Raises:
        FormatError: not well-formed up to that element, or a DOCTYPE.
    """
    found: list[str] = []
    parser = expat.ParserCreate()

    def look(name: str, _attributes: dict[str, str]) -> None:
        found.append(name)
        parser.StartElementHandler = None

    parser.StartElementHandler = look
    try:
        _run(parser, data, file)
    except FormatError:
        if not found:
            raise
    return found[0] if found else ""


def first_attributes(data: bytes, tag: str, file: str | Path | None = None) -> dict[str, str]:
    """The attributes of the first element with a tag, ignoring namespaces; empty if there is none.

    For documents that another library reads less strictly.

    Raises:
        FormatError: not well-formed, or a DOCTYPE.
    """
    found: list[dict[str, str]] = []

    def look(name: str, attributes: dict[str, str]) -> None:
        if not found and name.rpartition(":")[2] == tag:
            found.append(attributes)

    parser = expat.ParserCreate()
    parser.StartElementHandler = look
    _run(parser, data, file)
    return found[0] if found else {}


def first_text(data: bytes, tag: str, file: str | Path | None = None) -> str:
    """The text of the first element with a tag, up to its first child, without white space around it; "" without one.

    Raises:
        FormatError: not well-formed, or a DOCTYPE.
    """
    texts: list[str] = []
    is_open = False

    def start(name: str, _attributes: dict[str, str]) -> None:
        nonlocal is_open
        is_open = name == tag and not texts
        texts.extend([""] * is_open)

    def end(_name: str) -> None:
        nonlocal is_open
        is_open = False

    def read(content: str) -> None:
        if is_open:
            texts[0] += content

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, read
    _run(parser, data, file)
    return "".join(texts).strip()


def parse_document(source: str | bytes | Path, root: str, file: str | Path | None = None) -> Element:
    """Parse a file or a document, whose outermost element has the tag `root`.

    Args:
        source: A file's path, or the document itself: bytes, or text starting with "<".
        root: The tag.
        file: Origin of a document given as text, for messages.

    Raises:
        FormatError: the file cannot be read, or as `parse_xml`.
    """
    if isinstance(source, bytes) or (isinstance(source, str) and source.lstrip().startswith("<")):
        return parse_xml(source.encode() if isinstance(source, str) else source, root, file)
    path = file_path(source)
    return parse_xml(read_bytes(path, MAX_BYTES), root, path)
