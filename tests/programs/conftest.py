"""A daemon for the tests of this folder: see `tests/fake_daemon.py`."""

from tests.fake_daemon import (  # noqa: F401 - fixtures
    client,
    control,
    dial,
    fake_daemon,
    make_snapshot,
    make_state,
    run,
    served,
    tracking,
)
