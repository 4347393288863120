#!/usr/bin/env python3
"""Writes a pose graph that is mostly odometry: a robot that wanders, with a few loops to where it was before.

    benchmarks/odometry_chain.py FILE.g2o [--poses 15000] [--loops 0.01] [--spatial] [--seed 1]

A step is a meter, with a turn that wanders; a loop leads to the nearest pose of at least a hundred steps before, if that is within
twenty meters; `--loops` of the poses have one. Measurements have noise of 5 cm and half a degree a step, which is what the information
says, and the start values follow the odometry. The same seed writes the same file. Exit code: 0 written, 2 bad arguments.
"""

import argparse
import math
import random
import sys

SIGMA_POSITION = 0.05  # meters
SIGMA_ANGLE = math.radians(0.5)
LOOP_GAP = 100  # steps
LOOP_DISTANCE = 20.0  # meters
CELL = 20.0  # meters, of the grid that neighbors are looked for in


def compose(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2])


def between(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return (c * x + s * y, c * y - s * x, math.remainder(b[2] - a[2], 2.0 * math.pi))


def wander(count, dice):
    """Where the robot is: it turns more where it strays, so that it comes back."""
    pose, poses, turn = (0.0, 0.0, 0.0), [], 0.0
    for _ in range(count):
        poses.append(pose)
        home = math.remainder(math.atan2(-pose[1], -pose[0]) - pose[2], 2.0 * math.pi)
        turn = 0.8 * turn + dice.gauss(0.0, 0.08) + 0.02 * home * min(1.0, math.hypot(pose[0], pose[1]) / 300.0)
        pose = compose(pose, (1.0, 0.0, turn))
    return poses


def find_loops(poses, share, dice):
    cells, loops = {}, []
    for i, (x, y, _) in enumerate(poses):
        if i >= LOOP_GAP:
            far = i - LOOP_GAP
            cells.setdefault((int(poses[far][0] // CELL), int(poses[far][1] // CELL)), []).append(far)
        if dice.random() < share:
            column, row = int(x // CELL), int(y // CELL)
            near = [j for dx in (-1, 0, 1) for dy in (-1, 0, 1) for j in cells.get((column + dx, row + dy), [])]
            best = min(near, key=lambda j: math.hypot(poses[j][0] - x, poses[j][1] - y), default=None)
            if best is not None and math.hypot(poses[best][0] - x, poses[best][1] - y) <= LOOP_DISTANCE:
                loops.append((best, i))
    return loops


def measure(motion, dice):
    return (motion[0] + dice.gauss(0.0, SIGMA_POSITION), motion[1] + dice.gauss(0.0, SIGMA_POSITION),
            motion[2] + dice.gauss(0.0, SIGMA_ANGLE))


def text(pose, spatial):
    if not spatial:
        return f"{pose[0]:.9g} {pose[1]:.9g} {pose[2]:.9g}"
    return f"{pose[0]:.9g} {pose[1]:.9g} 0 0 0 {math.sin(0.5 * pose[2]):.12g} {math.cos(0.5 * pose[2]):.12g}"


def information(spatial):
    size = 6 if spatial else 3
    position, angle = 1.0 / SIGMA_POSITION**2, 1.0 / SIGMA_ANGLE**2
    diagonal = [position if k < (3 if spatial else 2) else angle for k in range(size)]
    return " ".join(f"{diagonal[r]:.9g}" if r == c else "0" for r in range(size) for c in range(r, size))


def write_chain(path, count, share, spatial, seed):
    dice = random.Random(seed)
    poses = wander(count, dice)
    edges = [(i - 1, i, measure(between(poses[i - 1], poses[i]), dice)) for i in range(1, count)]
    loops = [(a, b, measure(between(poses[a], poses[b]), dice)) for a, b in find_loops(poses, share, dice)]
    vertex, edge = ("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT") if spatial else ("VERTEX_SE2", "EDGE_SE2")
    start, weight = poses[0], information(spatial)
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"{vertex} 0 {text(start, spatial)}\n")
        for i, (_, _, motion) in enumerate(edges):
            start = compose(start, motion)
            file.write(f"{vertex} {i + 1} {text(start, spatial)}\n")
        for a, b, motion in sorted(edges + loops, key=lambda e: (e[1], e[0])):
            file.write(f"{edge} {a} {b} {text(motion, spatial)} {weight}\n")
    return len(loops)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--poses", type=int, default=15000)
    parser.add_argument("--loops", type=float, default=0.01, help="share of the poses that close one")
    parser.add_argument("--spatial", action="store_true", help="poses in space, in a plane of it")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if arguments.poses < 2 or not 0.0 <= arguments.loops <= 1.0:
        parser.error("--poses is at least 2, --loops in [0, 1]")
    loops = write_chain(arguments.file, arguments.poses, arguments.loops, arguments.spatial, arguments.seed)
    print(f"{arguments.file}: {arguments.poses} poses, {loops} loops")
    return 0


if __name__ == "__main__":
    sys.exit(main())
