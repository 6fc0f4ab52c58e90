"""Do robots that MuJoCo holds still come to rest here, at every heading? Random robots of modules and of boxes."""

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np

STILL = 0.01  # mu/s, as sim-core/src/physics/settle.rs has it
SECONDS = 20.0
FINER = 5  # MuJoCo's steps: as exported, and so many times as many
CHUNK = 5  # robots of one call of our side
KINDS = ("modules", "boxes")


def speed(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Of the fastest centre of mass, mu/s."""
    fastest, six = 0.0, np.empty(6)
    for body in range(1, model.nbody):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, six, 0)
        fastest = max(fastest, float(np.linalg.norm(six[3:])))
    return fastest


def at_rest(mjcf: str, finer: int) -> float:
    """Speed at the end of standing with all motors at 0. A second at almost no speed ends it early."""
    model = mujoco.MjModel.from_xml_string(mjcf)
    model.opt.timestep /= finer
    data = mujoco.MjData(model)
    now, before = np.inf, np.inf
    for _ in range(round(SECONDS)):
        mujoco.mj_step(model, data, nstep=round(1.0 / model.opt.timestep))
        if not np.isfinite(data.qpos).all() or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            return np.inf
        before, now = now, speed(model, data)
        if max(now, before) < STILL / 1000:
            break
    return now


def robots(given, kind: str) -> list[dict]:
    """What our side draws, and MuJoCo's speeds: all headings of a robot together."""

    def some(first):
        count = min(CHUNK, given.first + given.count - first)
        command = [given.standing, kind, str(first), str(count), "--seed", str(given.seed)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)}: {done.stderr}")
        rows = [json.loads(line) for line in done.stdout.splitlines()]
        found = []
        for index in dict.fromkeys(row["index"] for row in rows):
            headings = [row for row in rows if row["index"] == index]
            speeds = [at_rest(headings[0]["mjcf"], finer) for finer in (1, FINER)]
            found.append({"name": f"{kind}-{index}", "headings": headings, "speeds": speeds})
        return found

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        chunks = pool.map(some, range(given.first, given.first + given.count, CHUNK))
        return [robot for chunk in chunks for robot in chunk]


def report(given, kind: str, found: list[dict]) -> bool:
    """Prints a line for each refused robot, and the counts; true if every robot that MuJoCo holds still is accepted."""
    # Some wobble in MuJoCo's exported steps, and stand still in finer ones: still is what finer steps say.
    held = [robot for robot in found if robot["speeds"][1] < STILL]
    print(f"{kind}: MuJoCo holds {sum(r['speeds'][0] < STILL for r in found)} of {len(found)} still as exported, "
          f"{len(held)} in finer steps")
    good = True
    for engine in held[0]["headings"][0]["refused"] if held else ():
        refused = {r["name"]: [h for h in r["headings"] if h["refused"][engine]] for r in held}
        accepted = sum(not headings for headings in refused.values())
        differ = sum(0 < len(headings) < len(held[0]["headings"]) for headings in refused.values())
        for name, headings in refused.items():
            if headings:
                turns = ", ".join(f"{heading['heading']:g}°" for heading in headings)
                print(f"  {name}, {engine}, refused at {turns}: {headings[0]['refused'][engine]}")
        turns = Counter(f"{heading['heading']:g}°" for headings in refused.values() for heading in headings)
        good &= accepted == len(held)
        print(f"{'ok    ' if accepted == len(held) else 'FAILED'}  {kind}, {engine}: of {len(held)} robots that MuJoCo "
              f"holds still, {accepted} are accepted at all headings; of {differ} the verdict depends on the heading "
              f"(refused at: {', '.join(f'{t} {n}' for t, n in turns.items()) or 'none'})", flush=True)
    for robot in found:
        if robot not in held:
            refused = Counter(e for h in robot["headings"] for e, why in h["refused"].items() if why)
            print(f"  {robot['name']} does not come to rest in MuJoCo: {robot['speeds'][0]:.2g} and "
                  f"{robot['speeds'][1]:.2g} mu/s; refused here at {dict(refused) or 'no'} headings")
    save(given, kind, found)
    return good


def save(given, kind: str, found: list[dict]):
    verdicts = open(given.work / f"{kind}.jsonl", "w")
    for robot in found:
        for heading in robot["headings"]:
            verdict = {key: heading[key] for key in ("heading", "refused")}
            verdicts.write(json.dumps({"robot": robot["name"], "speeds": robot["speeds"]} | verdict) + "\n")
            path = given.work / f"{robot['name']}-{heading['heading']:g}"
            path.with_suffix(".toml").write_text(heading["toml"])
            path.with_suffix(".xml").write_text(heading["mjcf"])
    verdicts.close()


def main() -> int:
    parser = argparse.ArgumentParser(prog="tests/peers/run.sh --standing", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=200, help="robots of each kind [default: 200]")
    parser.add_argument("--first", type=int, default=0, help="index of the first [default: 0]")
    parser.add_argument("--seed", type=int, default=1, help="where they come from [default: 1]")
    parser.add_argument("--kind", choices=KINDS, action="append", help="only these [default: both]")
    parser.add_argument("--standing", required=True, help="our side: the built peer_standing")
    parser.add_argument("--work", required=True, type=Path, help="folder for the robots' files")
    given = parser.parse_args()
    given.work = given.work / "standing"
    given.work.mkdir(parents=True, exist_ok=True)
    good = [report(given, kind, robots(given, kind)) for kind in given.kind or KINDS]
    print(f"robots as TOML and MJCF, and all verdicts: {given.work}")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
