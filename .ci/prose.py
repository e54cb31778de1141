"""Count phrases that make our texts hard to read; fail if one is more frequent than its limit.

The texts are docstrings, comments, help texts and messages of the product, and the pages of
``docs``. A limit is a number per 10,000 words: three times the median of eight libraries (trimesh,
networkx, gymnasium, optuna, unified-planning, rich, pydantic, matplotlib), at least 3. `make check`
runs it; ``--where PHRASE`` lists the places of one phrase.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Phrase(NamedTuple):
    """A pattern with its limit per 10,000 words."""

    limit: float
    pattern: str


PHRASES = {
    "return-what": Phrase(3, r"\bReturns? (?:what|how|where|which|who|of|as|by how|from where)\b"),
    "fragment-what": Phrase(6, r"(?m)^\s*(?:What|Where|How|Whether|Who|Which)\b"),
    "fragment-of": Phrase(
        3, r"(?m)^\s*Of (?:the|an?|its|all|every|each|those|what|this|one|both)\b"
    ),
    "what-is": Phrase(
        3,
        r"\bwhat (?:is|was|are|were|has|it|they|he|an?|the|stands|comes?|came|can|would|must|there"
        r"|of|one|all|others|some)\b",
    ),
    "those-that": Phrase(3, r"\b(?:all|those|ones?|that) that\b|\bthose (?:of|with|who|which)\b"),
    "code-speaks": Phrase(3, r"\b(?:told|tells|says|said|say|asked|asks|ask)\b"),
    "beside": Phrase(3, r"\b(?:besides?|apart)\b"),
    "nobody": Phrase(
        3,
        r"\b(?:(?:no|any|some|every)body|(?:what|which|wher|who)ever)\b"
        r"|\bnothing (?:that|of|but|is|comes|can)\b",
    ),
    "where-for-if": Phrase(
        3,
        r"(?:^|[,;:.] )[Ww]here (?:there|it|they|all|none|no|an?|the|one|several|that|both|time"
        r"|costs|he|this|some|any|each|more)\b",
    ),
    "so-many": Phrase(3, r"\bso (?:many|much|few)\b"),
    "is-no": Phrase(4.8, r"\b(?:is|are|was|were|be) no (?!longer|more|need|such|matter|other)\w+"),
}
VAGUE_NAMES = {"one", "found", "made", "told", "said", "wanted", "least", "begun", "asked"}
VAGUE_NAMES_LIMIT = 10.0  # per 100,000 names in code


class Text(NamedTuple):
    """One text with the file and the line in which it begins."""

    path: Path
    line: int
    text: str


def read_texts(path: Path) -> Iterator[Text]:
    """Yield docstrings, strings of four words or more, and comments; a page of docs as a whole."""
    source = path.read_text("utf-8")
    if path.suffix == ".md":
        yield Text(path, 1, source)
        return
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = set()
    nodes = list(ast.walk(ast.parse(source)))
    for node in nodes:
        if isinstance(node, documented) and (text := ast.get_docstring(node)):
            docstrings.add(node.body[0].value)  # type: ignore[attr-defined]
            yield Text(path, node.body[0].lineno, text)
    for node in nodes:
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and node not in docstrings and len(node.value.split()) > 3:  # type: ignore[attr-defined]
            yield Text(path, node.lineno, node.value)  # type: ignore[attr-defined]
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type == tokenize.COMMENT:
                yield Text(path, token.start[0], token.string.lstrip("# "))


def list_files(*folders: str) -> list[Path]:
    """List the committed Python files and pages below the folders."""
    command = ["git", "ls-files", "--", *folders]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in names.splitlines() if name.endswith((".py", ".md"))]


def count_phrases(texts: list[Text], name: str) -> dict[str, float]:
    """Print the frequency of every phrase; return those above their limits."""
    words = sum(len(re.findall(r"[A-Za-z']+", text.text)) for text in texts)
    excess = {}
    print(f"{name}: {words:,} words; per 10,000 words, with the limit")
    for key, phrase in PHRASES.items():
        count = sum(len(re.findall(phrase.pattern, text.text)) for text in texts)
        frequency = 1e4 * count / words
        if frequency > phrase.limit:
            excess[f"{name}: {key}"] = frequency
        print(f"  {key:16} {frequency:6.1f}  {phrase.limit:4.1f}  {count:5}")
    return excess


def count_vague_names(files: list[Path]) -> dict[str, float]:
    """Print the frequency of names such as ``found``; return it if it is above the limit."""
    trees = [ast.parse(path.read_text("utf-8")) for path in files]
    names = [n.id for tree in trees for n in ast.walk(tree) if isinstance(n, ast.Name)]
    vague = sum(name in VAGUE_NAMES for name in names)
    frequency = 1e5 * vague / len(names)
    print(f"names such as 'found' per 100,000: {frequency:.0f}  {VAGUE_NAMES_LIMIT:.0f}  {vague}")
    return {"names such as 'found'": frequency} if frequency > VAGUE_NAMES_LIMIT else {}


def list_places(texts: list[Text], key: str) -> None:
    """Print every place of one phrase."""
    for text in texts:
        for match in re.finditer(PHRASES[key].pattern, text.text):
            line = text.line + text.text.count("\n", 0, match.start())
            part = text.text[max(0, match.start() - 30) : match.end() + 40].replace("\n", " ")
            print(f"{text.path.relative_to(ROOT)}:{line}: {part}")


def main() -> int:
    """Check product and pages; return 1 if a limit is exceeded."""
    sources = list_files("src", "plugins/*/src/*")
    pages = list_files("docs", "README.md", "CONTRIBUTING.md", "SECURITY.md")
    groups = {
        "product": [text for path in sources for text in read_texts(path)],
        "docs": [text for path in pages for text in read_texts(path)],
    }
    if "--where" in sys.argv:
        for texts in groups.values():
            list_places(texts, sys.argv[sys.argv.index("--where") + 1])
        return 0
    excess: dict[str, float] = {}
    for name, texts in groups.items():
        excess |= count_phrases(texts, name)
    excess |= count_vague_names([path for path in sources if path.suffix == ".py"])
    for key, frequency in excess.items():
        print(f"too frequent: {key}, {frequency:.1f}", file=sys.stderr)
    return 1 if excess else 0


if __name__ == "__main__":
    sys.exit(main())
