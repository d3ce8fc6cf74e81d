"""One file for each estimator; each enters itself in `REGISTRY` when this package is imported."""

from importlib import import_module
from pkgutil import iter_modules

from allanscope.allan.estimators.base import REGISTRY, Estimator, Sums, estimator_named

__all__ = ["REGISTRY", "Estimator", "Sums", "estimator_named", "variance_name"]

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")


def variance_name(kind: str) -> str:
    """Return DT0064's name of the square of a deviation: ``OAVAR`` of ``oadev``."""
    return estimator_named(kind).variance_name
