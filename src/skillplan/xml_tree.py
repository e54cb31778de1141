"""XML as a tree with line numbers: no document types, no entities, limited size.

expat would expand the entities that a file declares, so such files are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

MAX_ELEMENTS = 20_000
MAX_DEPTH = 64


class XmlError(Exception):
    """A fault of a file, as a sentence, with its line if known."""

    def __init__(self, message: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Element:
    """An element of XML.

    Parameters
    ----------
    tag
        Tag as in the file.
    line
        Line of its start, from 1.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """Yield the children with a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """Return the first child with a tag, or None."""
        return next(self.all(tag), None)


def parse_xml(content: bytes, remedy: str = "keep the arm alone") -> Element:
    """Return the root element of a file.

    Parameters
    ----------
    remedy
        Advice for files that are too large.

    Raises
    ------
    XmlError
        If it is not XML, declares a document type, or exceeds `MAX_ELEMENTS` or `MAX_DEPTH`.
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
            # expat reads few encodings itself and uses Python's for others.
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
