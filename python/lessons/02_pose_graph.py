#!/usr/bin/env python3
"""Lesson 2: a pose graph from arrays of edges.

    02_pose_graph.py [G2O FILE] [--picture FILE.png]

Without a file a robot drives eight times around a block; its odometry drifts, and now and then it
recognizes where it has been, at times wrongly. A robust loss tells wrong loops from right ones.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import inceres


def compose(a, b):
    """The planar pose b, seen from pose a, in the world of a (both (n, 3))."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    return np.column_stack([a[:, 0] + c * b[:, 0] - s * b[:, 1],
                            a[:, 1] + s * b[:, 0] + c * b[:, 1], a[:, 2] + b[:, 2]])


def between(a, b):
    """Pose b as a sees it."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    d = b - a
    return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], d[:, 2]])


def drive(random, laps=8, side=20):
    """True poses, edges (odometry, loops, wrong loops), measurements and their information."""
    step = np.array([[1.0, 0.0, 0.0]])
    turn = np.array([[0.0, 0.0, np.pi / 2]])
    poses = [np.zeros((1, 3))]
    for _ in range(laps * 4):
        for k in range(side):
            poses.append(compose(poses[-1], step if k < side - 1 else compose(step, turn)))
    truth = np.vstack(poses)
    n, lap = len(truth), 4 * side
    odometry = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    later = random.choice(np.arange(lap, n), 60, replace=False)
    loops = np.column_stack([later - lap, later])
    wrong = random.integers(0, n, (12, 2))
    wrong = wrong[np.abs(wrong[:, 0] - wrong[:, 1]) > 10]
    edges = np.vstack([odometry, loops, wrong])
    motions = between(truth[edges[:, 0]], truth[edges[:, 1]])
    motions += random.standard_normal(motions.shape) * [0.02, 0.02, 0.01]
    motions[len(odometry) + len(loops):] = random.uniform(-1, 1, (len(wrong), 3))
    weights = np.diag([1 / 0.02**2, 1 / 0.02**2, 1 / 0.01**2])
    return truth, edges, motions, np.broadcast_to(weights, (len(edges), 3, 3)), len(wrong)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?")
    parser.add_argument("--picture", default="pose_graph.png")
    arguments = parser.parse_args()

    truth = None
    if arguments.file:
        graph = inceres.read_g2o(arguments.file)
        start, edges, motions = graph.poses, graph.edges, graph.measurements
        information = graph.information
    else:
        truth, edges, motions, information, num_wrong = drive(np.random.default_rng(7))
        print(f"{len(truth)} poses, {len(edges)} edges, {num_wrong} of them wrong")
        poses = [truth[:1]]
        for motion in motions[:len(truth) - 1]:
            poses.append(compose(poses[-1], motion[None]))
        start = np.vstack(poses)

    results = {"as measured": start}
    for name, loss in [("least squares", None), ("Cauchy's loss", inceres.CauchyLoss(3.0))]:
        found = inceres.optimize_pose_graph(start, edges, motions, information, loss=loss)
        results[name] = found.poses
        print(f"{name:14}: {len(found.summary['iterations']) - 1} iterations, cost "
              f"{found.summary['initial_cost']:.4g} -> {found.summary['final_cost']:.4g}, "
              f"{found.summary['seconds']['total']:.3f} s")
    if truth is not None:
        for name, poses in results.items():
            error = np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1)))
            print(f"{name:14}: {error:.3f} m from the truth (RMS)")

    figure, axes = plt.subplots(1, len(results), figsize=(12, 4), layout="constrained")
    for axis, (name, poses) in zip(axes, results.items()):
        axis.plot(poses[:, 0], poses[:, 1], linewidth=0.8)
        axis.set(title=name, xlabel="x, m", ylabel="y, m")
        axis.set_aspect("equal", "datalim")
    figure.savefig(arguments.picture)
    print(f"picture: {arguments.picture}")


if __name__ == "__main__":
    main()
