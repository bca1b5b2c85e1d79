"""Whether a log can have the use that a campaign gives it, given the logs of a bundle's fit."""

from __future__ import annotations

from sysid.errors import input_error
from sysid.io.logs import Log
from sysid.parameters.bundle import Bundle
from sysid.parameters.provenance import family


def check_log(bundle: Bundle, log: Log, kind: str, use: str) -> None:
    """InputError where a campaign's log cannot have this use, given what was fitted.

    A training log has to be the one that was fitted, if one of its name was; a held-out log
    must not have been fitted, and may be a new recording under an old name.
    """
    if use == "holdout":
        check_not_fitted(bundle, log)
    else:
        check_log_unchanged(bundle, log, kind)


def check_log_unchanged(bundle: Bundle, log: Log, kind: str) -> None:
    """InputError where a log of `kind` has changed since the bundle was fitted on it.

    Logs of several folders may share a name: one of that name has to match.
    """
    logs = bundle.provenance.logs
    fitted = any(
        e.use == "fit" and e.file == log.path.name and e.family == family(kind) for e in logs
    )
    if fitted and all(e.sha256 != log.sha256 for e in logs):
        raise input_error(
            bundle.source,
            f"{log.path.name} has changed since this bundle was fitted on it (SHA-256)",
            "fit again, or restore the old log",
        )


def check_not_fitted(bundle: Bundle, log: Log) -> None:
    """InputError where a log that the campaign holds out is one that it was fitted on."""
    for entry in bundle.provenance.logs:
        if entry.use == "fit" and entry.sha256 == log.sha256:
            raise input_error(
                log.path,
                f"is held out in the campaign, but {bundle.source} was fitted on it ({entry.file})",
                'fit without it, or give it use = "fit"',
            )


__all__ = ["check_log", "check_log_unchanged", "check_not_fitted"]
