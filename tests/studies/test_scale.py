"""The gain of the preset ``large`` as it learns: the table, and that it goes on."""

from pathlib import Path

import pytest
from runs import Capsys

from drl_av.config import SINGLE_PRESETS
from drl_av.files.table import read_table
from studies import scale


def test_the_table_has_the_ends_alone_and_the_worst_of_each_column() -> None:
    end = scale.POINTS[-1]
    gains = {(0, end): 0.5, (1, end): 0.3, (0, 500_000): -0.2, (1, 500_000): -0.4}
    rows = [
        {"seed": seed, "decisions": decisions, "traffic": kind, "gain_m_s": gain, "ego_hits": seed}
        | ({"gain_m_s": 1.3} if kind == "hazards" and decisions == end and seed == 1 else {})
        for (seed, decisions), gain in gains.items()
        for kind in SINGLE_PRESETS
    ]
    head, *lines = scale.table(rows).splitlines()
    assert head.split() == ["seed", *SINGLE_PRESETS, "mean", "ego", "hits"]
    assert lines[0].split() == ["0", *5 * ["0.50"], "0.50", "0"]
    assert lines[1].split() == ["1", *4 * ["0.30"], "1.30", "0.50", "5"]
    assert lines[2].split() == ["worst", *4 * ["0.30"], "0.50", "0.50", "5"]


def test_it_keeps_policies_on_the_way_and_goes_on_where_it_stopped(
    tmp_path: Path, two_episodes: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setattr(scale, "POINTS", (16_384, 40_000))
    scale.main(two_episodes)
    kept = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert kept == ["7-16384.safetensors", "7-40000.safetensors"]
    assert (tmp_path / "runs" / kept[0]).read_bytes() != (tmp_path / "runs" / kept[1]).read_bytes()
    first = read_table(tmp_path / "out.csv")
    assert [row["decisions"] for row in first] == [*5 * ["16384"], *5 * ["40000"]]
    assert (tmp_path / "out.png").stat().st_size > 10_000
    monkeypatch.setattr(scale, "train", None)  # nothing is trained again
    scale.main(two_episodes)
    assert read_table(tmp_path / "out.csv") == first
    assert "worst" in capsys.readouterr().out
