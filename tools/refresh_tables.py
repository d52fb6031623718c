"""Write the tables of README.md and docs/results anew: from the CSV files, and from the code.

python tools/refresh_tables.py            rewrite the pages
python tools/refresh_tables.py --check    exit 1 where a page and its sources differ
"""

import argparse
import csv
import json
import math
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from docs_pages import actions, observation

from drl_av.evaluation.statistics import Mean, mean_with_interval
from drl_av.experiments.adaptation import BLOCK
from drl_av.experiments.strictness_figure import change

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
PAGES = (ROOT / "README.md", *sorted(RESULTS.glob("*.md")))
MOST_VEHICLES = 30
ADAPTED_BY = 10_000
"""Episodes of the adaptation that a row of its table sums up."""
Row = dict[str, str]


def speed_table() -> str:
    """Mean speed of every driver at every density."""
    return pivot(read("evaluation.csv"), "driver", mean_speed)


def summary_table() -> str:
    """Each driver over the densities up to the paper's 30 vehicles; the shipped one also strict."""
    strict = [row for row in read("strict.csv") if not row["bound"] and row["check"] == "strict"]
    driven: dict[tuple[str, str], list[Row]] = {}
    for row in read("evaluation.csv"):
        if int(row["vehicles"]) <= MOST_VEHICLES:
            driven.setdefault((row["driver"], row["safety_check"]), []).append(row)
    driven["pretrained", "strict"] = strict
    names = ("driver", "safety check", "mean speed, m/s", "reward per decision", "ego hit")
    lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
    for (driver, check), rows in sorted(driven.items(), key=lambda of: of[0][0] != "pretrained"):
        rewards = [float(row["mean_reward"]) for row in rows if "mean_reward" in row]
        reward = f"{mean_with_interval(rewards).value:.3f}" if rewards else "not recorded"
        hits = f"{count(rows, 'ego_hit')} of {len(rows)}"
        lines.append(f"| `{driver}` | `{check}` | {mean_speed(rows)} | {reward} | {hits} |")
    return "\n".join(lines)


def collision_table() -> str:
    """Episodes in which the ego hit something / was hit."""
    return pivot(read("evaluation.csv"), "driver", collisions)


def driving_table() -> str:
    """How the shipped driver drives, by density and over those up to the paper's 30 vehicles."""
    driven = [row for row in read("evaluation.csv") if row["driver"] == "pretrained"]
    densities = sorted({int(row["vehicles"]) for row in driven})
    columns = [[r for r in driven if int(r["vehicles"]) == density] for density in densities]
    columns.append([r for r in driven if int(r["vehicles"]) <= MOST_VEHICLES])

    def line(name: str, value: Callable[[Row], float], digits: int) -> str:
        means = (mean_with_interval(map(value, rows)).value for rows in columns)
        return f"| {name} | " + " | ".join(f"{mean:.{digits}f}" for mean in means) + " |"

    lines = [
        "| vehicles | " + " | ".join(map(str, densities)) + f" | up to {MOST_VEHICLES} |",
        "|" + " --- |" * (len(columns) + 1),
        line("reward per decision", lambda row: float(row["mean_reward"]), 3),
        line("r_v", lambda row: float(row["mean_r_v"]), 3),
        line("r_y", lambda row: float(row["mean_r_y"]), 3),
        line("r_x", lambda row: float(row["mean_r_x"]), 3),
        line("closer than d_safe, %", share_closer, 1),
        line("lane changes", lambda row: float(row["lane_changes"]), 1),
        line("aborted lane changes", lambda row: float(row["aborted_lane_changes"]), 1),
    ]
    return "\n".join(lines)


def share_closer(row: Row) -> float:
    """Decisions after which the vehicle ahead is closer than d_safe, percent."""
    return 100 * int(row["d_safe_violations"]) / int(row["decisions"])


def reference_table() -> str:
    """What each driver does with the numbers of the paper's actions, and otherwise."""
    tables = {
        "the paper's accelerations": read("evaluation.csv"),
        "the same, v_des exact": read("exact_speed.csv"),
        "`acc` as reference": read("reference_acc.csv"),
    }
    names = ("driver", "settings", "reward per decision", "r_v")
    names += ("closer than d_safe, %", "mean speed, m/s", "ego hit something")
    lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
    for driver in dict.fromkeys(row["driver"] for rows in tables.values() for row in rows):
        for settings, rows in tables.items():
            own = [
                row
                for row in rows
                if row["driver"] == driver and int(row["vehicles"]) <= MOST_VEHICLES
            ]
            if not own:
                continue
            reward, r_v = (
                mean_with_interval(float(row[name]) for row in own).value
                for name in ("mean_reward", "mean_r_v")
            )
            nearer = mean_with_interval(map(share_closer, own)).value
            lines.append(
                f"| `{driver}` | {settings} | {reward:.3f} | {r_v:.3f} | {nearer:.1f} "
                f"| {mean_speed(own)} | {count(own, 'ego_hit')} of {len(own)} |"
            )
    return "\n".join(lines)


def barricade_table() -> str:
    """How the shipped driver drives beside a closed lane, and on the open road."""
    tables = {"closed": read("barricade_pretrained.csv"), "open": read("evaluation.csv")}
    lines = [
        "| right lane | episodes | ego hit something | was hit | mean speed, m/s |",
        "|" + " --- |" * 5,
    ]
    densities = {row["vehicles"] for row in tables["closed"]}
    for lane, rows in tables.items():
        own = [r for r in rows if r["driver"] == "pretrained" and r["vehicles"] in densities]
        hits, hit = count(own, "ego_hit"), count(own, "collided") - count(own, "ego_hit")
        lines.append(f"| {lane} | {len(own)} | {hits} | {hit} | {mean_speed(own)} |")
    return "\n".join(lines)


def check_table() -> str:
    """Drivers with the check and without it, over the densities of those tables."""
    rows = read("check_paper.csv") + read("check_permit_all.csv")
    densities = {row["vehicles"] for row in rows}
    rows += [
        row
        for row in read("evaluation.csv")
        if row["driver"] == "idm-sumo" and row["vehicles"] in densities
    ]
    lines = [
        "| driver | check | episodes | ego hit something | was hit | mean speed, m/s |",
        "|" + " --- |" * 6,
    ]
    for driver, check in sorted({(row["driver"], row["safety_check"]) for row in rows}):
        own = [r for r in rows if (r["driver"], r["safety_check"]) == (driver, check)]
        hits, hit = count(own, "ego_hit"), count(own, "collided") - count(own, "ego_hit")
        lines.append(
            f"| `{driver}` | `{check}` | {len(own)} | {hits} | {hit} | {mean_speed(own)} |"
        )
    return "\n".join(lines)


def gain_table() -> str:
    """What the shipped driver gains on each baseline in the same traffic; the best one in bold."""
    rows = read("paired.csv")
    densities = sorted({int(row["vehicles"]) for row in rows})
    lines = [
        "| vehicles | " + " | ".join(map(str, densities)) + " |",
        "|" + " --- |" * (len(densities) + 1),
    ]
    for baseline in dict.fromkeys(row["baseline"] for row in rows):
        cells = [gain(row) for row in rows if row["baseline"] == baseline]
        lines.append(f"| over `{baseline}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def gain(row: Row) -> str:
    """A paired difference in m/s, and half of its 95 % interval."""
    told = str(Mean(float(row["difference_m_s"]), float(row["ci95_half_width_m_s"])))
    return f"**{told}**" if row["best"] == "True" else told


def convergence_table() -> str:
    """Where the learning curves end, and since when they are near it."""
    columns = {
        "reward per decision": ("reward", 3),
        "mean speed, m/s": ("mean_speed_m_s", 2),
        "collisions per episode": ("collisions_an_episode", 2),
        "reward while exploring": ("training_reward", 3),
        "collisions while exploring": ("training_collisions_an_episode", 2),
    }
    names = ("training", "seeds", "converged at episode", *columns)
    lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
    for row in read("convergence.csv"):
        cells = [f"`{row['variant']}`", row["seeds"], f"{row['converged_at']} of {row['episodes']}"]
        for name, digits in columns.values():
            half_width = float(row[f"{name}_ci95"])
            interval = f" ± {half_width:.{digits}f}" if math.isfinite(half_width) else ""
            cells.append(f"{float(row[name]):.{digits}f}{interval}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def cost_table() -> str:
    """What the paper's 200 trainings of each kind would take, at the pace of our whole ones."""
    seconds = json.loads((RESULTS / "curves.json").read_text(encoding="utf-8"))["wall_time_s"]
    episodes: dict[str, dict[str, int]] = {}
    for row in read("curves.csv"):
        own = episodes.setdefault(row["variant"], {})
        own[row["seed"]] = max(own.get(row["seed"], 0), int(row["episode"]))
    lines = [
        "| training | seconds an episode | 200 seeds, core hours | 2 cores | 200 cores |",
        "|" + " --- |" * 5,
    ]
    for variant, own in episodes.items():
        longest = max(own.values())
        whole = [seconds[f"{variant}-{seed}"] for seed, n in own.items() if n == longest]
        an_episode_s = sum(whole) / len(whole) / longest
        hours = an_episode_s * 10_000 * 200 / 3600
        lines.append(
            f"| `{variant}` | {an_episode_s:.2f} | {hours:,.0f} "
            f"| {hours / 2 / 24:.1f} days | {hours / 200:.1f} hours |"
        )
    return "\n".join(lines)


def ends_table() -> str:
    """What the trainings of the curves end in: mean over the drivers of the mean of each."""
    rows = read("ends.csv")
    columns: dict[str, tuple[Callable[[Row], float], int]] = {
        "reward per decision": (lambda row: float(row["mean_reward"]), 3),
        "mean speed, m/s": (lambda row: float(row["mean_speed_m_s"]), 2),
        "collisions per episode": (lambda row: row["collided"] == "True", 3),
        "ego hit something": (lambda row: row["ego_hit"] == "True", 3),
    }
    names = ("training", "drivers", "episodes of each", *columns)
    lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
    trainings = list(dict.fromkeys(row["training"] for row in rows))
    driven = {name: [row for row in rows if row["training"] == name] for name in trainings}
    for variant in dict.fromkeys(name.rpartition("-")[0] for name in trainings):
        own = [driven[name] for name in trainings if name.rpartition("-")[0] == variant]
        cells = [f"`{variant}`", str(len(own)), str(len(own[0]))]
        for value, digits in columns.values():
            mean = mean_with_interval(mean_with_interval(map(value, rows)).value for rows in own)
            cells.append(f"{mean.value:.{digits}f} ± {mean.half_width:.{digits}f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def fast_table() -> str:
    """The preset ``fast`` on every seed, and what it gains on the first: the whole schedule."""
    seconds = json.loads((RESULTS / "fast.json").read_text(encoding="utf-8"))["wall_time_s"]
    rows = read("fast.csv")
    trainings = list(dict.fromkeys(row["training"] for row in rows))
    driven = {name: [row for row in rows if row["training"] == name] for name in trainings}
    names = ("training", "seconds", "ego hit something", "reward per decision", "gain")
    names += ("mean speed, m/s", "gain")
    lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
    for name, own in driven.items():
        cells = [f"`{name}`", f"{seconds[name]:,.0f}", f"{count(own, 'ego_hit')} of {len(own)}"]
        for column, digits in (("mean_reward", 3), ("mean_speed_m_s", 2)):
            here, there = (
                [float(row[column]) for row in side] for side in (own, driven[trainings[0]])
            )
            gain = mean_with_interval(a - b for a, b in zip(here, there, strict=True))
            for mean in (mean_with_interval(here), gain):
                cells.append(f"{mean.value:.{digits}f} ± {mean.half_width:.{digits}f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def adaptation_table() -> str:
    """The driver that goes on learning and the one that does not, as far as both are driven."""
    rows = read("adaptation.csv")
    last = {row["variant"]: int(row["episode"]) for row in rows}
    lines = [
        "| learning | episodes | safety triggers an episode | reward per decision "
        "| ego hit something | was hit |",
        "|" + " --- |" * 6,
    ]
    for begin in range(0, min(last.values()), ADAPTED_BY):
        end = min(begin + ADAPTED_BY, *last.values())
        for variant, learning in (("adaptation", "on"), ("no_adaptation", "off")):
            own = [r for r in rows if r["variant"] == variant and begin < int(r["episode"]) <= end]
            triggers, reward = (
                mean_with_interval(float(row[f"training_{name}"]) for row in own)
                for name in ("safety_triggers", "reward")
            )
            hits, collided = (
                sum(round(BLOCK * float(row[f"training_{name}"])) for row in own)
                for name in ("ego_hits", "collisions")
            )
            lines.append(
                f"| {learning} | {begin + 1:,} to {end:,} "
                f"| {triggers.value:.4f} ± {triggers.half_width:.4f} "
                f"| {reward.value:.4f} ± {reward.half_width:.4f} | {hits} | {collided - hits} |"
            )
    return "\n".join(lines)


def strict_table() -> str:
    """What the check ``strict`` changes in the shipped driver's mean speed, percent."""
    rows = [row for row in read("strict.csv") if not row["bound"]]
    densities = sorted({int(row["vehicles"]) for row in rows})
    lines = [
        "| vehicles | " + " | ".join(map(str, densities)) + " |",
        "|" + " --- |" * (len(densities) + 1),
        "| change, % | " + " | ".join(str(change(rows, rows, n)) for n in densities) + " |",
    ]
    cells = [
        collisions([r for r in rows if r["check"] == "strict" and int(r["vehicles"]) == density])
        for density in densities
    ]
    return "\n".join([*lines, "| collisions | " + " | ".join(cells) + " |"])


TABLES = {
    "observation": observation,
    "actions": actions,
    "summary": summary_table,
    "speed": speed_table,
    "driving": driving_table,
    "collisions": collision_table,
    "check": check_table,
}
WITH_RESULTS = {
    "gain": ("paired.csv", gain_table),
    "barricade": ("barricade_pretrained.csv", barricade_table),
    "reference": ("exact_speed.csv", reference_table),
    "convergence": ("convergence.csv", convergence_table),
    "cost": ("curves.csv", cost_table),
    "ends": ("ends.csv", ends_table),
    "fast": ("fast.csv", fast_table),
    "adaptation": ("adaptation.csv", adaptation_table),
    "strict": ("strict.csv", strict_table),
}
"""Those that a page has as soon as their results are there."""
TABLES |= {name: table for name, (file, table) in WITH_RESULTS.items() if (RESULTS / file).exists()}


def pivot(rows: list[Row], column: str, cell: Callable[[list[Row]], str]) -> str:
    """A row a driver, a column a density."""
    densities = sorted({int(row["vehicles"]) for row in rows})
    lines = [
        "| vehicles | " + " | ".join(map(str, densities)) + " |",
        "|" + " --- |" * (len(densities) + 1),
    ]
    for driver in dict.fromkeys(row[column] for row in rows):
        cells = [
            cell([r for r in rows if r[column] == driver and int(r["vehicles"]) == density])
            for density in densities
        ]
        lines.append(f"| `{driver}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def mean_speed(rows: Iterable[Row]) -> str:
    """Mean and half-width of the 95 % interval."""
    mean: Mean = mean_with_interval(float(row["mean_speed_m_s"]) for row in rows)
    return str(mean)


def collisions(rows: list[Row]) -> str:
    """Hit something / was hit, of so many episodes."""
    hits = count(rows, "ego_hit")
    return f"{hits} / {count(rows, 'collided') - hits} of {len(rows)}"


def count(rows: Iterable[Row], column: str) -> int:
    """Rows in which a column is true."""
    return sum(row[column] == "True" for row in rows)


def read(name: str) -> list[Row]:
    """Rows of a results file."""
    with (RESULTS / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def refreshed(text: str) -> str:
    """A page with every table between its marks made anew."""
    return re.sub(
        r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)",
        lambda marks: f"{marks[1]}{TABLES[marks[2]]()}\n{marks[3]}",
        text,
        flags=re.DOTALL,
    )


def main() -> int:
    """Rewrite or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare only")
    texts = {page: page.read_text(encoding="utf-8") for page in PAGES}
    shown = set(re.findall(r"<!-- table: (\w+) -->", "".join(texts.values())))
    if missing := set(TABLES) - shown:
        raise SystemExit(f"No page has a place for the tables: {', '.join(sorted(missing))}.")
    changed = {page: new for page, text in texts.items() if (new := refreshed(text)) != text}
    if parser.parse_args().check:
        return int(bool(changed))
    for page, text in changed.items():
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
