"""What the tests of the executables share: a small BAL problem, a bundled one, and running a tool."""

import glob
import math
import os
import random
import subprocess


def write_small_bal(path, num_cameras=6, num_points=40):
    """Cameras in a row that see every point of a box in front of them; noisy observations, perturbed start values."""
    rng = random.Random(11)
    cameras = [[0.0, rng.uniform(-0.1, 0.1), 0.0, 2.0 - 0.8 * i, 0.0, -6.0, 500.0, -0.05, 0.01] for i in range(num_cameras)]
    points = [[rng.uniform(-2, 2) for _ in range(3)] for _ in range(num_points)]
    lines = [f"{num_cameras} {num_points} {num_cameras * num_points}"]
    for p, point in enumerate(points):
        for c, camera in enumerate(cameras):
            x, y = project(camera, point)
            lines.append(f"{c} {p} {x + rng.gauss(0, 0.3)!r} {y + rng.gauss(0, 0.3)!r}")
    lines += [repr(value) for camera in cameras for value in camera]
    lines += [repr(value + rng.uniform(-0.1, 0.1)) for point in points for value in point]
    with open(path, "w", encoding="ascii") as file:
        file.write("\n".join(lines) + "\n")


def project(camera, point):
    """The BAL camera model for a rotation about y only."""
    _, a, _, tx, ty, tz, f, k1, k2 = camera
    big_x = math.cos(a) * point[0] + math.sin(a) * point[2] + tx
    big_y = point[1] + ty
    big_z = -math.sin(a) * point[0] + math.cos(a) * point[2] + tz
    x, y = -big_x / big_z, -big_y / big_z
    r2 = x * x + y * y
    scale = f * (1 + k1 * r2 + k2 * r2 * r2)
    return scale * x, scale * y


def bundled_problem(bal_data):
    """The smallest BAL problem that ships with the repository."""
    files = glob.glob(os.path.join(bal_data, "*.txt")) + glob.glob(os.path.join(bal_data, "*.txt.*"))
    return min(files, key=os.path.getsize)


def run(*command, code=0):
    """Runs a tool, checks its exit code, returns (standard output, standard error)."""
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=300, check=False)
    if result.returncode != code:
        raise AssertionError(f"{command}: exit code {result.returncode}, not {code}\n{result.stdout}\n{result.stderr}")
    return result.stdout, result.stderr
