"""Results that tests of several files need, made once in a run of the tests.

The workers of pytest-xdist share one folder: who comes first makes a result, others wait for it
and read it.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import pytest

from sysid.io.bundled import bundled_campaign
from sysid.parameters import Bundle

Result = TypeVar("Result")


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[], Result]) -> Result:
    """What `make` returns, by the first of all workers that asks for the `name`.

    Each caller has a copy of its own, through a pickle.
    """
    base = factory.getbasetemp()
    folder = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    path = folder / f"{name}.pickle"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            path.write_bytes(pickle.dumps(make()))
    result: Result = pickle.loads(path.read_bytes())
    return result


@dataclass(frozen=True)
class CommandFit:
    """`sysid fit CAMPAIGN --json` on the bundled campaign: exit status, output, and the bundle as
    the fit made it, before it was written."""

    code: int
    output: str
    bundle: Bundle


def bundled_fit(factory: pytest.TempPathFactory) -> CommandFit:
    """The bundled campaign, fitted from the command line."""
    return made_once(factory, "bundled_fit", _fit_bundled)


def _fit_bundled() -> CommandFit:
    from sysid.commands.app import main
    from sysid.pipeline.fit import CampaignFit, fit_campaign

    found: list[CampaignFit] = []

    def kept(*args: Any, **options: Any) -> CampaignFit:
        found.append(fit_campaign(*args, **options))
        return found[-1]

    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
        patch.setattr("sysid.pipeline.fit.fit_campaign", kept)
        code = main(["fit", str(bundled_campaign()), "--json"])
    return CommandFit(code, printed.getvalue(), found[0].bundle)
