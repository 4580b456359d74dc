"""Number of hypothesis examples for a property that needs more or fewer than the profile's."""

from hypothesis import settings


def scaled(count: int) -> int:
    """`count` examples under `make test`, and as many times more under `make fuzz` as other
    properties get: a plain number in `@settings` would overrule the fuzz profile."""
    usual = settings.get_profile("contactd").max_examples
    return round(count * settings.default.max_examples / usual)
