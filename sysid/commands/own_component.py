"""A campaign as a command reads it: `--component FILE`, and that it runs said; `--exclude`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.io.campaign import Campaign, read_campaign
from sysid.io.own_kind import OwnKind
from sysid.types import Progress


def read_with(
    path: Path, component: str | None, tell: Progress, exclude: Sequence[str] = ()
) -> Campaign:
    """The campaign; with `component`, as text of the option, its logs are of that.

    `exclude`: what is not read of them, as texts of `--exclude`. Raises InputError for a file that
    cannot be used, and where an excluded test does not exist.
    """
    if component is None:
        return read_campaign(path).excluding(exclude)
    from sysid.components.campaign import runs_own_code
    from sysid.components.loading import with_component

    campaign = with_component(path, component)
    tell(runs_own_code(campaign))
    return campaign.excluding(exclude)


def own_kind(component: str | None, tell: Progress) -> OwnKind | None:
    """The kind of log of a component, as text of the option; None without one.

    Raises InputError for a file that cannot be used.
    """
    if component is None:
        return None
    from sysid.components.loading import one_component

    loaded = one_component(component)
    tell(f"runs the user's own code: {loaded.path} ({loaded.name})")
    return loaded


__all__ = ["own_kind", "read_with"]
