"""The environment in which every script here runs ours and stock Ceres."""

import os


def stock_environment(num_threads=1, **more):
    """This process's environment, for solves with so many threads. As packaged, stock's CHOLMOD starts four OpenMP threads whatever
    num_threads says: where one thread is asked for it is kept on one, with two it is left as it is. BLAS stays on one, as in ours."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "GLOG_minloglevel": "2"}
    if num_threads == 1:
        environment["OMP_MAX_ACTIVE_LEVELS"] = "0"
    return {**environment, **more}


def program_environment(mode=None, dropin=None):
    """The same of a program that knows only Ceres: with the drop-in preloaded in this mode, or, without either, bare."""
    environment = stock_environment()
    environment.pop("LD_PRELOAD", None)
    if mode is not None and dropin is not None:
        environment.update(LD_PRELOAD=str(dropin), INCERES_MODE=mode)
    return environment


def num_threads_in(flags):
    """What --num_threads among the flags of a tool says, or its default."""
    flags = [str(flag) for flag in flags]
    return int(flags[flags.index("--num_threads") + 1]) if "--num_threads" in flags else 1
