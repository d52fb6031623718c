"""The barricaded lane as an experiment of ``drl-av reproduce``."""

import json
from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments import barricade as module
from drl_av.experiments.options import Scale


def test_the_table_is_made_once_with_what_made_it_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SEEDS", (0,))
    monkeypatch.setattr(module, "EPISODES", 2)
    monkeypatch.setattr(module, "TRAINED_EPISODES", 1)
    told = list(module.barricade(Scale(out=tmp_path)))
    table = tmp_path / "barricade.csv"
    # one seed, two checks, two episodes of training and one of the driver trained
    assert [step.done for step in told] == [1, 2, 3, 4, 5, 6]
    assert told[-1].total == 6
    assert len(table.read_text().splitlines()) == 1 + 6
    assert json.loads((tmp_path / "barricade.json").read_text())["seeds"] == "0 to 0"
    written = table.read_bytes()
    assert list(module.barricade(Scale(out=tmp_path))) == []
    (tmp_path / "short.toml").write_text("[learning]\nepisodes = 1\n")
    other = Scale(out=tmp_path, config=str(tmp_path / "short.toml"))
    with pytest.raises(DrlAvError, match=r"made with other settings .*--out.*barricade\.json away"):
        list(module.barricade(other))
    assert table.read_bytes() == written
    table.unlink()
    assert len(list(module.barricade(other))) == 4
