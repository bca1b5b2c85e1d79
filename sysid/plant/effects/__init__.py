"""The catalogue of effects that the base model lacks, one class each, by subsystem.

`import sysid as si` shows it as `si.effects`. An effect's arguments are its numbers, SI, in the
order of `quantities`; a model takes it with `+`:

>>> stribeck = si.effects.StribeckFriction(0.1, 0.05)
>>> (bundle.model() + stribeck).effects[-1].stribeck_velocity_rad_per_s
0.05
>>> si.effects.catalogue()["stribeck-friction"] is si.effects.StribeckFriction
True
>>> for quantity in stribeck.quantities[:2]:
...     print(quantity.name, quantity.unit, quantity.typical)
stribeck_torque_nm Nm 0.12
stribeck_velocity_rad_per_s rad/s 0.07

A user-defined effect is a frozen dataclass that derives from `CatalogueEffect`, with one
`Quantity` per number; docs/how-to/own-effect.md has an example.
"""

from sysid.plant.effects.bench import (
    PartialOpening,
    SeriesRestriction,
    ValveDeadBand,
    ValveHysteresis,
)
from sysid.plant.effects.catalogue import catalogue, class_of, load_user_effects
from sysid.plant.effects.chamber import (
    AtmosphereLeakage,
    DeadVolumeError,
    LaminarLeakage,
    PistonLeakage,
    PolytropicExponent,
    TemperatureDrift,
    ThresholdLeakage,
    TubeLag,
    WallHeatTransfer,
)
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.effects.friction import (
    AsymmetricCoulombFriction,
    AsymmetricViscousFriction,
    LoadDependentFriction,
    PositionDependentFriction,
    PowerLawFriction,
    Presliding,
    QuadraticDrag,
    SealFriction,
    StictionAfterRest,
    StribeckFriction,
)
from sysid.plant.effects.linkage import (
    AreaError,
    Backlash,
    CableSpring,
    GearMeshRipple,
    InertiaMismatch,
    LinkFlexibility,
    MountingTilt,
    PitchEccentricity,
)
from sysid.plant.effects.motor import (
    AmplifierLag,
    TorqueConstantError,
    TorqueOffset,
    TorqueRipple,
    TorqueSaturation,
)
from sysid.plant.effects.sensor import (
    AmbientPressureError,
    EncoderEccentricity,
    LostCounts,
    PressureGain,
    PressureLag,
    PressureOffset,
    TimeSkew,
)
from sysid.plant.effects.stroke import (
    EndCushion,
    StrokeDependentArea,
    StrokeDependentSeals,
)
from sysid.plant.effects.supply import (
    ExhaustBackPressure,
    SupplyDroop,
    SupplyPulsation,
)
from sysid.plant.effects.valve import (
    ChokedExhaustScaling,
    CoilHeating,
    DutyDeadZone,
    StickingValve,
    SubsonicFlowShape,
    ValveDelay,
)

__all__ = [
    "AmbientPressureError",
    "AmplifierLag",
    "AreaError",
    "AsymmetricCoulombFriction",
    "AsymmetricViscousFriction",
    "AtmosphereLeakage",
    "Backlash",
    "CableSpring",
    "CatalogueEffect",
    "ChokedExhaustScaling",
    "CoilHeating",
    "DeadVolumeError",
    "DutyDeadZone",
    "EncoderEccentricity",
    "EndCushion",
    "ExhaustBackPressure",
    "GearMeshRipple",
    "InertiaMismatch",
    "LaminarLeakage",
    "LinkFlexibility",
    "LoadDependentFriction",
    "LostCounts",
    "MountingTilt",
    "PartialOpening",
    "PistonLeakage",
    "PitchEccentricity",
    "PolytropicExponent",
    "PositionDependentFriction",
    "PowerLawFriction",
    "Presliding",
    "PressureGain",
    "PressureLag",
    "PressureOffset",
    "QuadraticDrag",
    "Quantity",
    "SealFriction",
    "SeriesRestriction",
    "StickingValve",
    "StictionAfterRest",
    "StribeckFriction",
    "StrokeDependentArea",
    "StrokeDependentSeals",
    "SubsonicFlowShape",
    "SupplyDroop",
    "SupplyPulsation",
    "TemperatureDrift",
    "ThresholdLeakage",
    "TimeSkew",
    "TorqueConstantError",
    "TorqueOffset",
    "TorqueRipple",
    "TorqueSaturation",
    "TubeLag",
    "ValveDeadBand",
    "ValveDelay",
    "ValveHysteresis",
    "WallHeatTransfer",
    "catalogue",
    "class_of",
    "load_user_effects",
]
