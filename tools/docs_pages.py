"""Makes tables and lists of the documentation from the code, as macros of the site's generator.

``mkdocs.yml`` names this file. The text of a function in MACROS replaces its call in a page,
``<!-- from code: actions() -->``.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from drl_av.cli import command_line
from drl_av.config import Config
from drl_av.config.reference import SECTIONS, section_meaning, settings, written
from drl_av.drivers.onnx_interface import INPUTS, INSIDE, OUTPUTS, indicator_meaning
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.affordances import INDICATORS, SLOTS
from drl_av.env.observation import GROUPS
from drl_av.scenarios.road_types import ROAD_TYPES
from studies.markdown import markdown_table

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
LONGITUDINAL = ("maintain", "accelerate", "brake", "hard brake")
LATERAL = ("keep the lane", "change to the right", "change to the left")


def table(heading: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table in Markdown; a ``|`` in a cell is escaped."""
    return markdown_table(heading, ([str(c).replace("|", "\\|") for c in row] for row in rows))


def actions() -> str:
    """Return the Markdown table of the 12 action numbers: lateral rows, longitudinal columns."""
    ego = Config().ego
    columns = [
        f"{LONGITUDINAL[how]} ({how.acceleration_m_s2(ego):+g} m/s²)".replace("+0 ", "0 ")
        for how in Longitudinal
    ]
    rows = [
        [LATERAL[where], *(Action(where, how).number for how in Longitudinal)] for where in Lateral
    ]
    assert sorted(number for row in rows for number in row[1:]) == list(range(len(ACTIONS)))
    return table(["", *columns], rows)


def observation() -> str:
    """Return a short Markdown table of the 27 affordance indicators, one row for each lane."""
    rows = []
    for place in range(0, 4 * len(SLOTS), 8):
        lane = SLOTS[place // 4].removesuffix("_front")
        assert SLOTS[place // 4 : place // 4 + 2] == (f"{lane}_front", f"{lane}_rear")
        states = [name.removeprefix(f"{lane}_front_") for name in INDICATORS[place : place + 4]]
        where = "the ego's lane" if lane == "own" else f"the lane to its {lane}"
        each = f"{', '.join(states)} of the vehicle ahead, then behind"
        rows.append([f"{place} to {place + 7}", where, each])
    ego = [name.removeprefix("ego_") for name in INDICATORS[4 * len(SLOTS) :]]
    rows.append([f"{4 * len(SLOTS)} to {len(INDICATORS) - 1}", "the ego", ", ".join(ego)])
    return table(["places", "about", "values"], rows)


def indicators() -> str:
    """Return the Markdown table of the 27 affordance indicators, one row for each."""
    rows = [[place, f"`{name}`", indicator_meaning(name)] for place, name in enumerate(INDICATORS)]
    return table(["place", "name", "meaning"], rows)


def exported() -> str:
    """Return the Markdown table of an exported driver's inputs and outputs, and its contents."""
    rows = [
        [kind, f"`{port.name}`", port.dtype, f"({', '.join(map(str, port.shape))})", port.meaning]
        for kind, ports in (("input", INPUTS), ("output", OUTPUTS))
        for port in ports
    ]
    return table(["", "name", "type", "shape", "meaning"], rows) + f"\n\n{INSIDE}"


def kinds() -> str:
    """Return the Markdown table of the kinds of scenarios, one row for each."""
    return table(
        ["kind", "road"], [[f"`{name}`", kind.meaning] for name, kind in ROAD_TYPES.items()]
    )


def groups() -> str:
    """Return the Markdown table of the groups of indicators that an observation may name."""
    rows = [
        [f"`{group}`", ", ".join(f"`{name}`" for name in names)] for group, names in GROUPS.items()
    ]
    return table(["group", "indicators"], rows)


def settings_list() -> str:
    """Return all settings in Markdown: a heading, a meaning and a table for each section."""
    lines = []
    for name in SECTIONS:
        rows = [
            (f"`{s.key}`", f"`{written(s.default)}`", s.unit, s.allowed, s.meaning, s.source)
            for s in settings(Config(), name)
        ]
        heading = ["key", "default", "unit", "allowed", "meaning", "source"]
        lines += [f"## {name}", "", section_meaning(name), "", table(heading, rows), ""]
    return "\n".join(lines)


def help_of_each_verb() -> str:
    """Return the help of `drl-av` and of each of its verbs, in Markdown."""
    parser = command_line()
    [verbs] = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    lines = block(parser)
    for name, own in verbs.choices.items():
        lines += ["", f"## {name}", "", *block(own)]
    return "\n".join(lines)


def block(parser: argparse.ArgumentParser) -> list[str]:
    """Return a parser's help as the lines of a Markdown code block."""
    return ["```text", parser.format_help().rstrip(), "```"]


def example(name: str) -> str:
    """Return the text of a file of EXAMPLES."""
    return (EXAMPLES / name).read_text(encoding="utf-8").rstrip()


MACROS: tuple[Callable[..., str], ...] = (
    actions,
    example,
    exported,
    groups,
    help_of_each_verb,
    indicators,
    kinds,
    settings_list,
)


def define_env(env: Any) -> None:
    """Give the functions of MACROS to the pages; the generator calls this."""
    for function in MACROS:
        env.macro(function)
