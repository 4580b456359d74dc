"""Programs beside the daemon: one folder a program, and what they share."""

import sys
from types import TracebackType


def _report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Report what ends a program; nothing of Ctrl-C, also while modules are imported: a shell sees
    status 130."""
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _report
