"""Files in, objects out. A path may be text or a `Path`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.io import campaign as campaigns
from sysid.io import logs
from sysid.io import rig as rigs
from sysid.io.campaign import Campaign
from sysid.io.own_kind import OwnKind
from sysid.io.rig import Rig
from sysid.io.samples import Log
from sysid.io.units import parse_map
from sysid.parameters import Bundle, files
from sysid.pipeline.request import require
from sysid.types import Progress

if TYPE_CHECKING:
    from sysid.components.loading import ComponentSource


def read_campaign(path: str | Path, *, component: ComponentSource | None = None) -> Campaign:
    """Read and check a campaign file: a rig's tests together, and what each is used for.

    The logs themselves are read when they are used. `component`: one of your own, whose logs
    these are, as a Python file (it is executed), a class or an object; every later step of the
    campaign uses it. Raises InputError, one line that names the key or entry.

    >>> campaign = si.read_campaign("campaign.toml")
    >>> [entry.file for entry in campaign.select(["friction-static"])]
    ['friction_static.parquet']
    """
    if component is not None:
        from sysid.components.loading import with_component

        return with_component(path, component)
    return campaigns.read_campaign(Path(path))


def read_rig(path: str | Path) -> Rig:
    """Read and check a rig file: constants by section, SI.

    Raises InputError, one line that names the key; an implausible value is a wrong unit.

    >>> rig = si.read_rig("rig.toml")
    >>> rig.motion, rig.position_channel, rig.pwm.period_s
    ('rotary', 'theta_rad', 0.005)
    """
    return rigs.read_rig(Path(path))


def read_log(
    path: str | Path,
    rig: Rig | str | Path | None = None,
    *,
    maps: Sequence[str] = (),
    exclude: Sequence[str] = (),
) -> Log:
    """Read and check a log (CSV or Parquet) and convert it to SI, absolute pressures.

    The rig is an object or its file; None: `rig.toml` in the log's folder or the nearest one
    above it. `maps` translates foreign columns, as `--map` does: "pressure_a_pa=P1:kPa(g)".
    `exclude` names what is not read, as `--exclude` does: a test ("7"), or a span of one in s since
    its first row ("12@3:4.5"). Raises InputError, one line that names the row or column.

    >>> log = si.read_log("run.csv", campaign.rig)
    >>> log.frame.shape[0] == sum(len(trial) for trial in log.trials)
    True
    """
    if not isinstance(rig, Rig):
        rig = read_rig(rigs.require_rig_file(Path(path)) if rig is None else rig)
    mapping = parse_map(maps)
    (excluded,) = logs.exclusions_for(exclude, [Path(path)], mapping)
    return logs.read_log(Path(path), rig, mapping, exclude=excluded)


def read_bundle(path: str | Path) -> Bundle:
    """Read and check a bundle, as `write_bundle` and `sysid fit` write it. Runs no code.

    Raises InputError that names the key.

    >>> si.write_bundle(bundle, "fitted.json")
    >>> si.read_bundle("fitted.json").to_json() == bundle.to_json()
    True
    """
    return files.read_bundle(Path(path))


def write_bundle(bundle: Bundle, path: str | Path) -> None:
    """Check a bundle against its schema and write it as JSON, whole or not at all.

    Raises InputError where the file cannot be written.

    >>> si.write_bundle(bundle, "fitted.json")
    """
    require(bundle, "bundle", "Bundle")
    files.write_bundle(bundle, Path(path))


def read_with(
    path: Path, component: str | None, tell: Progress, exclude: Sequence[str] = ()
) -> Campaign:
    """The campaign; with `component`, as text of the option, its logs are of that.

    `exclude`: what is not read of them, as texts of `--exclude`. Raises InputError for a file that
    cannot be used, and where an excluded test does not exist.
    """
    if component is None:
        return campaigns.read_campaign(path).excluding(exclude)
    from sysid.components.loading import with_component
    from sysid.components.own_tests import runs_own_code

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


__all__ = [
    "own_kind",
    "read_bundle",
    "read_campaign",
    "read_log",
    "read_rig",
    "read_with",
    "write_bundle",
]
