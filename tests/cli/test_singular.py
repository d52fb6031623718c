"""One vehicle, one episode: what is printed, drawn and refused contains no "1 vehicles"."""

import re
from pathlib import Path

import pytest

from drl_av.cli import main
from drl_av.drawing.canvas import Canvas

WRONG = re.compile(r"(?<![\d.,])1 (?!(?:is|was|has)\b)[a-z]+ ?[a-z]*s\b")
"""A 1 before one or two words that end in an s; also "1 open lanes"."""


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All texts of the pictures of a film."""
    texts, draw = [], Canvas.text

    def text(sheet, at, words, *rest, **named):
        texts.append(words)
        draw(sheet, at, words, *rest, **named)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


def test_the_pattern_finds_what_is_wrong() -> None:
    assert WRONG.findall("1 vehicles, 1 open lanes, 1 safety triggers") != []
    assert WRONG.findall("1 episode each, 11 episodes, 0.1 episodes, seed 1: 3 decisions") == []


def test_one_of_a_kind_is_printed_and_drawn_in_the_singular(
    here: Path,
    capsys: pytest.CaptureFixture[str],
    drawn: list[str],
) -> None:
    among = ["--vehicles", "1", "--config", "short.toml"]
    Path("short.toml").write_text("[simulation]\ndecisions_per_episode = 1\n")
    once = ["--episodes", "1"]
    for words in (
        ["train", "--out", "run", "--preset", "paper", *once, "--config", "short.toml"],
        ["evaluate", "run", "--driver", "idm", *among, *once, "--out", "rows.csv"],
        ["adapt", "run", "--out", "adapted", *once],
        ["figures", "rows.csv", "run", "--out", "figures"],
        ["replay", "--driver", "idm", *among, "--video", "drive.gif", "--record", "drive.npz"],
        ["replay", "drive.npz", "--html", "page.html"],
    ):
        assert main(words) == 0, words
    printed = capsys.readouterr()
    said = printed.out + printed.err
    assert "1 episode each" in said
    assert "1 vehicle, seed 0: 1 decision, " in said
    assert "1 vehicle" in " ".join(drawn)
    found = [WRONG.findall(text) for text in (said, *drawn)]
    assert not any(found)


def test_one_of_a_kind_is_refused_in_the_singular(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenario", "tiny", "--lanes", "1", "--circumference-m", "100"]) == 0
    assert main(["evaluate", "idm", "--scenario", "tiny", "--vehicles", "40"]) == 1
    refused = capsys.readouterr().err
    assert "on its 1 open lane, not for 40: ask for fewer" in refused
    assert not WRONG.findall(refused)
