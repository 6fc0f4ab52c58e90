"""Does an import have the robot that MuJoCo has? Random MJCF files of what is supported, compiled by both.

Compared at a random configuration, in the world: poses of all bodies, hinges, masses, the mass matrix, and shapes."""

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np

from random_mjcf import FEATURES, Generator

TOLERANCE = 1e-6  # relative to the largest entry of what is compared
SIZES = (2, 3, 4, 6, 8, 12, 16, 64)  # bodies of a file
BOX, CAPSULE = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CAPSULE
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def matrix(quaternion):
    """Of w, x, y, z."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.array(quaternion) / np.linalg.norm(quaternion))
    return turn.reshape(3, 3)


def about(axis, angle):
    half = angle / 2
    return matrix([np.cos(half), *(np.sin(half) * np.array(axis) / np.linalg.norm(axis))])


def shift(mass, arm):
    """What a mass adds to the inertia about a point that is an arm away."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


class Solids:
    """What collides on a body: boxes as their corners, capsules as their ends and radius."""

    def __init__(self):
        self.boxes, self.capsules = [], []

    def box(self, center, turn, half):
        self.boxes.append(center + (CORNERS * half) @ turn.T)

    def capsule(self, ends, radius):
        self.capsules.append((np.array(ends), radius))


class Group:
    """Bodies that never move against each other."""

    def __init__(self, mass, center, inertia, solids, hinge=None):
        self.mass, self.center, self.inertia, self.solids, self.hinge = mass, center, inertia, solids, hinge


class Theirs:
    """MuJoCo's robot, welded bodies joined. Group 0 has the free joint; each of the others has a hinge."""

    def __init__(self, text: str):
        self.model = model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(model)
        free = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
        assert len(free) == 1
        self.free = free[0]
        root = model.jnt_bodyid[self.free]
        self.members, self.parents, of = [], [], {}
        for body in range(1, model.nbody):
            if body == root or (model.body_jntnum[body] and model.body_parentid[body] in of):
                self.parents.append(of.get(model.body_parentid[body]))
                self.members.append([body])
                of[body] = len(self.members) - 1
            elif model.body_parentid[body] in of:
                of[body] = of[model.body_parentid[body]]
                self.members[of[body]].append(body)
        self.hinges = [model.body_jntadr[members[0]] for members in self.members[1:]]
        self.of = of
        mujoco.mj_fwdPosition(model, self.data)
        self.neutral = self.data.xpos.copy(), self.data.xmat.reshape(-1, 3, 3).copy()

    def fits(self) -> bool:
        """Whether anything collides, and bodies that share no hinge are apart in the neutral configuration."""
        model, geoms = self.model, []
        for geom in range(model.ngeom):
            if model.geom_bodyid[geom] in self.of and model.geom_contype[geom]:
                geoms.append((self.of[model.geom_bodyid[geom]], self.data.geom_xpos[geom], model.geom_rbound[geom]))
        neighbours = lambda a, b: a == b or self.parents[a] == b or self.parents[b] == a
        return bool(geoms) and all(neighbours(a, b) or np.linalg.norm(p - q) > r + s
                                   for (a, p, r), (b, q, s) in itertools.combinations(geoms, 2))

    def move(self, angles):
        self.data.qpos[:] = self.model.qpos0
        for joint, angle in zip(self.hinges, angles):
            self.data.qpos[self.model.jnt_qposadr[joint]] += angle
        mujoco.mj_fwdPosition(self.model, self.data)

    def groups(self) -> list[Group]:
        model, data, found = self.model, self.data, []
        for index, members in enumerate(self.members):
            masses = model.body_mass[members]
            center = masses @ data.xipos[members] / masses.sum() if masses.sum() else data.xpos[members[0]]
            inertia, solids = np.zeros((3, 3)), Solids()
            for body in members:
                turn = data.ximat[body].reshape(3, 3)
                inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
                inertia += shift(model.body_mass[body], data.xipos[body] - center)
                for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
                    if not model.geom_contype[geom]:
                        continue
                    place, turn, size = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom]
                    if model.geom_type[geom] == BOX:
                        solids.box(place, turn, size)
                    else:
                        assert model.geom_type[geom] == CAPSULE
                        solids.capsule([place - turn[:, 2] * size[1], place + turn[:, 2] * size[1]], size[0])
            hinge = None
            if index:
                joint = self.hinges[index - 1]
                hinge = data.xanchor[joint], data.xaxis[joint]
            found.append(Group(masses.sum(), center, inertia, solids, hinge))
        return found

    def mass_matrix(self):
        """Rows: shift of the root, turn about its own axes, hinges in the order of groups."""
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        start = self.model.jnt_dofadr[self.free]
        order = [*range(start, start + 6), *(self.model.jnt_dofadr[joint] for joint in self.hinges)]
        return full[np.ix_(order, order)]

    def label(self, group: int) -> str:
        names = [self.model.body(body).name or f"(body {body})" for body in self.members[group]]
        return "body " + " + ".join(f'"{name}"' for name in names)


class Ours:
    """The imported robot. All frames have the robot's axes in the neutral configuration."""

    def __init__(self, spec: dict):
        bodies = spec["body"]
        at = {body["name"]: i for i, body in enumerate(bodies)}
        hinges = {body["hinge"]["name"] for body in bodies if body.get("hinge")}
        if len(at) < len(bodies) or len(hinges) < len(bodies) - 1:
            raise Different("the robot", "names repeat")
        self.bodies = bodies
        self.parents = [at[b["hinge"]["parent"]] if b.get("hinge") else None for b in bodies]
        self.root = at[spec["pivot"]]

    def order(self, theirs: Theirs) -> list[int]:
        """For each of MuJoCo's groups the body here: in the same tree, what a body carries in the order of the file."""
        carried = lambda parents, i: [k for k, parent in enumerate(parents) if parent == i]
        found = {0: self.root}
        for group in range(len(theirs.members)):
            theirs_there = carried(theirs.parents, group)
            ours_there = carried(self.parents, found[group])
            if len(theirs_there) != len(ours_there):
                counts = f"carries {len(theirs_there)} hinges in MuJoCo, {len(ours_there)} here"
                raise Different(theirs.label(group), counts)
            found |= zip(theirs_there, ours_there)
        return [found[group] for group in range(len(theirs.members))]

    def move(self, order, angles, origin):
        """Poses in the world of bodies in an order in which carriers come first."""
        self.poses = {order[0]: (np.eye(3), np.array(origin))}
        for body, angle in zip(order[1:], angles):
            turn, place = self.poses[self.parents[body]]
            hinge = self.bodies[body]["hinge"]
            self.poses[body] = (turn @ about(hinge["axis"], angle), place + turn @ hinge["anchor"])

    def groups(self, order) -> list[Group]:
        found = []
        for body in order:
            spec, (turn, place) = self.bodies[body], self.poses[body]
            xx, yy, zz, xy, xz, yz = spec["inertia"]
            inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
            solids = Solids()
            for box in spec.get("box", []):
                x, y, z, w = box.get("rotation", (0, 0, 0, 1))
                solids.box(place + turn @ box["center"], turn @ matrix([w, x, y, z]), box["half"])
            for capsule in spec.get("capsule", []):
                solids.capsule([place + turn @ capsule[end] for end in ("from", "to")], capsule["radius"])
            hinge = None
            if body != self.root:
                # The axis is the same in both bodies' frames.
                axis = np.array(spec["hinge"]["axis"])
                hinge = place, turn @ axis / np.linalg.norm(axis)
            found.append(Group(spec["mass"], place + turn @ spec["center_of_mass"], inertia, solids, hinge))
        return found

    def mass_matrix(self, order, groups, theirs: Theirs):
        """In the coordinates of MuJoCo: the root's turn is about the axes of its body there."""
        root = theirs.members[0][0]
        origin, axes = theirs.data.xpos[root], theirs.data.xmat[root].reshape(3, 3)
        size = 6 + len(order) - 1
        total = np.zeros((size, size))
        for index, (body, group) in enumerate(zip(order, groups)):
            linear, angular = np.zeros((3, size)), np.zeros((3, size))
            linear[:, :3] = np.eye(3)
            angular[:, 3:6] = axes
            linear[:, 3:6] = np.cross(axes.T, group.center - origin).T
            while body != self.root:
                anchor, axis = groups[order.index(body)].hinge
                column = 5 + order.index(body)
                angular[:, column], linear[:, column] = axis, np.cross(axis, group.center - anchor)
                body = self.parents[body]
            total += group.mass * linear.T @ linear + angular.T @ group.inertia @ angular
        return total


class Different(Exception):
    """An element, and what differs."""


def near(element, what, theirs, ours, largest=None):
    theirs, ours = np.asarray(theirs, float), np.asarray(ours, float)
    off = float(np.abs(theirs - ours).max())
    largest = max(float(np.abs(theirs).max()), 1e-3) if largest is None else largest
    if not off <= TOLERANCE * largest:
        raise Different(element, f"{what}: MuJoCo {np.round(theirs, 6).tolist()}, here {np.round(ours, 6).tolist()}")


def same_solids(element, theirs: Solids, ours: Solids, reach):
    """Each of theirs has one of ours in the same place, in any order."""
    for what, there, here in (("boxes", theirs.boxes, ours.boxes), ("capsules", theirs.capsules, ours.capsules)):
        if len(there) != len(here):
            raise Different(element, f"collides with {len(there)} {what} in MuJoCo, {len(here)} here")
    cloud = lambda a, b: np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1).max()
    capsule = lambda a, b: max(cloud(a[0], b[0]), cloud(b[0], a[0]), abs(a[1] - b[1]))
    for what, there, here, off in (("box", theirs.boxes, list(ours.boxes), cloud),
                                   ("capsule", theirs.capsules, list(ours.capsules), capsule)):
        for solid in there:
            found = min(range(len(here)), key=lambda i: off(solid, here[i]))
            if off(solid, here[found]) > TOLERANCE * reach:
                raise Different(element, f"a {what} that collides is off by {off(solid, here[found]):.3g} mu")
            here.pop(found)


def compare(theirs: Theirs, spec: dict, angles):
    ours = Ours(spec)
    order = ours.order(theirs)
    theirs.move(angles)
    ours.move(order, angles, theirs.neutral[0][theirs.members[0][0]])
    data, reach = theirs.data, max(1.0, float(np.abs(theirs.data.xpos).max()))
    there, here = theirs.groups(), ours.groups(order)
    for index, (a, b) in enumerate(zip(there, here)):
        element = theirs.label(index)
        if a.hinge:
            near(element, "axis of the hinge", a.hinge[1], b.hinge[1])
            # Any point of the axis is as good as another.
            apart = b.hinge[0] - a.hinge[0]
            near(element, "distance of the hinge's axes", 0, np.linalg.norm(np.cross(apart, a.hinge[1])), reach)
            near(element, "anchor of the hinge", a.hinge[0], b.hinge[0], reach)
        # A point of a body goes where the body here carries it from its place in the neutral configuration.
        turn, place = ours.poses[order[index]]
        origin = neutral_place(ours, order, index, theirs)
        for body in theirs.members[index]:
            before, turned = theirs.neutral[0][body], theirs.neutral[1][body]
            near(element, "rotation", data.xmat[body].reshape(3, 3), turn @ turned, 1.0)
            near(element, "position", data.xpos[body], place + turn @ (before - origin), reach)
        near(element, "mass", a.mass, b.mass)
        near(element, "centre of mass", a.center, b.center, reach)
        near(element, "inertia", a.inertia, b.inertia)
        same_solids(element, a.solids, b.solids, reach)
    near("the robot", "mass matrix", theirs.mass_matrix(), ours.mass_matrix(order, here, theirs))


def neutral_place(ours: Ours, order, index, theirs: Theirs):
    """Origin of a body's frame in the neutral configuration: anchors added up, since no frame is turned."""
    place, body = np.array(theirs.neutral[0][theirs.members[0][0]]), order[index]
    while body != ours.root:
        place = place + ours.bodies[body]["hinge"]["anchor"]
        body = ours.parents[body]
    return place


def draw(seed: int, without=()) -> str:
    """A file that MuJoCo takes, and in which only bodies that share a hinge may overlap."""
    bodies, scale = SIZES[seed % len(SIZES)], 2.0
    for attempt in range(100):
        text = Generator(1000 * seed + attempt, bodies, scale, without).text()
        try:
            if Theirs(text).fits():
                return text
            scale *= 1.2
        except ValueError:
            pass  # such as a body without mass
    raise SystemExit(f"no file in 100 attempts, seed {seed}")


def imports(binary: str, files: list[Path]) -> dict:
    """What our side says about each file."""
    cores = os.cpu_count()

    def some(part):
        done = subprocess.run([binary], input="\n".join(map(str, part)), capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{binary}: {done.stderr}")
        return [json.loads(line) for line in done.stdout.splitlines()]

    with ThreadPoolExecutor(cores) as pool:
        return {row["file"]: row for rows in pool.map(some, (files[i::cores] for i in range(cores))) for row in rows}


def main() -> int:
    parser = argparse.ArgumentParser(prog="tests/peers/run.sh --import", description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=1000, help="files [default: 1000]")
    parser.add_argument("--seed", type=int, default=1, help="where they come from [default: 1]")
    parser.add_argument("--most", type=int, default=40, help="failures of a kind that are printed [default: 40]")
    parser.add_argument("--without", choices=FEATURES, action="append", default=[], help="leave out of all files")
    parser.add_argument("--files", nargs="+", type=Path, help="these files instead of random ones")
    parser.add_argument("--importer", required=True, help="our side: the built peer_import")
    parser.add_argument("--work", required=True, type=Path, help="folder for the files")
    given = parser.parse_args()
    folder = given.work / "import"
    folder.mkdir(parents=True, exist_ok=True)
    files = given.files or []
    for seed in range(0 if given.files else given.count):
        files.append(folder / f"{given.seed}-{seed}.xml")
        files[-1].write_text(draw(100_000 * given.seed + seed, given.without))

    answers, rng = imports(given.importer, files), np.random.default_rng(given.seed)
    refused, different, kinds = [], [], Counter()
    for file in files:
        answer, theirs = answers[str(file)], Theirs(file.read_text())
        if "refused" in answer:
            refused.append(f"{file.name}: {answer['refused']}")
            continue
        try:
            compare(theirs, answer["spec"], rng.uniform(-1.5, 1.5, len(theirs.hinges)))
        except Different as found:
            element, what = found.args
            kinds[what.split(":")[0].split(" is off")[0]] += 1
            different.append(f"{file.name}: {element}: {what}")
    for what, lines in (("refused", refused), ("different", different)):
        for line in lines[:given.most]:
            print(f"  {what}: {line}")
        if len(lines) > given.most:
            print(f"  … and {len(lines) - given.most} more {what} (--most prints more)")
    good = not refused and not different
    same = len(files) - len(refused) - len(different)
    where = "".join(f", {n} in {kind}" for kind, n in kinds.items())
    print(f"{'ok    ' if good else 'FAILED'}  import: of {len(files)} MJCF files, {same} are MuJoCo's robot to "
          f"{TOLERANCE:g}; {len(different)} differ silently{where}; {len(refused)} are refused")
    print(f"files: {folder}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
