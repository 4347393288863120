#!/usr/bin/env python3
"""Lesson 1: bundle adjustment from arrays.

    01_bundle_adjustment.py [BAL FILE] [--picture FILE.png]

Reads a problem, adjusts it with and without a robust loss, and draws the cost of each iteration and
the residuals before and after.
"""

import argparse
import pathlib

import matplotlib.pyplot as plt
import numpy as np

import inceres

STREET = pathlib.Path(__file__).resolve().parents[2] / "bal_data" / "street-16-1200-pre.txt"


def residuals(cameras, points, problem):
    """How far each observation is from where the model puts it (k, 2), pixels."""
    camera, X = cameras[problem.camera_indices], points[problem.point_indices]
    w = camera[:, :3]
    theta = np.linalg.norm(w, axis=1, keepdims=True)
    axis = w / np.where(theta > 0, theta, 1)
    along = np.einsum("ki,ki->k", axis, X)[:, None] * axis
    turned = along + np.cos(theta) * (X - along) + np.sin(theta) * np.cross(axis, X)  # Rodrigues
    P = turned + camera[:, 3:6]
    p = -P[:, :2] / P[:, 2:]
    r2 = np.einsum("ki,ki->k", p, p)
    scale = camera[:, 6] * (1 + r2 * (camera[:, 7] + r2 * camera[:, 8]))
    return scale[:, None] * p - problem.observations


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", default=STREET, type=pathlib.Path)
    parser.add_argument("--picture", default="bundle_adjustment.png")
    arguments = parser.parse_args()

    problem = inceres.read_bal(arguments.file)
    print(f"{arguments.file.name}: {len(problem.cameras)} cameras, {len(problem.points)} points, "
          f"{len(problem.observations)} observations")

    plain = inceres.bundle_adjust(*problem.arrays(), callback=inceres.print_progress)
    robust = inceres.bundle_adjust(*problem.arrays(), loss=inceres.HuberLoss(1.0))
    for name, result in [("least squares", plain), ("Huber's loss", robust)]:
        errors = np.linalg.norm(residuals(result.cameras, result.points, problem), axis=1)
        print(f"{name:14}: {len(result.summary['iterations']) - 1} iterations, "
              f"{result.summary['seconds']['total']:.3f} s, median error "
              f"{np.median(errors):.3f} px, 95 % below {np.quantile(errors, 0.95):.3f} px")

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for name, result in [("least squares", plain), ("Huber's loss", robust)]:
        left.semilogy([row["cost"] for row in result.summary["iterations"]], ".-", label=name)
    left.set(xlabel="iteration", ylabel="cost", title="Each loss has its own cost")
    left.legend()
    before = np.linalg.norm(residuals(problem.cameras, problem.points, problem), axis=1)
    after = np.linalg.norm(residuals(robust.cameras, robust.points, problem), axis=1)
    bins = np.geomspace(1e-2, max(before.max(), 1.0), 60)
    right.hist(np.clip(before, bins[0], None), bins, alpha=0.5, label="before")
    right.hist(np.clip(after, bins[0], None), bins, alpha=0.5, label="after")
    right.set(xscale="log", xlabel="error, pixels", ylabel="observations", title="Residuals")
    right.legend()
    figure.savefig(arguments.picture)
    print(f"picture: {arguments.picture}")


if __name__ == "__main__":
    main()
