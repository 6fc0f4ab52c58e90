"""The same gaits on the same robots in our two engines and in MuJoCo. Started by run.sh, which builds what it needs."""

import argparse
import itertools
import json
import platform
import statistics
import sys
from pathlib import Path

import mujoco

import check
from measure import pose_errors, rank_agreement
from ours import Ours
from theirs import Theirs

# Steps a second x substeps, and (cone, step in s); each engine's first entry is what the others are measured against.
OUR_SETTINGS = {
    "rapier": {
        "paper": ["480x8", "240x8", "240x4", "60x16", "60x8", "30x16", "30x8"],
        "real": ["960x8", "480x8", "240x8", "120x16", "60x16", "60x8"],
    },
    "lockstep": {
        "paper": ["1600x4-lockstep", "800x4-lockstep", "400x2-lockstep", "200x2-lockstep", "200x1-lockstep"],
        "real": ["4800x4-lockstep", "2400x4-lockstep", "1200x2-lockstep", "600x2-lockstep"],
    },
}
# The lockstep engine simulates gaits side by side: fewer than this in a timed run say nothing of its speed.
LEAST_SIDE_BY_SIDE = 64
STEPS = {
    "paper": {"elliptic": (0.0005, 0.001, 0.002, 0.005, 0.01), "pyramidal": (0.005, 0.01)},
    "real": {"elliptic": (0.00025, 0.0005, 0.001, 0.002, 0.005), "pyramidal": (0.002, 0.005)},
}
THEIR_SETTINGS = {scale: [(c, s) for c, steps in cones.items() for s in steps] for scale, cones in STEPS.items()}


def arguments():
    parser = argparse.ArgumentParser(prog="tests/peers/run.sh", description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", metavar="ROBOT",
                        help="robots that ship, NAME:VARIANT with failed modules, random:INDEX for a random tree of 4 to 16 "
                             "hinges [default: quadropod lizard]")
    parser.add_argument("--brief", action="store_true", help="only each engine's default and its finest setting")
    parser.add_argument("--quick", action="store_true", help="only check that all engines have the same robots")
    parser.add_argument("--gaits", type=int, help="random gaits a robot [default: 100; quick: 16]")
    parser.add_argument("--seed", type=int, default=1, help="where they come from [default: 1]")
    parser.add_argument("--duration", type=float, help="length of a gait, s [default: 10; quick: 4]")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each setting [default: 5]")
    parser.add_argument("--timed", type=int, default=10, help="gaits in a timed run [default: 10]")
    parser.add_argument("--real", action="store_true", help="modules of 0.105 m instead of 1 m")
    parser.add_argument("--out", type=Path, help="folder for peers.json and peers.md [default: target/peers]")
    for hidden in ("--evogait", "--rollouts", "--work"):
        parser.add_argument(hidden, required=True, help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.robots = given.robots or ["quadropod", "lizard"]
    given.gaits = given.gaits or (16 if given.quick else 100)
    given.duration = given.duration or (4.0 if given.quick else 10.0)
    given.timed = min(given.timed, given.gaits)
    given.out = given.out or Path(given.work)
    return given


def label(setting):
    if isinstance(setting, str):
        return setting.removesuffix("-lockstep").replace("x", " × ")
    cone, step = setting
    return f"{cone} {1000 * step:g} ms"


def note(text):
    print(text, file=sys.stderr, flush=True)


def compare(given, robot):
    ours = Ours(given, robot)
    facts = ours.facts()
    theirs = Theirs(ours.export("mjcf"), facts)
    scale = facts["scale"]
    engines = {name: (ours.run, settings[scale], facts["default_settings"][name])
               for name, settings in OUR_SETTINGS.items()}
    engines["MuJoCo"] = (theirs.run, THEIR_SETTINGS[scale], theirs.default)
    timed_gaits = {name: given.timed for name in engines}
    timed_gaits["lockstep"] = min(given.gaits, max(given.timed, LEAST_SIDE_BY_SIDE))
    rows, ends, tasks = [], {}, []
    for engine, (run, settings, default) in engines.items():
        settings = settings if default in settings else [*settings, default]
        settings = [settings[0], default] if given.brief else settings
        for setting in settings:
            note(f"{robot}: {engine} {label(setting)}, {given.gaits} gaits of {given.duration:g} s")
            ends[engine, setting] = run(setting, given.gaits)
            tasks.append((engine, setting, run))
        for setting in settings:
            reference, own = ends[engine, settings[0]], ends[engine, setting]
            row = {"robot": robot, "engine": engine, "setting": label(setting), "default": setting == default}
            row |= {"reference": setting == settings[0]} | rank_agreement(reference, own) | pose_errors(reference, own)
            rows.append(row)
    note(f"{robot}: speeds, {given.repeats} times {given.timed} gaits of each setting, engines in turn")
    speeds = {}
    for _ in range(given.repeats):
        for engine, setting, run in tasks:
            timed = run(setting, timed_gaits[engine])
            speeds.setdefault((engine, label(setting)), []).append(timed.simulated / timed.wall)
    for row in rows:
        own = speeds[row["engine"], row["setting"]]
        row["speed"] = {"median": statistics.median(own), "least": min(own), "most": max(own)}

    chosen = [(engine, default) for engine, (_, _, default) in engines.items()]
    finest = [(engine, settings[0]) for engine, (_, settings, _) in engines.items()]
    between = []
    for what, settings in (("defaults", chosen), ("references", finest)):
        for a, b in itertools.combinations(settings, 2):
            pair = {"robot": robot, "what": what, "engines": [f"{engine} {label(setting)}" for engine, setting in (a, b)]}
            between.append(pair | rank_agreement(ends[a], ends[b]) | pose_errors(ends[a], ends[b]))
    return rows, between


def markdown(given, rows, between):
    scale = "real" if given.real else "paper"
    span = lambda r: f"{r['spearman']:.3f} ({r['low']:.3f} to {r['high']:.3f})"
    error = lambda e, digits: f"{e['median']:.{digits}f} / {e['p95']:.{digits}f}"
    lines = [
        f"{given.gaits} random gaits of {given.duration:g} s (seed {given.seed}), scale `{scale}`, from the same "
        f"settled start. Speeds: one core, median of {given.repeats} runs of {given.timed} gaits (lockstep: "
        f"{LEAST_SIDE_BY_SIDE}, side by side), engines in turn. MuJoCo "
        f"{mujoco.mj_versionString()}, integrator implicitfast. Bold: the default.",
        "",
        "Each setting against its engine's own finest one (ref):",
        "",
        "| robot | engine | setting | simulated s / wall s | Spearman of distance (95 %) "
        "| place error, median / 95 %, mu | heading error, median / 95 %, rad |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        name = f"**{r['setting']}**" if r["default"] else r["setting"]
        same = ("ref", "", "") if r["reference"] else (span(r), error(r["place"], 3), error(r["yaw"], 3))
        broken = f", {r['broken']} broken" if r["broken"] else ""
        lines.append(f"| {r['robot']} | {r['engine']} | {name} | {r['speed']['median']:.0f} | {same[0]}{broken} | "
                     f"{same[1]} | {same[2]} |")
    lines += ["", "The engines against each other:", "",
              "| robot | one | other | Spearman of distance (95 %) | place, median / 95 %, mu | heading, rad |",
              "|---|---|---|---|---|---|"]
    for b in between:
        one, other = b["engines"]
        lines.append(f"| {b['robot']} | {one} | {other} | {span(b)} | {error(b['place'], 3)} | "
                     f"{error(b['yaw'], 3)} |")
    return "\n".join(lines) + "\n"


def brief(given, rows, between):
    """A line a robot: speed and fidelity of the defaults, and the rank agreement of the finest settings two by two."""
    engines = list(dict.fromkeys(r["engine"] for r in rows))
    lines = [
        f"{given.gaits} random gaits of {given.duration:g} s (seed {given.seed}), scale `{'real' if given.real else 'paper'}`. "
        "Default settings: simulated s / wall s, Spearman of the distance with the engine's own finest setting, median error "
        "of place in mu. Agreement: Spearman between the engines' finest settings, and between their defaults.",
        "",
        "| robot | " + " | ".join(f"{e}: speed, Spearman, place" for e in engines) + " | "
        + " | ".join(f"{a}, {b}" for a, b in itertools.combinations(engines, 2)) + " |",
        "|" + "---|" * (1 + len(engines) + len(engines) * (len(engines) - 1) // 2),
    ]
    for robot in dict.fromkeys(r["robot"] for r in rows):
        cells = [robot]
        for row in (r for r in rows if r["robot"] == robot and r["default"]):
            broken = f", {row['broken']} broken" if row["broken"] else ""
            cells.append(f"{row['speed']['median']:.0f}, {row['spearman']:.3f}, {row['place']['median']:.3f}{broken}")
        pairs = [b for b in between if b["robot"] == robot]
        fine = (b["spearman"] for b in pairs if b["what"] == "references")
        coarse = (b["spearman"] for b in pairs if b["what"] == "defaults")
        cells += [f"{a:.3f}, {b:.3f}" for a, b in zip(fine, coarse)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.quick:
        sys.exit(check.run(given))
    rows, between = [], []
    for robot in given.robots:
        more_rows, more_between = compare(given, robot)
        rows += more_rows
        between += more_between
    text = (brief if given.brief else markdown)(given, rows, between)
    about = {"gaits": given.gaits, "duration": given.duration, "seed": given.seed, "repeats": given.repeats,
             "timed": given.timed, "scale": "real" if given.real else "paper", "mujoco": mujoco.mj_versionString(),
             "python": platform.python_version(), "machine": platform.machine(), "processor": processor()}
    everything = {"about": about, "settings": rows, "agreement": between}
    (given.out / "peers.json").write_text(json.dumps(everything, indent=1))
    (given.out / "peers.md").write_text(text)
    print(text)
    note(f"written: {given.out / 'peers.md'}, {given.out / 'peers.json'}")


def processor():
    try:
        names = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor()


if __name__ == "__main__":
    main()
