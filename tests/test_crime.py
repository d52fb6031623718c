"""Our time to collision and DRAC against commonroad-crime 0.4.5 on 1,000 scenes.

The package needs an environment of its own, of 1 GB (`make crime`); without it these tests are
skipped. It rounds to two decimals. Its required deceleration is the same square of the relative
speed over twice the gap, whether the gap shrinks or grows; ours is 0 where it grows. Its PET is of
intersections only, and its TET and TIT sum its TTC, as ours do.
"""

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from drl_av.evaluation.criticality import required_deceleration
from drl_av.safety.paper import time_to_collision

PYTHON = os.environ.get("CRIME_PYTHON", "")
SCENES = 1000


@pytest.mark.skipif(not PYTHON, reason="commonroad-crime has its own environment: make crime")
def test_ttc_and_drac_are_those_of_commonroad_crime_on_1000_scenes() -> None:
    random = np.random.default_rng(23)
    columns = [
        random.uniform(low, high, SCENES)
        for low, high in ((2, 200), (0, 30), (0, 30), (4, 6), (4, 16))
    ]
    scenes = np.stack(columns, axis=1).tolist()
    script = Path(__file__).with_name("crime_scenes.py")
    ended = subprocess.run(
        [PYTHON, str(script)], input=json.dumps(scenes), capture_output=True, text=True, check=True
    )
    theirs = json.loads(ended.stdout.splitlines()[-1])
    closings = 0
    for (gap_m, ego_m_s, other_m_s, *_), (ttc_s, drac_m_s2) in zip(scenes, theirs, strict=True):
        closing_m_s = ego_m_s - other_m_s
        closings += closing_m_s > 0
        # it cuts the gap to 1 cm before it computes, and rounds what it finds to 0.01
        coarse = 0.011 + (0.011 / closing_m_s if closing_m_s > 0 else 0.0)
        assert ttc_s == pytest.approx(time_to_collision(gap_m, closing_m_s), abs=coarse, rel=1e-5)
        expected = required_deceleration(gap_m, abs(closing_m_s))
        assert drac_m_s2 == pytest.approx(expected, abs=0.011 + expected * 0.011 / gap_m)
    assert len(theirs) == SCENES
    assert 400 < closings < 600
    assert math.inf in [ttc for ttc, _ in theirs]
