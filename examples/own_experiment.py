"""An experiment of your own: does the driver idm-mobil need the check to look 3 s ahead?

python examples/own_experiment.py
"""

from contextlib import closing

from drl_av.config import Config
from drl_av.drivers.mobil import MobilDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.rollout import drive
from drl_av.evaluation.statistics import mean_with_interval

SEEDS = range(800_000, 800_005)
VEHICLES = 20


def episodes(minimum_ttc_s: float) -> list[EpisodeResult]:
    """The same traffic under a check with another T_min."""
    config = Config().updated("safety", minimum_ttc_s=minimum_ttc_s)
    driver = MobilDriver(config.safety, config.ego, config.mobil)
    with closing(HighwayEnv(config=config)) as env:
        return [drive(env, driver, "idm-mobil", seed, VEHICLES) for seed in SEEDS]


def main() -> None:
    """Compare the two, paired by seed, with a 95 % confidence interval."""
    paper, shorter = episodes(3.0), episodes(1.5)
    pairs = zip(shorter, paper, strict=True)
    gain = mean_with_interval(a.mean_speed_m_s - b.mean_speed_m_s for a, b in pairs)
    print(f"T_min 1.5 s instead of 3 s: {gain} m/s faster")
    for name, rows in (("3 s", paper), ("1.5 s", shorter)):
        print(f"{name}: {sum(row.ego_hit for row in rows)} of {len(rows)} episodes with a hit")


if __name__ == "__main__":
    main()
