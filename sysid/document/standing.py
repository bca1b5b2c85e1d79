"""A section that cannot be made does not end its page: it says so, and why."""

from __future__ import annotations

from collections.abc import Callable

from sysid.document.blocks import Section
from sysid.parallel import Failure, on_its_own


def section_or_why(id: str, title: str, build: Callable[[], Section | None]) -> Section | None:
    """The section that `build` makes, None where it has no content.

    Where it cannot be made, a section of this id and title that says why.
    """
    built = on_its_own(build)
    if not isinstance(built, Failure):
        return built
    return Section(id, title, (f"This section could not be made: {built.reason}.",))


__all__ = ["section_or_why"]
