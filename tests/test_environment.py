"""The program lives in an environment of its own: its packages have plain names."""

from importlib.metadata import packages_distributions

import pytest


@pytest.mark.parametrize(
    "package",
    ["common", "daemon", "drivers", "estimator", "identification", "programs", "simulator"],
)
def test_no_other_distribution_claims_our_packages(package):
    # python-daemon, for one, would bring a second `daemon`.
    owners = set(packages_distributions().get(package, [])) - {"contactd"}
    assert not owners, f"{owners} would shadow our {package}"
