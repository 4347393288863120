#!/usr/bin/env python3
"""Tests with the differential fuzzer (docs/fuzzing.md).

    fuzz_test.py lives PROGRAM MODE [FLAG]...
                                         a bounded number of random lives: no defect but those that are open
    fuzz_test.py seeds PROGRAM MODE      lives that had a defect once: those that are mended have none
    fuzz_test.py teeth PROGRAM DEFECT    a defect planted in the library is found, in lives that have none without it
    fuzz_test.py usage PROGRAM           exit codes and messages
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).parent
SEED = 20
LIVES = {"exact": 60, "incremental": 120, "session": 120, "dropin": 40, "dropin_incremental": 80, "auto": 80}
EDITS = 40

# Of each planted defect: the mode in which it shows, and by which kinds of finding. At least so many lives must show it.
TEETH = {
    "damping_kept": ("exact", {"other_trace"}),
    "stale_jacobian": ("session", {"excess", "excess_beside_fault"}),
    "landmark_skipped": ("session", {"excess", "slow"}),
    "wrong_loss": ("session", {"wrong_final_cost"}),
    "edit_lost": ("session", {"wrong_final_cost"}),
}
TEETH_LIVES = 40
TEETH_FOUND = 3


def run(program, *flags, planted=None):
    """Exit code, output, and the lines of JSON."""
    environment = dict(os.environ, INCERES_PLANTED=planted or "")
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "fuzz.jsonl"
        done = subprocess.run([program, *flags, f"--json={path}"], env=environment, capture_output=True, text=True, check=False)
        lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    return done.returncode, done.stdout + done.stderr, lines


def fuzz(program, mode, seed, first_life, lives, edits, *flags, planted=None):
    """The line of JSON of some lives; the exit code must agree with it."""
    code, output, lines = run(program, f"--mode={mode}", f"--seed={seed}", f"--first_life={first_life}", f"--lives={lives}",
                              f"--edits={edits}", *flags, planted=planted)
    assert len(lines) == 1 and code == (1 if lines[0]["defects"] else 0), f"exit code {code}\n{output}"
    return lines[0], output


def listed_seeds(mode):
    """(seed, life, edits, state, further flags) of the lives in seeds.txt."""
    for line in (HERE / "seeds.txt").read_text().splitlines():
        words = line.split("#")[0].split()
        if words and words[0] == mode:
            yield int(words[1]), int(words[2]), int(words[3]), words[4], words[5:]


def test_lives(program, mode, *flags):
    report, output = fuzz(program, mode, SEED, 0, LIVES[mode], EDITS, *flags)
    print(output)
    is_open = {life for seed, life, _, state, of_seed in listed_seeds(mode)
               if seed == SEED and state == "open" and of_seed == list(flags)}
    new = [defect for defect in report["defects"] if defect["life"] not in is_open]
    assert not new, f"{len(new)} defects, see above"
    assert report["judged"] > 3 * LIVES[mode], "hardly any end was judged"
    if mode in ("exact", "dropin"):
        assert report["traces_compared"] > 5 * report["traces_chaotic"] > 0, "hardly any trace was compared"


def test_seeds(program, mode):
    failed = []
    for seed, life, edits, state, flags in listed_seeds(mode):
        # With one thread, so that the life is the same one every time.
        report, output = fuzz(program, mode, seed, life, 1, edits, "--max_threads=1", *flags)
        print(f"{mode} {seed} {life} {edits} {state}: {'defect' if report['defects'] else 'no defect'}")
        if report["defects"] and state == "mended":
            failed.append(output)
    assert not failed, "mended once, and broken again:\n" + "\n".join(failed)
    if mode == "session":
        # The life is one that two threads lead to other ends from run to run.
        long_life = ("--mode=session", "--seed=1264", "--lives=1", "--edits=2611", "--max_threads=1")
        ends = {run(program, *long_life)[1].partition(" s; ")[2] for _ in range(10)}
        assert len(ends) == 1, "one thread, and other lives"


def test_teeth(program, defect):
    mode, kinds = TEETH[defect]
    healthy, _ = fuzz(program, mode, SEED, 0, TEETH_LIVES, EDITS)
    planted, output = fuzz(program, mode, SEED, 0, TEETH_LIVES, EDITS, planted=defect)
    print(output)
    ill_anyway = {found["life"] for found in healthy["defects"]}
    lives = {found["life"] for found in planted["defects"] if found["kind"] in kinds} - ill_anyway
    assert len(ill_anyway) < TEETH_LIVES / 2, "half of the lives have a defect without a planted one"
    assert len(lives) >= TEETH_FOUND, f"found in lives {sorted(lives)} only"
    if not ill_anyway:
        first = sorted(lives)[0]
        code, again, _ = run(program, f"--mode={mode}", f"--seed={SEED}", f"--first_life={first}", "--lives=1", f"--edits={EDITS}",
                             planted=defect)
        assert code == 1 and f"life {first}," in again, "the command that repeats it does not"


def test_usage(program):
    assert run(program, "--mode=exact,nonsense", "--lives=1")[0] == 2
    assert run(program, "surplus")[0] == 2
    for threads in ("0", "3"):
        assert run(program, "--mode=exact", "--lives=1", f"--max_threads={threads}")[0] == 2
    code, output, _ = run(program, "--help")
    assert code == 0 and "--first_life" in output
    done = subprocess.run([program, "--mode=exact", "--lives=1", "--json=/nowhere/file"], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "/nowhere/file" in done.stderr, done.stderr
    code, output, lines = run(program, "--mode=incremental", "--seed=3", "--lives=2", "--edits=10", "--verbose")
    assert "edit 1: " in output and "solve 1: " in output and lines[0]["lives"] == 2, output
    assert run(program, "--mode=incremental", "--seed=3", "--lives=1000000", "--seconds=0.2")[2][0]["lives"] < 1000000
    twice = [run(program, "--mode=session", "--seed=3", "--lives=20", "--edits=20")[2][0] for _ in range(2)]
    for report in twice:
        del report["seconds"]
    assert twice[0] == twice[1], "the same seed gave other lives"


if __name__ == "__main__":
    test = {"lives": test_lives, "seeds": test_seeds, "teeth": test_teeth, "usage": test_usage}[sys.argv[1]]
    test(*sys.argv[2:])
