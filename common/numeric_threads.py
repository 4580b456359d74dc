"""Threads of the numeric libraries: none, in any process of contactd."""

import os

_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def single_threaded() -> None:
    """Keep the numeric libraries, which read this when they are loaded, from starting threads: on
    matrices of some columns these cost more time than they save, and spin beside the loop."""
    for name in _COUNTS:
        os.environ[name] = "1"
