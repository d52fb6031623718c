"""Reads the XML files of a scenario folder, and refuses elements that a scenario does not need.

A SUMO file can name other files to read or overwrite, and network addresses to connect to. A
scenario folder may come from another person. Therefore each file is checked here before SUMO loads
it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drl_av.errors import ScenarioError

MAX_BYTES = 64_000_000
MAX_DEPTH = 8
"""Largest depth of nested elements in a network file that the user provides."""
GZIP = b"\x1f\x8b"
"""The first bytes of a compressed file."""
NETWORK = {
    "net": "",
    **dict.fromkeys(("location", "type", "edge", "junction", "connection"), "net"),
    "lane": "edge",
    "request": "junction",
}
ADDITIONAL = {"additional": "", "vType": "additional", "poly": "additional"}
VIEW = {
    "viewsettings": "",
    **dict.fromkeys(("scheme", "delay", "viewport"), "viewsettings"),
    **dict.fromkeys(("edges", "vehicles", "pois"), "scheme"),
}
"""``NETWORK``, ``ADDITIONAL`` and ``VIEW`` map each allowed XML element to its parent element."""


class _Reader(ET.TreeBuilder):
    """Builds the tree of an XML document; raises ValueError at an element that is not allowed."""

    def __init__(self, elements: Mapping[str, str]) -> None:
        super().__init__()
        self._elements, self._open = elements, [""]

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """Begin an element; raise ValueError if its name, place or an attribute is not allowed."""
        if tag not in self._elements:
            raise ValueError(f"it has an element <{tag[:40]}>, which no scenario needs")
        if (owner := self._elements[tag]) != self._open[-1]:
            place = f"outside of <{owner}>" if owner else f"in <{self._open[-1]}>"
            raise ValueError(f"it has an element <{tag}> {place}")
        self._open.append(tag)
        for name in attrs:
            if "file" in name.lower() or name == "href":
                raise ValueError(f"its <{tag}> names a file by the attribute {name[:40]!r}")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """End the current element."""
        self._open.pop()
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Raise ValueError: a document type may define entities and name other documents."""
        raise ValueError("it declares a document type")


def read_xml(path: Path, elements: Mapping[str, str], remedy: str) -> ET.Element:
    """Return the root element of an XML file that contains only the allowed ``elements``.

    ``elements`` maps each allowed element to its parent element. ``remedy`` says what the user can
    do about an error; the error messages end with it.

    Raises:
        ScenarioError: the file is missing, not a regular file, too large or damaged, or has an
            element or attribute that is not allowed.
    """
    root: ET.Element = parse_xml(path, _Reader(elements), remedy)
    return root


def parse_xml(path: Path, target: Any, remedy: str) -> Any:
    """Parse an XML file with the parser target ``target``; return the result of its ``close``.

    The target may refuse an element with a ValueError; its message says what is wrong in the file.

    Raises:
        ScenarioError: the file is missing, not a regular file, too large or damaged, or the target
            refuses it; each of these messages ends with ``remedy``. Or the file is compressed.
    """
    data = read_regular_file(path, remedy)
    if data.startswith(GZIP):
        raise ScenarioError(f"{path} is compressed: unpack it with gunzip.")
    parser = ET.XMLParser(target=target)
    try:
        parser.feed(data.decode("utf-8-sig").encode())
        return parser.close()
    except (ET.ParseError, LookupError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path} is damaged or cut short ({error}): {remedy}.") from error
    except ValueError as error:
        raise ScenarioError(f"{path} cannot be used, {error}: {remedy}.") from error


def read_regular_file(path: Path, remedy: str) -> bytes:
    """Return the bytes of a file; each error message ends with ``remedy``.

    Raises:
        ScenarioError: the file is missing, unreadable, not a regular file, or larger than 64 MB.
    """
    try:
        if path.exists() and not path.is_file():
            raise ScenarioError(f"{path} is no regular file: {remedy}.")
        if path.stat().st_size > MAX_BYTES:
            raise ScenarioError(f"{path} is larger than {MAX_BYTES // 10**6} MB: {remedy}.")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ScenarioError(f"{path} is missing: {remedy}.") from error
    except OSError as error:
        raise ScenarioError(f"{path} cannot be read ({error}): {remedy}.") from error
