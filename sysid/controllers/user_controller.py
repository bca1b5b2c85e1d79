"""A user's own controller: `my_controller.py:MyController`, loaded, made and run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

from sysid.controllers.design_model import DesignModel
from sysid.controllers.interface import Controller
from sysid.errors import SysidError, input_error
from sysid.io.user_code import error_in_file, run_file

_EXAMPLE = "derive it from sysid.controllers.interface.Controller and give it `commands`"


def split_reference(text: str) -> tuple[Path, str] | None:
    """File and class of `FILE.py:Class`; None for a text of another form."""
    file, _, name = text.rpartition(":")
    return (Path(file), name) if file.endswith(".py") and name.isidentifier() else None


def load_controller(path: Path, name: str) -> type[Controller]:
    """The class `name` of a user's file, which is run.

    Raises InputError where the file does not run, lacks the class, or the class is no
    controller.
    """
    module = run_file(path, "a controller")
    found = vars(module).get(name)
    if found is None:
        own = [k for k, v in vars(module).items() if _is_own(v, module.__name__)]
        hint = f"it defines {', '.join(own)}" if own else _EXAMPLE
        raise input_error(path, f"defines no {name}", hint)
    if not (isinstance(found, type) and issubclass(found, Controller)):
        raise input_error(f"{path}, {name}", "is not a controller", _EXAMPLE)
    if inspect.isabstract(found):
        raise input_error(f"{path}, {name}", "has no method commands", _EXAMPLE)
    return found


def _is_own(value: object, module: str) -> bool:
    return isinstance(value, type) and issubclass(value, Controller) and value.__module__ == module


def needs_design(cls: type[Controller]) -> bool:
    """Whether a class is made with the controller's model, a parameter named `design`."""
    return "design" in inspect.signature(cls).parameters


def make_controller(
    cls: type[Controller], design: Callable[[], DesignModel], path: Path | None
) -> Controller:
    """An object of the class; `design` gives the bundle's model, for a class that takes one.

    Raises InputError where the class of a file (`path`) cannot be made so.
    """
    own = {"design": design()} if needs_design(cls) else {}
    try:
        return cls(**own)
    except SysidError:
        raise
    except Exception as error:
        if path is None:
            raise
        raise error_in_file(error, path) from None


__all__ = ["load_controller", "make_controller", "needs_design", "split_reference"]
