"""What the tests of the executables share: a small BAL problem, a bundled one, and running a tool."""

import glob
import math
import os
import random
import subprocess

IDENTITY = "1 0 0 0 1 0 0 0 1"  # a rotation, row by row


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


def write_small_keyframes(path, num_keyframes=14):
    """Cameras that move sideways past points 2 m away; each keyframe anchors 8 and sees those of the two before again."""
    lines = ["# a wall"]
    for i in range(num_keyframes):
        lines.append(f"KEYFRAME {i} {IDENTITY} {0.2 * i + (0.01 if i else 0)} 0 0")
        for k in range(8 if i else 0):
            lines.append(f"DEPTH_GUESS {i - 1} {k} 0.4")
        for k in range(8):
            lines.append(f"FEATURE {i} {k} {0.1 * k - 0.4} {0.05 * (k % 3)} {0.5 if k % 2 else 0}")
        for a in range(max(0, i - 2), i):
            for k in range(8):
                lines.append(f"OBS {i} {a} {k} {0.1 * k - 0.4 - 0.1 * (i - a)} {0.05 * (k % 3)} 0 2e5 0 2e5")
        for a in {i - 1, i - 12} - {-1} if i else ():
            if a >= 0:
                information = " ".join("100" if k % 7 == 0 else "0" for k in range(36))
                lines.append(f"BETWEEN {a} {i} {IDENTITY} {-0.2 * (i - a)} 0 0 {information}")
    with open(path, "w", encoding="ascii") as file:
        file.write("\n".join(lines) + "\n")


def write_small_stereo(folder, num_poses=6, num_points=20):
    """A stereo camera that drives past points which all its poses see: 0.4 m a pose, a little noise."""
    rng = random.Random(12)
    f, cx, cy, baseline = 500.0, 320.0, 240.0, 0.4
    points = [[rng.uniform(-3, 3), rng.uniform(-2, 2), rng.uniform(8, 14)] for _ in range(num_points)]
    poses, sightings = [], []
    for i in range(num_poses):
        x = 0.4 * i
        poses.append(f"{i} 1 0 0 {x + (rng.gauss(0, 0.02) if i else 0)!r} 0 1 0 0 0 0 1 0 0 0 0 1")
        for p, point in enumerate(points):
            big_x, big_y, big_z = point[0] - x, point[1], point[2]
            u, v = f * big_x / big_z + cx + rng.gauss(0, 0.3), f * big_y / big_z + cy + rng.gauss(0, 0.3)
            right = f * (big_x - baseline) / big_z + cx + rng.gauss(0, 0.3)
            depth = f * baseline / (u - right)
            sightings.append(f"{i} {p} {u!r} {right!r} {v!r} {(u - cx) / f * depth!r} {(v - cy) / f * depth!r} {depth!r}")
    os.makedirs(folder, exist_ok=True)
    for name, lines in (("calibration", [f"{f} {f} 0 {cx} {cy} {baseline}"]), ("camera_poses", poses), ("stereo_factors", sightings)):
        with open(os.path.join(folder, f"VO_{name}.txt"), "w", encoding="ascii") as file:
            file.write("\n".join(lines) + "\n")


def write_small_pose_graph(path, dimension, num_poses=14):
    """A circle without start values: noisy relative poses with the two before, and of the last but one with the first."""
    rng = random.Random(13)
    pairs = [(i - k, i) for i in range(1, num_poses) for k in (1, 2) if k <= i] + [(1, num_poses - 2)]
    lines = []
    for i, k in pairs:
        turn = 0.4 * (k - i) + rng.gauss(0, 0.01)
        x, y = math.sin(0.4 * (k - i)) / 0.4 + rng.gauss(0, 0.02), (1 - math.cos(0.4 * (k - i))) / 0.4 + rng.gauss(0, 0.02)
        if dimension == 2:
            lines.append(f"EDGE_SE2 {i} {k} {x!r} {y!r} {turn!r} 100 1 0 120 2 400")
        else:
            information = " ".join(str(100 + 10 * r) if r == c else "1" for r in range(6) for c in range(r, 6))
            lines.append(f"EDGE_SE3:QUAT {i} {k} {x!r} {y!r} {rng.gauss(0, 0.02)!r} 0 0 {math.sin(turn / 2)!r} "
                         f"{math.cos(turn / 2)!r} {information}")
    with open(path, "w", encoding="ascii") as file:
        file.write("\n".join(lines) + "\n")


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
