"""Hypothesis profiles: the same examples everywhere for `make test`, new ones for `make fuzz`.

How long a machine takes is no property of the code, so neither has a deadline. `make test` draws
its examples from the tests themselves, so that a failure is the change's, and is found again by
who runs it. `make fuzz` draws thousands from a random seed that it prints. A property with a
number of examples of its own writes `max_examples=scaled(50)`, so that `make fuzz` reaches it, too.
"""

import asyncio
import inspect
import logging
import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from common.compiled import refuse_stale
from common.errors import ProgramError
from common.numeric_threads import single_threaded
from tests.slow import listed

# Before anything loads numpy: threads of BLAS beside those of other workers take six times as long.
single_threaded()
os.environ.pop("COLUMNS", None)  # xdist has one, and output that is no terminal's keeps to it


def pytest_sessionstart() -> None:
    """Refuse to test what is not the code that is here."""
    try:
        refuse_stale()
    except ProgramError as error:
        pytest.exit(str(error), returncode=4)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark slow tests, which `make test` leaves out."""
    names = listed()
    for item in items:
        if item.nodeid.partition("[")[0] in names:
            item.add_marker("slow")


settings.register_profile("contactd", deadline=None, derandomize=True)
settings.register_profile("fuzz", deadline=None, max_examples=3000, print_blob=True)
settings.load_profile("contactd")


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Runs a test that is a coroutine, in an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


@pytest.fixture(autouse=True)
def log_as_before() -> Iterator[None]:
    """Log at the level it had: a bench that a test runs may have silenced it."""
    logger = logging.getLogger("contactd")
    level = logger.level
    yield
    logger.setLevel(level)


@pytest.fixture
def impatient() -> Iterator[None]:
    """Ends a test that waits for ever, by an error; no time that a test should take."""

    def give_up(*_: object) -> None:
        raise TimeoutError("it waits for ever")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(300)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
