"""For all tests: how long a machine takes is no property of the code."""

from hypothesis import settings

settings.register_profile("contactd", deadline=None)
settings.load_profile("contactd")
