"""Single-threaded numeric libraries in every process of contactd."""

import os

_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def single_threaded() -> None:
    """Keep the numeric libraries from starting threads; they read these variables when loaded. On
    small matrices threads cost more time than they save, and they spin beside the control loop."""
    for name in _COUNTS:
        os.environ[name] = "1"
