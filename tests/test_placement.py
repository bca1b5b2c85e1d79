"""Where jax computes: on the processor, whatever accelerator the user's process has for its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sysid.errors import InputError
from sysid.plant import jax_setup

TESTS = Path(__file__).resolve().parent
PARTS = ("simulation", "refinement", "loop", "histories", "component")


def test_all_that_jax_computes_for_us_lies_on_the_processor() -> None:
    """Two devices of the processor, the second one the user's default, as an accelerator is."""
    path = os.pathsep.join([str(TESTS.parent), os.environ.get("PYTHONPATH", "")])
    two = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, str(TESTS / "on_two_devices.py")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path, "XLA_FLAGS": two.strip()},
    )
    found = json.loads(done.stdout)
    processor, accelerator = found["processor"], found["accelerator"]
    assert processor != accelerator
    for part in PARTS:
        assert found[part] == {"package": [processor], "user": [accelerator]}, part
    assert found["afterwards"] == [accelerator, accelerator]


def test_a_jax_without_the_processor_is_an_error_that_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none(backend: str) -> list[object]:
        raise RuntimeError(f"Unknown backend {backend}")

    monkeypatch.setattr(jax_setup.jax, "local_devices", none)
    jax_setup._processor.cache_clear()
    try:
        expected = pytest.raises(InputError, match="JAX_PLATFORMS: excludes the processor")
        with expected, jax_setup.on_processor():
            pass
    finally:
        jax_setup._processor.cache_clear()
