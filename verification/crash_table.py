"""Writes the output of ``crash_rate.py`` as a table for the documentation."""

import re

from studies.results import markdown_table
from verification.crash_rate import Rate

ENTRY = re.compile(
    r"^(.+): \d+ tests of ([\d.]+) km.*\n  crashes per test (.*)\n"
    r"  the ego hits a vehicle (.*), so more than ([\d,]+|inf) km",
    re.MULTILINE,
)
"""Matches the report of a check: name, km per test, crashes, hits by the ego, km between these."""


def table(printed: str) -> str:
    """Return the output of this program as a Markdown table; the intervals are 95 % intervals."""
    names = ["careless", "check", "crashes per test", "crashes per km"]
    names += ["the ego's own hits per test", "km between those, more than"]
    lines = []
    for part in re.split(r"^(?=[\d.]+ % of the lane changes)", printed, flags=re.MULTILINE)[1:]:
        for check, km, crashes, own, between in ENTRY.findall(part):
            numbers = re.findall(r"[\d.]+e[-+]\d+", crashes)
            per_km = Rate(*(float(number) / float(km) for number in numbers))
            share = f"{part.split(' ', 1)[0]} %"
            lines.append([share, check, crashes, str(per_km), own, between])
    return markdown_table(names, lines)
