"""The bound of full throttle on an empty road, beside the published episodes."""

from contextlib import closing

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from studies.options import FOLDER, RESULTS
from studies.pivot import Pivot
from studies.study import FileStudy
from verification.speed_bound import fastest_m_s, most_to_gain


def test_the_bound_is_full_throttle_and_the_gain_is_the_published_one() -> None:
    study = FileStudy(FOLDER / "opponents.toml")
    pivot = Pivot(study, study.file["tables"]["opponents_gain"], RESULTS)
    published = (RESULTS / "speed_bound.txt").read_text().splitlines()
    calm = next(line for line in published if line.startswith("calm"))
    with closing(HighwayEnv(config=Config().with_traffic("calm"))) as env:
        found = most_to_gain(env, pivot, {"traffic": "calm", "vehicles": 5})
        assert calm.split()[4:7] == found.split()
        env.reset(seed=990_000, options={"vehicles": 5})
        begins_m_s = env.scene.affordances.ego_speed_m_s
        speeds = [min(begins_m_s + 2.0 * second, 30.0) for second in range(1, 201)]
        assert abs(fastest_m_s(env, 5, 990_000) - sum(speeds) / 200) < 1e-9
