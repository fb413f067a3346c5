"""The samplers: one file each, named as the sampler is. This is their registry.

To add one, write its file here, with a `SAMPLER` (`psafit.inference.sampling.Sampler`) in it. Nothing else names it.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from typing import TYPE_CHECKING, cast

from psafit.errors import InputError

if TYPE_CHECKING:
    from psafit.inference.sampling import Sampler

USUAL = "emcee"
"""The one that a run takes where none is asked for."""


def names() -> list[str]:
    """Names of all samplers; none of them is imported."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_"))


def sampler(name: str) -> Sampler:
    """The sampler of a name; `InputError` where there is none, or where it lacks what a sampler has."""
    if name not in names():
        near = difflib.get_close_matches(name, names(), n=1)
        raise InputError(f"there is no sampler {name!r}", f"choose of {', '.join(near or names())}")
    from psafit.inference.sampling import Sampler

    found = importlib.import_module(f"{__name__}.{name}").SAMPLER
    if lacking := [part for part in vars(Sampler) if not part.startswith("_") and not hasattr(found, part)]:
        raise InputError(f"sampler {name!r} lacks {', '.join(lacking)}", "psafit.inference.sampling.Sampler has them")
    return cast(Sampler, found)
