"""The documentation: the site is built strictly, its references are complete, its examples run."""

import json
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import fields
from html import unescape
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import pytest
from checks_of_study import with_check
from packaging.version import Version
from programs import python
from shown import ROOT, fenced, read, run, run_commands

import drl_av
from drl_av.cli import VERBS
from drl_av.config import Config, from_toml
from drl_av.config.reference import SECTIONS, settings
from drl_av.drivers.onnx import INPUTS, OUTPUTS
from drl_av.driving.affordances import INDICATORS

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
ARGUMENTS = {
    "check_in_highwayenv": ("1",),
    "cleanrl_dqn": ("240", "960 32"),
    "compare_drivers": ("2",),
    "maskable_ppo": ("64", "128 16"),
    "sb3_dqn": ("120", "120 twin"),
    "torchrl_dqn": ("512 16",),
}
"""Arguments that shorten an example, for each run; the second run trains in the twin."""
ELSEWHERE = {"rllib_ppo"}
"""Examples that need another environment: ``make rllib``."""


SITE = "mkdocs.yml"
"""The generator's settings."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built strictly from a copy of its sources, in another working directory."""
    project = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / SITE, project)
    for folder in ("docs", "examples", "tools"):
        shutil.copytree(ROOT / folder, project / folder)
    for package in ("drl_av", "studies"):
        (project / package).symlink_to(ROOT / package)
    words = ["-m", "zensical", "build", "--strict", "--config-file", project / SITE]
    done = python(*words, cwd=tmp_path_factory.mktemp("elsewhere"))
    assert done.returncode == 0, done.stdout + done.stderr
    return project / "site"


def words(page: Path) -> str:
    """The text of a built page without its tags."""
    return unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))


def test_the_settings_page_names_every_setting_with_its_meaning_and_source(site: Path) -> None:
    page = words(site / "reference" / "settings.html")
    found = list(settings(Config()))
    assert len(found) == sum(len(fields(getattr(Config(), name))) for name in SECTIONS) > 100
    for setting in found:
        assert setting.key in page
        assert setting.meaning in page
        assert setting.source in page


def test_the_python_page_describes_what_a_function_returns_in_one_piece(site: Path) -> None:
    page = (site / "reference" / "python.html").read_text(encoding="utf-8")
    lists = re.findall(r"Returns:</span></p>\s*<ul>(.*?)</ul>", page, re.DOTALL)
    assert {items.count("<li") for items in lists} == {1}


def test_the_command_line_page_has_the_help_of_every_verb(site: Path) -> None:
    page = words(site / "reference" / "command_line.html")
    for verb in VERBS:
        assert f"usage: drl-av {verb} " in page


def test_the_environment_page_has_every_indicator_and_action(site: Path) -> None:
    page = words(site / "environment.html")
    for place, name in enumerate(INDICATORS):
        assert re.search(rf"\b{place}\s+{name}\b", page)
    assert re.search(r"keep the lane\s+0\s+1\s+2\s+3", page)
    assert re.search(r"change to the left\s+8\s+9\s+10\s+11", page)


def test_the_export_page_has_every_input_output_and_indicator(site: Path) -> None:
    page = re.sub(r"\s+", " ", words(site / "export.html"))
    for port in (*INPUTS, *OUTPUTS):
        shape = ", ".join(map(str, port.shape))
        assert f"{port.name} {port.dtype} ({shape}) {port.meaning}" in page
    for place, name in enumerate(INDICATORS):
        assert re.search(rf"\b{place} {name}\b", page)


def test_the_argument_for_strict_stands_on_the_safety_page(site: Path) -> None:
    import drl_av.safety.strict

    argument = str(drl_av.safety.strict.__doc__)
    page = re.sub(r"\s+", " ", words(site / "safety.html"))
    sentences = re.findall(r"[A-Z][a-z ,;:']{40,}\.", re.sub(r"\s+", " ", argument))
    assert len(sentences) > 3
    for sentence in sentences:
        assert sentence in page


PAGES = sorted(path for path in (ROOT / "docs").rglob("*.md") if path.stem != "log")
"""The pages that a reader may want to read; the log of trials is none of them."""
MOST_WORDS = 2_500


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_is_short_and_one_of_results_begins_with_its_figure(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(text.split()) <= MOST_WORDS
    # Markdown would end the paragraph at a line that begins with the mark of a number
    assert not re.findall(r"^<!-- (?:value|mean).*", text, re.MULTILINE)
    title, *blocks = text.split("\n\n")
    if page.parent.name == "results" and any(block.startswith("![") for block in blocks):
        assert title.startswith("# ")
        assert blocks[0].startswith("![")
        assert not blocks[1].startswith(("<!--", "#", "|"))  # then sentences


def test_each_choice_answers_a_question() -> None:
    page = read("docs/choices.md")
    for section in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        name, first, *_ = re.split(r"\n+", section)
        assert first.startswith("### "), f"{name} begins with no question"
    entries = re.findall(r"^### (.+)$", page, re.MULTILINE)
    assert len(entries) > 8
    assert all(entry.endswith("?") for entry in entries)


def test_a_picture_is_there(site: Path) -> None:
    shown = 0
    for page in site.rglob("*.html"):
        for source in re.findall(r'<img [^>]*src="([^"]+)"', page.read_text(encoding="utf-8")):
            assert (page.parent / source).is_file(), f"{page} shows {source}"
            shown += 1
    assert shown > 15


def test_the_search_finds_a_word_of_each_page(site: Path) -> None:
    index = json.loads((site / "search.json").read_text(encoding="utf-8"))
    pages = {item["location"].partition("#")[0] for item in index["items"]}
    assert pages == {str(page.relative_to(site)) for page in site.rglob("*.html")} - {"404.html"}


def test_no_page_loads_anything_from_another_place(site: Path) -> None:
    loaded = r"<(?:script|img|link)[^>]+(?:src|href)=\"?(https?://[^\s\">]+)"
    for page in site.rglob("*.html"):
        assert not re.findall(loaded, page.read_text(encoding="utf-8")), page


def test_the_commands_of_the_guide_work_in_an_empty_folder(tmp_path: Path) -> None:
    run_commands("docs/guide.md", tmp_path)
    assert (tmp_path / "my_loop" / "highway.sumocfg").exists()
    assert (tmp_path / "runs" / "adapted" / "policy.safetensors").exists()
    assert (tmp_path / "episode.npz").exists()


def test_the_settings_file_of_the_guide_trains(tmp_path: Path) -> None:
    [text] = fenced("docs/guide.md", "toml")
    (tmp_path / "mine.toml").write_text(text)
    run(tmp_path, "-m", "drl_av", "scenario", "my_loop")
    small = ["--config", "mine.toml", "--episodes", "1"]
    run(tmp_path, "-m", "drl_av", "train", "--out", "mine", *small)
    assert '\nlateral_plant = "steering"\n' in (tmp_path / "mine" / "config.toml").read_text()


def test_the_bounds_of_real_traffic_on_the_safety_page_are_those_of_the_results() -> None:
    [text] = fenced("docs/safety.md", "toml")
    assert with_check(Config(), "real").strict == from_toml(text).strict != Config().strict


@pytest.mark.parametrize(
    ("example", "arguments"),
    [
        (path.name, arguments)
        for path in EXAMPLES
        if path.stem not in ELSEWHERE
        for arguments in ARGUMENTS.get(path.stem, ("",))
    ],
)
def test_an_example_runs(example: str, arguments: str, tmp_path: Path) -> None:
    assert run(tmp_path, str(ROOT / "examples" / example), *arguments.split()).stdout


def test_the_notebook_holds_what_it_prints_and_draws_when_it_is_executed(tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(ROOT / "examples" / "tour.ipynb", as_version=4)
    kept = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": tmp_path}}).execute()
    made = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    fresh = [output for output in made if output.get("name") != "stderr"]  # numba may compile
    for outputs in (kept, fresh):
        assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
        assert "idm-mobil" in outputs[-1]["text"]
    # training adds numbers in the order of the processor's instructions, so its driver may differ
    texts = [
        [re.sub(r"(?m)^run .*", "run", output.get("text", "")) for output in outputs]
        for outputs in (kept, fresh)
    ]
    assert texts[0] == texts[1]


def test_the_versions_of_the_libraries_are_those_that_are_tested() -> None:
    shown = dict(re.findall(r"^\| (\w+) \| ([\d.]+) \|", read("docs/libraries.md"), re.MULTILINE))
    pins = dict(re.findall(r"^([\w-]+)==(.+)$", read("constraints.txt"), re.MULTILINE))
    pins = {name.replace("-", "_"): pinned for name, pinned in pins.items()}
    assert shown == {name: pins[name] for name in shown}
    installed = {name: pinned for name, pinned in shown.items() if find_spec(name)}
    assert installed == {name: version(name) for name in installed}
    assert len(shown) == 7


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_a_page_shows_the_example(example: Path) -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    assert f'example("{example.name}")' in pages


def test_the_picture_of_the_packages_names_them_all() -> None:
    picture = ET.parse(ROOT / "docs" / "assets" / "packages.svg").getroot()
    bold = [str(text.text) for text in picture.iter() if text.get("font-weight") == "bold"]
    named = set(", ".join(bold).split(", "))
    rooms = {path.parent.name for path in (ROOT / "drl_av").glob("*/__init__.py")}
    modules = {path.stem for path in (ROOT / "drl_av").glob("[a-z]*.py")}
    assert rooms | modules <= named
    for name in named - rooms - modules:
        assert (ROOT / name).is_dir()


def test_the_architecture_page_says_where_things_are() -> None:
    page = read("docs/architecture.md")
    row = r"^\| [^|]+\? \| `([\w/.]+)`(?:: (.+?))?(?:, one .+)? \|$"
    answers = re.findall(row, page, re.MULTILINE)
    assert len(answers) > 15
    for file, names in answers:
        assert (ROOT / "drl_av" / file).exists(), f"{file} is elsewhere now"
        for name in re.findall(r"`(\w+)`", names):
            code = read(f"drl_av/{file}")
            assert re.search(rf"^ *(def|class) {name}\b|^{name}\b.* = ", code, re.MULTILINE), name
    for file in re.findall(r"in `([\w/]+\.py)`", page):
        assert (ROOT / "drl_av" / file).exists(), f"{file} is elsewhere now"


def test_the_newest_release_of_the_changelog_is_the_version() -> None:
    releases = re.findall(r"^## (\S+), ", read("CHANGELOG.md"), re.MULTILINE)
    assert releases[0] == drl_av.__version__
    assert releases == sorted(releases, key=Version, reverse=True)
    assert f"version: {drl_av.__version__}\n" in read("CITATION.cff")
