"""What a run costs in ceres::Solve without the user's own functions, from what valgrind --tool=callgrind wrote."""

import collections
import os
import re

NAMED = re.compile(r"\((\d+)\)(?: (.*))?$")
Call = collections.namedtuple("Call", "caller_object caller callee_object callee instructions")
# What solvers call of the user's: virtual functions of cost functions, losses, manifolds and callbacks.
USER_FUNCTION = re.compile(r"::(Evaluate|Plus|PlusJacobian|Minus|MinusJacobian|RightMultiplyByPlusJacobian|ComputeJacobian|"
                           r"MultiplyByJacobian|PrepareForEvaluation|operator\(\))\(")


class Names:
    """Callgrind gives a name in full where it first comes up and a number afterwards."""

    def __init__(self):
        self._known = {}

    def get(self, text):
        match = NAMED.match(text)
        if match is None:
            return text
        number, name = match.groups()
        if name is not None:
            self._known[number] = name
        return self._known[number]


def calls_in(lines):
    """Each edge of the call graph: who calls whom, and the instructions of the callee with all it calls from there."""
    objects, functions = Names(), Names()
    ob = fn = cob = cfn = ""
    expect_cost = False
    for line in lines:
        line = line.rstrip("\n")
        if expect_cost:  # the line after calls=: positions, then the only event
            yield Call(ob, fn, cob or ob, cfn, int(line.split()[-1]))
            cob, cfn, expect_cost = "", "", False
            continue
        key, separator, value = line.partition("=")
        if not separator:
            continue
        if key == "ob":
            ob = objects.get(value)
        elif key == "fn":
            fn = functions.get(value)
        elif key == "cob":
            cob = objects.get(value)
        elif key == "cfn":
            cfn = functions.get(value)
        elif key == "calls":
            expect_cost = True


def solve_costs(lines, program):
    """(instructions of the program's calls of ceres::Solve, those of the program's functions that were called in them). A function
    of the program is the user's if a library calls it and it has the name of one that solvers call; what a library has a copy of
    in the program, templates of the standard library, is the library's. Programs that evaluate cost functions through Ceres outside
    of ceres::Solve, by Problem::Evaluate, are not for this. ValueError if there is no call."""
    program = os.path.realpath(program)
    solves = user = calls = 0
    for call in calls_in(lines):
        if call.caller_object == program and call.callee.startswith(("ceres::Solve(", "ceres::Solver::Solve(")):
            solves += call.instructions
            calls += 1
        elif call.callee_object == program and call.caller_object != program and USER_FUNCTION.search(call.callee):
            user += call.instructions
    if calls == 0:
        raise ValueError(f"{program} does not call ceres::Solve, or has it inside")
    return solves, user
