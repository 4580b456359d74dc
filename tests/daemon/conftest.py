"""A daemon for the tests of this folder: see `tests/fake_daemon.py`."""

from tests.fake_daemon import *  # noqa: F403 - its fixtures
