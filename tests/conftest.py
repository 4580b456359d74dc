"""For all tests: how long a machine takes is no property of the code."""

import os

from hypothesis import settings

# CI tries the same examples each time: what it finds is then the change's, and found again. At the
# developers' they are others in every run.
settings.register_profile("contactd", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("contactd")
