"""The one place where jax is configured: 64 bit, a compilation cache that persists, the processor.

Import jax through this module (`from sysid.plant.jax_setup import jax, jnp`), and have what makes
arrays or calls compiled functions within `on_processor`: a simulation is many small operations one
after the other, which an accelerator does far slower than the processor.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sysid.errors import input_error

# A simulation is one loop of many small operations. Below this size of its buffers XLA
# compiles the whole loop to one function; above, it schedules each operation in every pass,
# which costs ten times the arithmetic. LLVM may not unroll what runs over the lanes of a block: it
# would before it makes vectors of them, and then makes none. Unknown options are ignored.
_ONE_FUNCTION = "xla_cpu_small_while_loop_byte_threshold=1000000000"
_VECTORS = "-unroll-full-max-count=1"
if "xla_backend_extra_options" not in os.environ.get("XLA_FLAGS", ""):
    _OPTIONS = f"--xla_backend_extra_options={_ONE_FUNCTION},{_VECTORS}"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_OPTIONS}".strip()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402

CACHE_FOLDER = "sysid/jax"


def cache_directory() -> Path:
    """`$XDG_CACHE_HOME/sysid/jax`, or under `~/.cache`."""
    home = os.environ.get("XDG_CACHE_HOME")
    # The XDG specification has relative paths ignored.
    base = Path(home) if home and Path(home).is_absolute() else Path.home() / ".cache"
    return base / CACHE_FOLDER


@contextmanager
def on_processor() -> Iterator[None]:
    """Within this block, or the function that it decorates, jax's arrays lie on the processor.

    In this thread alone, and whatever devices jax has found: the default of the user's own process
    is untouched. Raises InputError where jax is set up without the processor.
    """
    with jax.default_device(_processor()):
        yield


@functools.cache
def _processor() -> Any:
    try:
        return jax.local_devices(backend="cpu")[0]
    except RuntimeError:
        raise input_error(
            "JAX_PLATFORMS",
            "excludes the processor, on which models are simulated",
            "add cpu, as in JAX_PLATFORMS=cuda,cpu",
        ) from None


def _configure() -> None:
    config: Any = jax.config
    config.update("jax_enable_x64", True)
    # A cache that the user has set up (JAX_COMPILATION_CACHE_DIR) is kept.
    if config.jax_compilation_cache_dir is None:
        directory = cache_directory()
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            return  # a home that cannot be written to: compile in every process
        config.update("jax_compilation_cache_dir", str(directory))
    config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    config.update("jax_persistent_cache_min_entry_size_bytes", -1)


_configure()

__all__ = ["cache_directory", "jax", "jnp", "on_processor"]
