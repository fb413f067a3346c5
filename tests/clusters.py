"""A Dask cluster of two processes, as a test uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def two_workers() -> Iterator[Any]:
    """A local cluster whose workers may be killed; the test is skipped without Dask."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster
        with distributed.Client(cluster) as client:
            client.wait_for_workers(2, timeout=60)  # while it starts a worker anew, a cluster cannot be closed
