"""The measurement of merges: what counts as merged, forced and waited."""

import pytest

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.traffic.merge import MergeDescription
from drl_av.traffic.scenario import write_scenario
from verification.merging import Merge, drive, interval, line


def test_wilsons_interval_of_two_in_ten_and_of_all() -> None:
    # Wilson 1927: (0.2 + 0.1921) / 1.3841 = 0.2833, half width 0.2266
    assert interval(2, 10) == "20.0% (5.7% to 51.0%)"
    assert interval(40, 40) == "100.0% (91.2% to 100.0%)"


def test_the_line_counts_what_the_episodes_showed() -> None:
    merges = [Merge(merged=True, decisions=8, flow_per_h=900.0), Merge(waits=30, flow_per_h=1100.0)]
    shown = line("gap-mobil", 1000.0, merges)
    assert "1000 vehicles/h/lane asked, 1000 found: 2 episodes, merged 50.0%" in shown
    assert "longest wait 30 s, on the highway after 8.0 s" in shown


@pytest.mark.parametrize(("driver", "merged"), [("gap-mobil", True), ("idm", False)])
def test_on_an_empty_highway_the_gap_rule_merges_and_a_driver_that_keeps_its_lane_waits(
    driver: str, merged: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("merging") / "empty"
    write_scenario(folder, MergeDescription(flow_per_h=0.0))
    config = Config().updated("safety", check="strict")
    config = config.updated("simulation", scenario=str(folder), decisions_per_episode=60)
    env = HighwayEnv(config=config)
    found = drive(env, driver, 0)
    env.close()
    assert found.merged is merged
    assert not found.ego_hit
    assert (found.waits > 0) is not merged
    assert (found.decisions is not None) is merged
