#!/usr/bin/env python3
"""Which steps of a pose graph that grows cost more than a batch solve of the same graph from the same values.

    benchmarks/beside_batch.py FILE.g2o… [--rounds 3] [--steps 0] [--tolerance 1e-6] [--worst 10] [--count] [--build build]

Plays each file pose by pose with `replay --beside_batch`, several times: the counts of a step are the same each time, and of its
processor time, and of the batch solver's, the least is taken, so that what else the machine does hardly counts. Prints a row a file:
the share of steps that take at most 1.2 times as long, those above twice, the worst, and all together; then the worst steps with what
they did. Steps below 0.1 ms on both sides are not told apart. --count counts instructions instead, by valgrind, in one round: what else
the machine does does not matter then, but it takes fifty times as long; steps below 0.2 million on both sides are not told apart. Exit code: 0 played, 2 a run could not be played.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

from stock_environment import stock_environment

ROOT = pathlib.Path(__file__).resolve().parent.parent
SLACK, SHORTEST = 1.2, 0.1  # times; ms
LEAST_COUNT = 0.2  # million instructions
# The profile is written, and begun anew, before these; what came before the second is ours, before the third batch.
CUTS = ["*IncrementalReplaySolver::Solve()", "*CoreReplaySolver::Solve()", "*IncrementalReplaySolver::AddStep(*ReplayStep const&)"]


class Counts:
    """Instructions of ours and of the batch solver, step by step, from the profiles that callgrind drops in a folder."""

    def __init__(self, folder):
        self.folder, self.next, self.ours, self.batch = pathlib.Path(folder), 1, [], []

    def take(self, ended):
        while (part := self.folder / f"profile.{self.next}").exists() and (ended or (self.folder / f"profile.{self.next + 1}").exists()):
            text = part.read_text(encoding="utf-8", errors="replace")
            part.unlink()
            self.next += 1
            total = 1e-6 * int(re.search(r"^totals: (\d+)", text, re.MULTILINE)[1])
            cut = re.search(r"dump-before=(.*)", text)
            if cut and "CoreReplaySolver::Solve" in cut[1]:
                self.ours.append(total)
            elif cut and "AddStep" in cut[1] and self.ours:
                self.batch.append(total)


def count(command, folder):
    counts = Counts(folder)
    profiled = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/profile"] + [f"--dump-before={cut}" for cut in CUTS] + command
    with subprocess.Popen(profiled, env=stock_environment(1), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        while run.poll() is None:
            counts.take(ended=False)
            time.sleep(0.2)
    if run.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(map(str, profiled))}: exit code {run.returncode}")
    counts.take(ended=True)
    return counts


def play_counted(tool, path, steps, tolerance):
    """The rows with instructions, in millions, in place of milliseconds."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        counts = count([str(part) for part in command_of(tool, path, steps, tolerance, report)], folder)
        last = re.search(r"^totals: (\d+)", (pathlib.Path(folder) / "profile").read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
        counts.batch.append(1e-6 * int(last[1]))
        rows = json.loads(report.read_text(encoding="utf-8"))["rows"]
        for row, ours, batch in zip(rows, counts.ours, counts.batch):
            row["ours"]["processor_ms"], row["batch_processor_ms"] = ours, batch
        return rows


def command_of(tool, path, steps, tolerance, report):
    return [tool, "--problem", f"g2o:{path}", "--nostock", "--nooptimum", "--beside_batch", "--function_tolerance", str(tolerance),
            "--print_every", "1000000", "--json", str(report)] + (["--steps", str(steps)] if steps > 0 else [])


def play(tool, path, steps, tolerance):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = command_of(tool, path, steps, tolerance, report)
        result = subprocess.run(command, env=stock_environment(1), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
        if result.returncode not in (0, 1):
            raise RuntimeError(f"{path}: {result.stderr.strip()}")
        return json.loads(report.read_text(encoding="utf-8"))["rows"]


def least(rounds, shortest):
    """[(ratio, step, our ms, batch ms, row)] with the least times of all rounds."""
    steps = []
    for rows in zip(*rounds):
        ours = min(row["ours"]["processor_ms"] for row in rows)
        batch = min(row["batch_processor_ms"] for row in rows)
        steps.append((max(ours, shortest) / max(batch, shortest), rows[0]["step"], ours, batch, rows[0]))
    return steps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=0, help="only the first so many; 0: all")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--worst", type=int, default=10, help="how many of the dearest steps to list")
    parser.add_argument("--count", action="store_true", help="count instructions by valgrind instead")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="the build directory")
    arguments = parser.parse_args()
    if arguments.count and arguments.rounds != parser.get_default("rounds"):
        parser.error("--rounds: --count plays one")
    unit = "million" if arguments.count else "ms"
    tool = arguments.build.resolve() / "bin" / "replay"
    print("| file | steps | at most 1.2 times | above twice | worst | all |\n|---|---|---|---|---|---|")
    try:
        for path in arguments.files:
            play_once, rounds, shortest = (play_counted, 1, LEAST_COUNT) if arguments.count else (play, arguments.rounds, SHORTEST)
            steps = least([play_once(tool, path, arguments.steps, arguments.tolerance) for _ in range(rounds)], shortest)
            within = sum(ratio <= SLACK for ratio, *_ in steps) / len(steps)
            above = sum(ratio > 2.0 for ratio, *_ in steps)
            total = sum(step[2] for step in steps) / sum(step[3] for step in steps)
            worst = sorted(steps, key=lambda step: -step[0])
            print(f"| {path.stem} | {len(steps)} | {100.0 * within:.2f} % | {above} | {worst[0][0]:.2f} | {total:.3f} |", flush=True)
            for ratio, step, ours, batch, row in worst[:arguments.worst]:
                counts = ", ".join(f"{name} {count}" for name, count in row["ours"]["work"].items() if count)
                print(f"    step {step}: {ratio:.2f} = {ours:.2f} / {batch:.2f} {unit}, {row['ours']['iterations']} iterations beside "
                      f"{row['batch_iterations']}, {counts}", flush=True)
    except (OSError, RuntimeError, KeyError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
