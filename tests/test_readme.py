"""What the README shows is run, made small; its tables are those of the code and the results."""

import re
from pathlib import Path

import pytest
from shown import ROOT, fenced, read, run, run_commands

from drl_av.env.highway import HighwayEnv

README = read("README.md")
MOST_WORDS = 1_200


def test_it_is_short() -> None:
    assert len(re.sub(r"<!--.*?-->", "", README).split()) <= MOST_WORDS


def test_the_quickstart_works_in_an_empty_folder(tmp_path: Path) -> None:
    run_commands("README.md", tmp_path)
    for made in ("drive.mp4", "runs/first/policy.safetensors", "table.csv"):
        assert (tmp_path / made).stat().st_size > 0
    assert (tmp_path / "figures" / "mean_speed.png").exists()


def test_the_python_example_drives_an_episode_in_which_the_check_replaces_actions(
    tmp_path: Path,
) -> None:
    [program] = fenced("README.md", "python")
    printed = run(tmp_path, "-c", program).stdout
    replaced = re.fullmatch(r"(\d+) actions replaced, collision: none\n", printed)
    assert replaced
    assert 0 < int(replaced[1]) < 200


def test_the_tables_are_those_of_the_code_and_the_committed_results() -> None:
    run(ROOT, "tools/refresh_tables.py", "--check")


def test_a_number_in_the_text_of_the_results_is_a_cell_of_a_table() -> None:
    results = README.partition("## Results")[2].partition("## ")[0]
    results = re.sub(r"<!-- (table|value|mean).*?<!-- end -->", "", results, flags=re.DOTALL)
    assert set(re.findall(r"-?\d\.\d{2,}", results)) == {"-0.025"}  # the paper's


def test_it_names_every_entry_of_info_and_no_other() -> None:
    shown = set(re.findall(r'info\["(\w+)"\]', README.partition("| term")[2]))
    with HighwayEnv(action_mask=True) as env:
        _, at_reset = env.reset(seed=1, options={"vehicles": 2})
        *_, after_a_step = env.step(0)
    assert shown == set(after_a_step) | set(at_reset)
    assert all(f"`{term}`" in README for term in after_a_step["rewards"])


def test_the_code_map_names_every_package() -> None:
    folders = {path.parent.name for path in (ROOT / "drl_av").glob("*/__init__.py")}
    shown = set(re.findall(r"^\| `(\w+)` \|", README.partition("## Code map")[2], re.MULTILINE))
    assert shown == folders


@pytest.mark.parametrize("target", ["setup", "demo", "test", "docs"])
def test_the_make_targets_exist(target: str) -> None:
    assert f"make {target}" in README
    assert re.search(rf"^{target}:", read("Makefile"), re.MULTILINE)


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_a_link_leads_somewhere(link: str) -> None:
    assert link.startswith("https://") or (ROOT / link).exists()


def test_the_moving_picture_moves_and_is_small() -> None:
    from PIL import Image

    picture = ROOT / "docs" / "drive.gif"
    assert picture.stat().st_size < 1_500_000
    with Image.open(picture) as frames:
        assert frames.n_frames > 30
