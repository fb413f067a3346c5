"""The nested sampler is optional."""

from __future__ import annotations

import sys

import pytest

from psafit.errors import InputError
from psafit.inference.samplers.nautilus import require


def test_nautilus_is_asked_for_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "nautilus", None)
    with pytest.raises(InputError, match="pip install nautilus-sampler"):
        require()
