"""Hypothesis profiles: the same examples everywhere for `make test`, new ones for `make fuzz`.

How long a machine takes is no property of the code, so neither has a deadline. `make test` draws
its examples from the tests themselves, so that a failure is the change's, and is found again by
whoever runs it. `make fuzz` draws thousands from a random seed that it prints. A property with a
number of examples of its own writes `max_examples=scaled(50)`, so that `make fuzz` reaches it, too.
"""

from hypothesis import settings

settings.register_profile("contactd", deadline=None, derandomize=True)
settings.register_profile("fuzz", deadline=None, max_examples=3000, print_blob=True)
settings.load_profile("contactd")
