#!/usr/bin/env python3
"""Lesson 3: a problem that lives, with a factor of your own.

    03_living_problem.py [--steps N] [--picture FILE.png]

A boat sails past beacons whose places nobody knows. Each step adds a pose, an odometry edge and the
ranges to the beacons near by: a factor in NumPy, its derivatives checked first. The solver's counts
say how much of the problem each step touched.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import inceres

RANGE_SIGMA = 0.1


def ranges(measurements, parameters, wanted):
    """(|beacon - place| - range) / sigma of k factors at once; a pose is x, y, theta."""
    poses, beacons = parameters
    offset = beacons - poses[:, :2]
    distance = np.linalg.norm(offset, axis=1)
    residuals = (distance - measurements[:, 0]) / RANGE_SIGMA
    if not wanted:
        return residuals
    direction = offset / distance[:, None] / RANGE_SIGMA
    by_pose = np.zeros((len(poses), 1, 3))
    by_pose[:, 0, :2] = -direction
    return residuals, [by_pose, direction[:, None, :]]


def sail(steps, random):
    """True poses, what the log says of each step, and true beacons."""
    turns = 0.25 * np.sin(np.arange(steps) / 9.0)
    poses = np.zeros((steps + 1, 3))
    for i, turn in enumerate(turns):
        x, y, theta = poses[i]
        poses[i + 1] = x + np.cos(theta), y + np.sin(theta), theta + turn
    motions = np.column_stack([np.ones(steps), np.zeros(steps), turns])
    motions += random.standard_normal(motions.shape) * [0.05, 0.05, 0.02]
    along = poses[::4, :2]
    return poses, motions, along + random.uniform(-6, 6, along.shape)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--picture", default="living_problem.png")
    arguments = parser.parse_args()
    random = np.random.default_rng(11)

    errors = inceres.check_jacobians(ranges, [[1.0]], [[[0.3, 0.2, 1.0]], [[2.0, -1.0]]])
    print("Jacobians against differences: " + ", ".join(f"{error:.0e}" for error in errors))

    truth, motions, beacons = sail(arguments.steps, random)
    solver = inceres.IncrementalSolver()
    odometry = solver.add_family(inceres.PlanarRelativePose())
    ranging = solver.add_family(inceres.CustomFamily(1, [3, 2], 1, ranges, name="range"))
    U = np.diag([1 / 0.05, 1 / 0.05, 1 / 0.02]).ravel()
    with solver.edit() as edit:
        poses = [int(edit.add_variables(truth[:1], constant=True)[0])]
    known = np.full(len(beacons), -1)
    counts, estimate = [], truth[0]
    for i, motion in enumerate(motions):
        c, s = np.cos(estimate[2]), np.sin(estimate[2])
        start = estimate + [c * motion[0] - s * motion[1], s * motion[0] + c * motion[1], motion[2]]
        distance = np.linalg.norm(beacons - truth[i + 1, :2], axis=1)
        near = np.flatnonzero(distance < 7.0)
        with solver.edit() as edit:
            poses.append(int(edit.add_variables([start])[0]))
            edit.add_factors(odometry, [poses[-2:]], [np.r_[motion, U]])
            new = near[known[near] < 0]  # first guesses are off by meters
            known[new] = edit.add_variables(
                beacons[new] + random.standard_normal((len(new), 2)), "landmark")
            seen = distance[near, None] + RANGE_SIGMA * random.standard_normal((len(near), 1))
            edit.add_factors(ranging, np.column_stack([np.full(len(near), poses[-1]), known[near]]),
                             seen, inceres.HuberLoss(2.0))
        counts.append(solver.update())
        estimate = solver.values(poses[-1:])[0]

    found = solver.values(poses)
    error = np.linalg.norm(found[:, :2] - truth[:, :2], axis=1)
    dead_reckoning = np.abs(np.cumsum(motions[:, 2]) - truth[1:, 2])[-1]
    print(f"{solver.num_variables} variables, {solver.num_factors} factors, cost {solver.cost:.1f}")
    print(f"the boat is {error[-1]:.2f} m from where we think; the log alone is off by "
          f"{np.degrees(dead_reckoning):.0f} degrees of heading")
    touched = [count["num_relinearised_factors"] for count in counts]
    print(f"factors linearized a step, over its iterations: {np.mean(touched[-20:]):.0f} of "
          f"{solver.num_factors}")

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    left.plot(*truth[:, :2].T, "k-", linewidth=3, alpha=0.3, label="truth")
    left.plot(*found[:, :2].T, label="estimate")
    left.plot(*solver.values(known[known >= 0]).T, "*", label="beacons")
    left.set(title="Path", xlabel="x, m", ylabel="y, m")
    left.legend()
    right.plot(touched, label="factors linearized")
    right.plot([count["num_visited_landmarks"] for count in counts], label="landmarks visited")
    right.set(title="Work of each step", xlabel="step")
    right.legend()
    figure.savefig(arguments.picture)
    print(f"picture: {arguments.picture}")


if __name__ == "__main__":
    main()
