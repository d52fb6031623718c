"""Equations and figures of the paper are named by the numbers that the paper prints."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from shown import ROOT

EQUATIONS = {
    1: ("Bellman",),
    2: ("curvature", "steer"),
    3: ("gap condition", "T_min", "d_TVmin"),
    4: ("safe action", "demands", "T_C ", "T_HB", "T_B "),
    5: ("point mass", "explicit euler", "longitudinal"),
    6: ("point mass", "lateral speed", "T_LC"),
    7: ("r_v", "v_des", "reward"),
    8: ("r_y", "y_des", "reward"),
    9: ("r_x", "d_safe", "safe gap", "reward"),
}
"""Words of which one stands near the number of an equation."""
FIGURES = {
    "1a": ("barricade", "closed"),
    "1b": ("vehicles around",),
    "2": ("control architecture",),
    "3": ("highway",),
    "4": ("reward",),
    "5": ("learning curve", "training", "safety check"),
    "6": ("mean speed", "density", "whole schedule"),
    "7": ("prioritized",),
    "8": ("adaptation",),
}
SOURCES = (
    *("README.md", "CHANGELOG.md", "docs", "drl_av", "studies", "verification", "examples"),
    "tests/oracles",
)
NEAR = 130
"""Characters before and after a number in which a word must stand."""


def texts() -> Iterator[tuple[Path, str]]:
    """Every source and page without its line breaks and marks of comments."""
    for source in SOURCES:
        for path in sorted(ROOT.glob(source if source.endswith(".md") else f"{source}/**/*")):
            if path.suffix in {".md", ".py", ".toml"}:
                yield path, re.sub(r"[\s#*`]+", " ", path.read_text(encoding="utf-8"))


def mentions(pattern: str) -> list[tuple[Path, str, str]]:
    """Return for each number that follows the pattern its file, itself and the text around it."""
    found = []
    for path, text in texts():
        for match in re.finditer(pattern + r"((?:\d[ab]?(?:, | and | to )?)+)", text):
            around = text[max(match.start() - NEAR, 0) : match.end() + NEAR]
            first, *others = re.findall(r"\d[ab]?", match[1])
            numbers = [first, *others]
            if " to " in match[1]:
                numbers = [str(number) for number in range(int(first), int(others[0]) + 1)]
            found += [(path, number, around) for number in numbers]
    return found


def test_an_equation_has_the_number_that_the_paper_prints() -> None:
    found = mentions(r"\b[Ee]q\. ")
    assert {number for _, number, _ in found} >= set("3456789")
    assert not [at for at in found if not names_one_of(EQUATIONS[int(at[1])], at[2])]


def test_a_figure_has_the_number_that_the_paper_prints() -> None:
    found = mentions(r"\b(?:Fig\.|Figure) ")
    assert {number for _, number, _ in found} >= set("45678")
    assert not [at for at in found if not names_one_of(FIGURES[at[1]], at[2])]


def names_one_of(words: tuple[str, ...], text: str) -> bool:
    return any(word.lower() in text.lower() for word in words)


@pytest.mark.parametrize(
    ("wrong", "number"),
    [("r_x (eq. 8 of the paper)", 8), ("T_HB of eq. 3", 3), ("the gap condition (eq. 2)", 2)],
)
def test_a_former_number_would_be_seen(wrong: str, number: int) -> None:
    assert not names_one_of(EQUATIONS[number], wrong)
