"""A scenario folder from another person cannot write files, open sockets, or stop the reader."""

import os
import time
from pathlib import Path

import pytest
from runs import replace_in

from drl_av.errors import ScenarioError
from drl_av.scenarios import folder_files
from drl_av.scenarios.folder import load_scenario
from drl_av.scenarios.safe_xml import NETWORK, read_xml

TYPES, NETWORK_FILE, VIEW = "vehicle_types.add.xml", "highway.net.xml", "view.xml"


def spoil(folder: Path, name: str, old: str, new: str) -> None:
    """Change a file and its checksum, as the author of a hostile folder would."""
    replace_in(folder / name, old, new)
    found = {path.name for path in folder.iterdir()} & set(folder_files.ALL_FILES)
    sums = folder_files.checksums({name: (folder / name).read_bytes() for name in found})
    (folder / folder_files.CHECKSUMS_FILE).write_text(sums, encoding="utf-8")


LANE_0, LANE_1 = '<lane id="e0_0" index="0"', '<lane id="e0_1" index="1"'
EDGE_DATA = '<edgeData id="x" file="{}"/>\n</additional>'
DEVICE = '<param key="device.fcd-replay.file" value="x"/></vType>\n</additional>'


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        (TYPES, "</additional>", EDGE_DATA.format("/etc/passwd"), "<edgeData>"),
        (TYPES, "</additional>", EDGE_DATA.format("localhost:4000"), "<edgeData>"),
        (TYPES, "</additional>", '<include href="x.xml"/>\n</additional>', "<include>"),
        (TYPES, "</additional>", '<vType id="x">' + DEVICE, "<param>"),
        (TYPES, 'id="ego"', 'imgFile="x.png" id="ego"', "'imgFile'"),
        (TYPES, "<additional>", '<!DOCTYPE a SYSTEM "x">\n<additional>', "document type"),
        (VIEW, "</viewsettings>", '<decal file="x.png"/>\n</viewsettings>', "<decal>"),
        (NETWORK_FILE, "</net>", '<tlLogic id="x"/></net>', "<tlLogic>"),
        (NETWORK_FILE, "</edge>", '</edge><lane id="e0_0" index="0"/>', "<lane> outside of <edge>"),
        (NETWORK_FILE, "</edge>", '<edge id="x"/></edge>', "<edge> outside of <net>"),
        (NETWORK_FILE, "</edge>", "<net/></edge>", "<net> in <edge>"),
        (NETWORK_FILE, LANE_0, LANE_0 + ' allow="bus"', "allow 'bus' on lane 'e0_0', not None"),
        (NETWORK_FILE, LANE_0, LANE_0 + ' disallow="bus"', "disallow 'bus' on lane 'e0_0'"),
        (NETWORK_FILE, LANE_1, LANE_0, "has other lanes than described, one is 'e0_0'"),
        (NETWORK_FILE, LANE_0, '<lane id="e0_0" index="-1"', "one is 'e0_0'"),
        (NETWORK_FILE, LANE_0, '<lane id="e0_0" index="99999999999"', "one is 'e0_0'"),
    ],
)
def test_what_no_scenario_needs_is_refused_in_one_sentence(
    name: str, old: str, new: str, message: str, folder: Path
) -> None:
    spoil(folder, name, old, new)
    with pytest.raises(ScenarioError, match=r"scenario DIR\.$") as error:
        load_scenario(folder)
    assert message in str(error.value)
    assert name in str(error.value)


def test_the_spoilt_folder_was_sound_before(folder: Path) -> None:
    spoil(folder, TYPES, "</additional>", "<!-- a comment harms no one --></additional>")
    assert load_scenario(folder).as_written


def test_a_document_of_100_000_levels_is_refused_at_once(tmp_path: Path) -> None:
    deep = tmp_path / "deep.xml"
    deep.write_text("<net>" + "<edge>" * 100_000 + "</edge>" * 100_000 + "</net>")
    begun = time.monotonic()
    with pytest.raises(ScenarioError, match="<edge> outside of <net>: go back"):
        read_xml(deep, NETWORK, "go back")
    assert time.monotonic() - begun < 1.0


@pytest.mark.parametrize("name", ["scenario.toml", NETWORK_FILE, TYPES, "SHA256SUMS"])
def test_a_pipe_in_place_of_a_file_is_refused_and_not_waited_for(name: str, folder: Path) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(ScenarioError, match="is no regular file"):
        load_scenario(folder)
