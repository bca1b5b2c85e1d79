"""Commands that succeed: what each prints and writes, on small inputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from golden_folder import GOLDEN, Folder

COMMANDS = (
    *("", "fit", "fit friction", "fit valve-discrete", "fit valve-pwm", "fit campaign", "check"),
    *("convert", "validate", "diagnose", "refine", "simulate", "control", "run", "demo"),
    *("export", "effects", "init", "compare", "fleet"),
)


@dataclass(frozen=True)
class Run:
    """One command. `exact`: no number of it comes from a computation. `written`: text files."""

    words: str
    bundle: str | None = None
    bundled: tuple[str, ...] = ()
    points: bool = False
    exact: bool = False
    written: tuple[str, ...] = field(default=())

    def prepare(self, folder: Folder) -> list[str]:
        """Put the inputs in place; the command's words."""
        folder.bundled(*self.bundled)
        if self.bundle:
            folder.bundle(self.bundle)
        if self.points:
            for source in _points():
                folder.write(source.name, source.read_bytes().decode())
        return self.words.split()


def _points() -> list[Path]:
    return sorted((GOLDEN / "inputs" / "points").iterdir())


_STATIC, _SLIDING = "friction_static.parquet", "friction_sliding.parquet"
_DISCRETE, _PWM = "valve_discrete_a.parquet", "valve_pwm_a.parquet"
_SIMULATE = "simulate motion.csv --bundle bundle.json -o out.csv"
_POINTS = "campaign.toml --bundle bundle.json"

RUNS: dict[str, Run] = {
    **{f"help: {name or 'sysid'}": Run(f"{name} --help", exact=True) for name in COMMANDS},
    "version": Run("--version", exact=True),
    "check": Run(f"check {_STATIC} motion.csv", bundled=(_STATIC,)),
    "check, json": Run(f"check {_STATIC} motion.csv --json", bundled=(_STATIC,)),
    "fit friction": Run(f"fit friction {_SLIDING} {_STATIC}", bundled=(_SLIDING, _STATIC)),
    "fit friction, json": Run(
        f"fit friction {_SLIDING} {_STATIC} --json -o out.json",
        bundled=(_SLIDING, _STATIC),
        written=("out.json",),
    ),
    "fit friction, one part": Run(f"fit friction {_SLIDING}", bundled=(_SLIDING,)),
    "fit valve-discrete": Run(f"fit valve-discrete {_DISCRETE}", bundled=(_DISCRETE,)),
    "fit valve-discrete into": Run(
        f"fit valve-discrete {_DISCRETE} --into bundle.json --json",
        bundle="friction_partial",
        bundled=(_DISCRETE,),
        written=("bundle.json",),
    ),
    "fit valve-pwm": Run(f"fit valve-pwm {_PWM} --surface bipolynomial --json", bundled=(_PWM,)),
    "fit campaign": Run("fit campaign.toml -o out.json", points=True, written=("out.json",)),
    "fit campaign, json": Run("fit campaign.toml --json", points=True),
    "diagnose": Run(
        f"diagnose {_POINTS} -o out.json --json",
        "points_fitted",
        points=True,
        written=("out.json",),
    ),
    "simulate": Run(_SIMULATE, "diagnosed", written=("out.csv",)),
    "simulate, json": Run(f"{_SIMULATE} --json", "diagnosed"),
    "validate": Run("validate motion.toml --bundle bundle.json", "diagnosed"),
    "validate, json": Run("validate motion.toml --bundle bundle.json --json", "diagnosed"),
    "export": Run("export bundle.json --format json -o out.x", "diagnosed"),
    "export, json": Run("export bundle.json --format c -o out.x --json", "friction_partial"),
    "convert": Run(
        "convert motion.csv -o log.csv --rows 0:20 --set test=7", exact=True, written=("log.csv",)
    ),
    "convert, json": Run(
        "convert motion.csv -o log.csv --json --map theta_rad=theta_rad:deg --rows ::3",
        written=("log.csv",),
    ),
    "effects": Run("effects", exact=True),
    "effects, json": Run("effects --json", exact=True),
    "effects, one": Run("effects seal-friction"),
    "effects, one, json": Run("effects seal-friction --json"),
    "init": Run("init new.toml", exact=True, written=("new.toml",)),
    "init, linear": Run("init new.toml --linear", exact=True, written=("new.toml",)),
    "init, campaign": Run("init campaign.toml", exact=True, written=("campaign.toml",)),
    "init, force": Run("init rig.toml --force", exact=True, written=("rig.toml",)),
}
