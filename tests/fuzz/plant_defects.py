#!/usr/bin/env python3
"""Copies a source of the library and plants defects in the copy, to see whether the differential fuzzer finds them.

    plant_defects.py --list                print the sources that have a defect, relative to the root
    plant_defects.py ROOT SOURCE OUTPUT    write ROOT/SOURCE with its defects to OUTPUT

Which of them is in force is decided at run time: the copy asks inceres::fuzz::IsPlanted("NAME"). Each place must occur exactly once
in its source: whoever changes that line has to say here where the defect belongs now.
"""

import pathlib
import re
import sys

# (name, source, the text as it is, the text with the defect; IS stands for the question whether it is in force)
DEFECTS = [
    # After refused steps the trust region never grows again, in exact mode and in incremental mode.
    ("damping_kept", "src/trust_region/levenberg_marquardt.cc",
     "radius_ = std::min(max_radius_,", "radius_ = IS ? radius_ : std::min(max_radius_,"),
    ("damping_kept", "src/incremental/step_control.cc",
     "mu_(std::clamp(mu, floor_,", "mu_(IS ? mu : std::clamp(mu, floor_,"),
    ("damping_kept", "src/incremental/step_control.cc",
     "mu_ = std::max(floor_, mu_ *", "mu_ = IS ? mu_ : std::max(floor_, mu_ *"),
    # A Jacobian is never found to be too old, neither after a step nor before success.
    ("stale_jacobian", "src/incremental/relinearization.cc",
     ": stale.ExceededBy(family, i);", ": !IS && stale.ExceededBy(family, i);"),
    ("stale_jacobian", "src/incremental/relinearization.cc",
     "else if (aged.ExceededBy(family, factor))", "else if (!IS && aged.ExceededBy(family, factor))"),
    # One landmark in five is never back-substituted, and what it could gain by itself is not seen.
    ("landmark_skipped", "src/incremental/trial_step.cc",
     "if (active_.landmarks().Add(landmark)) {",
     "if (active_.landmarks().Add(landmark) && !(IS && landmark % 5 == 3)) {"),
    ("landmark_skipped", "src/incremental/landmark_gains.cc",
     "total_ += gain - gains_[landmark];",
     "if (IS && landmark % 5 == 3) { return; }\n  total_ += gain - gains_[landmark];"),
    # One factor in five loses its loss.
    ("wrong_loss", "src/linearize/weighed_residuals.cc",
     "const LossValue value(factors.graph->loss(factors.id, factor), f, size_);",
     "const LossValue value(IS && factor % 5 == 2 ? nullptr : factors.graph->loss(factors.id, factor), f, size_);"),
    # That a cost function is another one, or has another measurement, is noticed and not passed on.
    ("edit_lost", "adapters/ceres/session/factor_matching.cc",
     "edit_.MeasurementChanged(factor.id);", "if (!IS) { edit_.MeasurementChanged(factor.id); }"),
]

DECLARATION = """namespace inceres::fuzz {
bool IsPlanted(const char* name);
}
"""


def plant(root, source):
    text = (root / source).read_text(encoding="utf-8")
    for name, where, before, after in DEFECTS:
        if where != source:
            continue
        # However the lines are broken: a space stands for any white space, and so may what follows
        # an opening bracket.
        place = re.compile(re.escape(before).replace(r"\ ", r"\s+").replace(r"\(", r"\(\s*"))
        planted = after.replace("IS", f'inceres::fuzz::IsPlanted("{name}")')
        text, count = place.subn(lambda _, planted=planted: planted, text)
        if count != 1:
            sys.exit(f"plant_defects.py: {source} has {count} times, not once, where {name} belongs:"
                     f" {before}")
    return DECLARATION + text


def main():
    if sys.argv[1:] == ["--list"]:
        print(";".join(dict.fromkeys(source for _, source, _, _ in DEFECTS)))
        return
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    root, source, output = sys.argv[1:]
    path = pathlib.Path(output)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(plant(pathlib.Path(root), source), encoding="utf-8")


if __name__ == "__main__":
    main()
