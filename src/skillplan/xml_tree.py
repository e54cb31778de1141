"""XML as a tree that knows its lines: no document types, no entities, limits on size.

expat alone would expand entities that a file declares; a file that declares any is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

MAX_ELEMENTS = 20_000
MAX_DEPTH = 64


class XmlError(Exception):
    """What is wrong with a file, in a sentence; and the line, where there is one."""

    def __init__(self, message: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Element:
    """An element of XML.

    Parameters
    ----------
    tag
        Its name, as it is written.
    attributes
        By name.
    line
        Where it begins, counted from 1.
    children
        In their order.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """Yield the children of a name."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """Return the first child of a name, or None."""
        return next(self.all(tag), None)


def parse_xml(content: bytes, remedy: str = "keep the arm alone") -> Element:
    """Return the root of a file.

    Parameters
    ----------
    content
        Of the file.
    remedy
        What to do where it is too large.

    Raises
    ------
    XmlError
        If it is not XML, declares a document type, or has more elements, or more within each other,
        than `MAX_ELEMENTS` and `MAX_DEPTH`.
    """
    return _Builder(remedy).parse(content)


class _Builder:
    def __init__(self, remedy: str) -> None:
        self.remedy = remedy
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.unclosed: list[Element] = []
        self.root: Element | None = None
        self.count = 0

    def parse(self, content: bytes) -> Element:
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            words = expat.ErrorString(error.code)
            raise XmlError(f"it is not XML ({words}); save it again", error.lineno) from None
        except (ValueError, LookupError):
            # expat reads few encodings itself and asks Python for others.
            raise XmlError("its encoding is not known; save it as UTF-8", 1) from None
        assert self.root is not None
        return self.root

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise XmlError(f"it has more than {MAX_ELEMENTS:,} elements; {self.remedy}", line)
        if len(self.unclosed) >= MAX_DEPTH:
            raise XmlError(f"its elements lie more than {MAX_DEPTH} deep; {self.remedy}", line)
        element = Element(tag, attributes, line)
        if self.unclosed:
            self.unclosed[-1].children.append(element)
        else:
            self.root = element
        self.unclosed.append(element)

    def _end(self, tag: str) -> None:
        self.unclosed.pop()

    def _doctype(self, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise XmlError("it declares a document type, which is not read; take it out", line)
