"""Reads the XML files of a scenario folder, and refuses elements that a scenario does not need.

A SUMO file can name other files to read or overwrite, and network addresses to connect to. A
scenario folder may come from another person. Therefore each file is checked here before SUMO loads
it.
"""

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drl_av.errors import ScenarioError

MAX_BYTES = 64_000_000
MAX_DEPTH = 8
"""Largest depth of nested elements in a network file that the user provides."""
DECLARATION = re.compile(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
"""The start of an XML file that declares its encoding."""
GZIP = b"\x1f\x8b"
"""The first bytes of a compressed file."""
NETWORK = {
    "net": "",
    **dict.fromkeys(("location", "type", "edge", "junction", "connection"), "net"),
    "lane": "edge",
    "request": "junction",
}
ADDITIONAL = {"additional": "", "vType": "additional", "poly": "additional"}
DETECTORS = ("inductionLoop", "e1Detector", "instantInductionLoop", "laneAreaDetector",
             "e2Detector", "entryExitDetector", "e3Detector", "edgeData", "laneData")  # fmt: skip
OWN_ADDITIONAL = {
    "additional": "",
    **dict.fromkeys((*DETECTORS, "poly", "poi", "vTypeDistribution"), "additional"),
    "vType": "vTypeDistribution",
    **dict.fromkeys(("detEntry", "detExit"), "entryExitDetector"),
}
NO_FILE = "NUL"
"""SUMO's name for an output that is not written."""
VIEW = {
    "viewsettings": "",
    **dict.fromkeys(("scheme", "delay", "viewport"), "viewsettings"),
    **dict.fromkeys(("edges", "vehicles", "pois"), "scheme"),
}
"""``NETWORK``, ``ADDITIONAL``, ``OWN_ADDITIONAL`` (of the user's own additional files) and ``VIEW``
map each allowed XML element to its parent element."""


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
            if ("file" in name.lower() and attrs[name] != NO_FILE) or name == "href":
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


def parse_xml(path: Path, target: Any, remedy: str, if_too_large: str = "") -> Any:
    """Parse an XML file with the parser target ``target``; return the result of its ``close``.

    The text has the encoding that the file declares; without a declaration it is UTF-8, or UTF-16
    with a byte order mark. The target may refuse an element with a ValueError; its message says
    what is wrong in the file.

    Raises:
        ScenarioError: the file is missing, not a regular file, too large or damaged, or the target
            refuses it; each of these messages ends with ``remedy``, or with ``if_too_large``. Or
            the file is compressed.
    """
    data = read_regular_file(path, remedy, if_too_large or remedy)
    if data.startswith(GZIP):
        raise ScenarioError(f"{path} is compressed: unpack it with gunzip.")
    parser = ET.XMLParser(target=target, encoding="utf-8")  # overrides the file's declaration
    try:
        parser.feed(_decoded(data).encode())
        return parser.close()
    except (ET.ParseError, KeyError, UnicodeError) as error:
        raise ScenarioError(f"{path} is damaged or cut short ({error}): {remedy}.") from error
    except LookupError as error:
        raise ScenarioError(
            f"{path} has an encoding that Python does not know ({error}): save it as UTF-8."
        ) from error
    except ValueError as error:
        raise ScenarioError(f"{path} cannot be used, {error}: {remedy}.") from error


def _decoded(data: bytes) -> str:
    """Return the text of an XML file, in the encoding of its byte order mark or declaration."""
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return data.decode("utf-16")
    if data[:2] in (b"<\0", b"\0<"):
        return data.decode("utf-16-le" if data[0] else "utf-16-be")
    declared = DECLARATION.match(data)
    return data.decode(declared[1].decode() if declared else "utf-8-sig")


def read_regular_file(path: Path, remedy: str, if_too_large: str = "") -> bytes:
    """Return the bytes of a file; an error message ends with ``remedy`` or ``if_too_large``.

    Raises:
        ScenarioError: the file is missing, unreadable, not a regular file, or larger than 64 MB.
    """
    try:
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a pipe or a device"
            raise ScenarioError(f"{path} is no regular file, but {kind}: copy it to a file.")
        if path.stat().st_size > MAX_BYTES:
            limit = f"{path} is larger than {MAX_BYTES // 10**6} MB"
            raise ScenarioError(f"{limit}: {if_too_large or remedy}.")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ScenarioError(f"{path} is missing: {remedy}.") from error
    except OSError as error:
        raise ScenarioError(f"{path} cannot be read ({error}): {remedy}.") from error
