"""The fences: which room may look into which, and what an import may load."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from programs import python

PACKAGE = Path(__file__).parent.parent / "drl_av"
ROOMS = (
    *("errors", "arrays", "compiled", "random_streams", "sumo_programs", "config", "files", "road"),
    *("driving", "safety", "scenarios", "simulation", "drivers", "twin", "drawing", "env"),
    *("learning", "evaluation", "cli", "__main__"),
)
"""Each may import itself and those before it."""
ONLY_IN = {
    "libsumo": {"simulation"},
    "traci": {"simulation", "sumo_programs"},
    "sumolib": {"scenarios", "sumo_programs"},
    "torch": {"learning"},
    "safetensors": {"drivers"},
    "pandas": {"evaluation"},  # in Results.to_pandas alone
    "matplotlib": {"evaluation"},
}


@cache
def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ("drl_av", *path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path) -> set[str]:
    """What a module imports anywhere, inside functions too: its statements and its importlib."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively: say drl_av"
            names.add(str(node.module))
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and "import_module" in ast.unparse(node.func):
            names.update(str(argument.value) for argument in node.args if is_text(argument))
    return names


def is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


@cache
def graph() -> dict[str, set[str]]:
    """Which modules of the package each of them imports."""
    return {name: (imported(path) & set(modules())) - {name} for name, path in modules().items()}


def room(module: str) -> int:
    """Place of a module's room from left to right."""
    name = module.split(".")[1]
    assert name in ROOMS, f"{module} is in no room: name its place in ROOMS"
    return ROOMS.index(name)


def test_the_graph_sees_what_is_there() -> None:
    # were it empty, every fence would stand
    assert "drl_av.simulation.simulation" in graph()["drl_av.env.episode_start"]
    assert "drl_av.safety.paper" in graph()["drl_av.drivers.rule_based"]
    assert "drl_av.learning.run_folder" in graph()["drl_av.cli.learning"]  # inside a function
    assert "torch" in imported(modules()["drl_av.learning.learner"])
    assert len(modules()) > 35


def test_what_lies_beside_the_package_is_not_imported_from_within() -> None:
    beside = {"studies", "verification", "tools"}
    for module, path in modules().items():
        assert not {name.split(".")[0] for name in imported(path)} & beside, module


def test_no_import_cycle() -> None:
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        pytest.fail(f"modules import each other: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("module", sorted(set(modules()) - {"drl_av"}))
def test_a_room_imports_only_from_rooms_to_its_left(module: str) -> None:
    wrong = {other for other in graph()[module] - {"drl_av"} if room(other) > room(module)}
    assert not wrong


def test_the_package_itself_imports_rooms_for_its_public_names_only() -> None:
    # for type checkers at the top, and at the first use
    assert graph()["drl_av"] == {
        "drl_av.drivers.registry",
        "drl_av.env.attach",
        "drl_av.env.video",
        "drl_av.evaluation.evaluate",
        "drl_av.evaluation.trajectories",
        "drl_av.learning.train",
    }
    program = "import drl_av, sys; print([name for name in sys.modules if 'drl_av.' in name])"
    done = python("-c", program)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_is_touched_in_its_own_room_only(library: str) -> None:
    users = set()
    for module, path in modules().items():
        if any(name.split(".")[0] == library for name in imported(path)):
            users.add(module.split(".")[1])
    assert users <= ONLY_IN[library]


def test_a_room_names_sumo_modules_in_strings_only_where_it_may_import_them() -> None:
    for module, path in modules().items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        words = {node.value for node in ast.walk(tree) if is_text(node)}  # type: ignore[arg-type]
        for library in words & {"libsumo", "traci", "sumolib"}:
            assert module.split(".")[1] in ONLY_IN[str(library)], module


@pytest.mark.parametrize("pure", ["road", "driving", "safety"])
def test_a_pure_room_never_reaches_scenarios_or_simulation(pure: str) -> None:
    for module in modules():
        if module.startswith(f"drl_av.{pure}."):
            effects = ("drl_av.simulation", "drl_av.scenarios")
            assert not {other for other in reached(module) if other.startswith(effects)}, module


EFFECTS = {
    *("libsumo", "traci", "sumolib", "sumo", "torch", "safetensors", "matplotlib", "gymnasium"),
    *("subprocess", "multiprocessing", "ctypes", "socket", "xml", "os", "shutil", "tempfile"),
}


def reached(module: str) -> set[str]:
    """A module, what it imports, and so on to the end; with the packages that these lie in."""
    found, left = set(), {module}
    while left:
        name = left.pop()
        found.add(name)
        parents = {name.rpartition(".")[0]} & set(modules()) - {"drl_av"}
        left |= (graph()[name] | parents) - found
    return found


@pytest.mark.parametrize("folder", ["road", "driving", "safety"])
def test_a_pure_folder_reaches_no_effect_through_whatever_it_imports(folder: str) -> None:
    for module in modules():
        if module.startswith(f"drl_av.{folder}"):
            for other in reached(module):
                wrong = {name.split(".")[0] for name in imported(modules()[other])} & EFFECTS
                assert not wrong, f"{module} reaches {wrong} through {other}"


def test_what_a_module_reaches_is_followed_to_its_end() -> None:
    # env.highway -> traffic.simulation -> traffic.connection, which starts programs
    assert "drl_av.simulation.start_sumo" in reached("drl_av.env.rollout")
    assert "subprocess" in imported(modules()["drl_av.simulation.start_sumo"])


def test_no_cycle_between_folders() -> None:
    folders: dict[str, set[str]] = {}
    for module, others in graph().items():
        if module == "drl_av.scenarios.road_types":
            continue  # a registry names what lies in the folders of its room
        own = folders.setdefault(folder_of(module), set())
        own |= {folder_of(other) for other in others} - {folder_of(module)}
    try:
        TopologicalSorter(folders).prepare()
    except CycleError as error:
        pytest.fail(f"folders import each other: {' -> '.join(error.args[1])}")


def folder_of(module: str) -> str:
    """The folder that a module lies in; a module beside the folders stands for itself."""
    folder = modules()[module].parent
    return module if folder == PACKAGE else str(folder.relative_to(PACKAGE))


def test_learning_uses_one_private_function_of_torch_and_works_without_it() -> None:
    private = re.compile(r"""\btorch(?:\.\w+)*\._\w+|getattr\(torch[^)]*["']_\w+["'][^)]*\)""")
    found = [
        match
        for module, path in modules().items()
        if module.startswith("drl_av.learning")
        for match in private.findall(path.read_text(encoding="utf-8"))
    ]
    assert found == ['getattr(torch, "_fused_adam_", None)']  # None where torch has it no more


def test_no_room_is_a_drawer() -> None:
    names = {part for module in modules() for part in module.split(".")}
    assert not names & {"utils", "util", "common", "helpers", "helper", "manager", "misc", "parts"}


@pytest.mark.parametrize("module", sorted(modules()))
def test_a_module_can_be_held_whole(module: str) -> None:
    assert len(modules()[module].read_text(encoding="utf-8").splitlines()) <= 400


@pytest.mark.parametrize("module", modules())
def test_a_module_says_in_its_first_line_what_it_is(module: str) -> None:
    text = modules()[module].read_text(encoding="utf-8")
    if text:
        assert ast.get_docstring(ast.parse(text))
    if module.startswith(("drl_av.road", "drl_av.simulation", "drl_av.driving")):
        assert not re.search(r"\bprint\(", text)


OF_OTHERS = {"clone_state", "ego_is_comfortable", "sha256sum"}
"""Names in docstrings that belong to other projects: ALE, nuPlan and coreutils."""


def test_a_name_that_a_docstring_quotes_exists() -> None:
    root, words, quoted = PACKAGE.parent, set(OF_OTHERS), set()
    for folder in ("drl_av", "studies", "verification"):
        for file in (root / folder).rglob("*.py"):
            source = file.read_text(encoding="utf-8")
            tree = ast.parse(source)
            docs = [
                node.value.value
                for node in ast.walk(tree)
                if isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ]
            for text in docs:
                source = source.replace(text, "")
                quoted |= {
                    (file.name, word)
                    for name in re.findall(r"``([\w./]+)(?:\(\))?``", text)
                    for word in re.findall(r"\w+", name)
                }
            words |= {*re.findall(r"\w+", source), *file.relative_to(root).with_suffix("").parts}
    words |= {"py", "txt", "md"} | {file.stem for file in (root / "docs").rglob("*")}
    assert ("description.py", "read_route") in quoted
    assert not {(file, word) for file, word in quoted if word not in words}


HEAVY = ("libsumo", "traci", "sumolib", "torch", "matplotlib", "stable_baselines3", "numba")


@pytest.mark.parametrize(
    "statement",
    [
        "import drl_av",
        "import drl_av.cli",
        "import drl_av.cli; drl_av.cli.main(['--help'])",
        "import drl_av.cli; drl_av.cli.main(['train', '--help'])",
        "import drl_av.env",
        "import drl_av.safety.paper, drl_av.drivers.rule_based",
    ],
)
def test_importing_and_help_load_neither_sumo_nor_torch(statement: str) -> None:
    program = f"""
import os, sys
import gymnasium
before = dict(os.environ), list(sys.path)
try:
    {statement}
except SystemExit as end:
    assert end.code == 0, end.code
assert (dict(os.environ), list(sys.path)) == before, "an import changed the surroundings"
print("loaded:", *[name for name in {HEAVY} if name in sys.modules])
"""
    done = python("-c", program)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "loaded:"
