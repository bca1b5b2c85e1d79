"""The functions of FMI that a co-simulation of real, whole and truth values has no use for.

A library has to hold them all the same; each answers that it can not.
"""

from __future__ import annotations

from sysid.exporters.c_text import indented, wrapped

_R = "const fmi{v}ValueReference*"
_GET_2 = ("fmi2Component", _R, "size_t")
_GET_3 = ("fmi3Instance", _R, "size_t")

# Name without prefix -> its arguments' types.
_ABSENT_2: dict[str, tuple[str, ...]] = {
    "GetString": (*_GET_2, "fmi2String*"),
    "SetString": (*_GET_2, "const fmi2String*"),
    "GetDirectionalDerivative": (
        *(*_GET_2, _R, "size_t"),
        *("const fmi2Real*", "fmi2Real*"),
    ),
    "SetRealInputDerivatives": (*_GET_2, "const fmi2Integer*", "const fmi2Real*"),
    "GetRealOutputDerivatives": (*_GET_2, "const fmi2Integer*", "fmi2Real*"),
    "CancelStep": ("fmi2Component",),
    "GetIntegerStatus": ("fmi2Component", "const fmi2StatusKind", "fmi2Integer*"),
    "GetStringStatus": ("fmi2Component", "const fmi2StatusKind", "fmi2String*"),
}
_NUMBERS_3 = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "String")
_REALS, _COUNTS, _FLAGS = "fmi3Float64*", "size_t", "fmi3Boolean*"
_QUALIFIERS = "fmi3IntervalQualifier*"
_FRACTION = ("fmi3UInt64*", "fmi3UInt64*")
_SET_FRACTION = ("const fmi3UInt64*", "const fmi3UInt64*")
_ABSENT_3: dict[str, tuple[str, ...]] = {
    **{f"Get{kind}": (*_GET_3, f"fmi3{kind}*", "size_t") for kind in _NUMBERS_3},
    **{f"Set{kind}": (*_GET_3, f"const fmi3{kind}*", "size_t") for kind in _NUMBERS_3},
    "GetBinary": (*_GET_3, "size_t*", "fmi3Binary*", "size_t"),
    "SetBinary": (*_GET_3, "const size_t*", "const fmi3Binary*", "size_t"),
    "GetClock": (*_GET_3, "fmi3Clock*"),
    "SetClock": (*_GET_3, "const fmi3Clock*"),
    "GetNumberOfVariableDependencies": ("fmi3Instance", "fmi3ValueReference", "size_t*"),
    "GetVariableDependencies": (
        *("fmi3Instance", "fmi3ValueReference", "size_t*", "fmi3ValueReference*", "size_t*"),
        *("fmi3DependencyKind*", "size_t"),
    ),
    **{
        f"Get{kind}Derivative": (
            *(*_GET_3, _R, "size_t"),
            *("const fmi3Float64*", "size_t", _REALS, "size_t"),
        )
        for kind in ("Directional", "Adjoint")
    },
    "EnterEventMode": ("fmi3Instance",),
    "EnterConfigurationMode": ("fmi3Instance",),
    "ExitConfigurationMode": ("fmi3Instance",),
    "GetIntervalDecimal": (*_GET_3, _REALS, _QUALIFIERS),
    "GetIntervalFraction": (*_GET_3, *_FRACTION, _QUALIFIERS),
    "GetShiftDecimal": (*_GET_3, _REALS),
    "GetShiftFraction": (*_GET_3, *_FRACTION),
    "SetIntervalDecimal": (*_GET_3, "const fmi3Float64*"),
    "SetIntervalFraction": (*_GET_3, *_SET_FRACTION),
    "SetShiftDecimal": (*_GET_3, "const fmi3Float64*"),
    "SetShiftFraction": (*_GET_3, *_SET_FRACTION),
    "EvaluateDiscreteStates": ("fmi3Instance",),
    "UpdateDiscreteStates": ("fmi3Instance", *(_FLAGS,) * 5, _REALS),
    "EnterContinuousTimeMode": ("fmi3Instance",),
    "CompletedIntegratorStep": ("fmi3Instance", "fmi3Boolean", _FLAGS, _FLAGS),
    "SetTime": ("fmi3Instance", "fmi3Float64"),
    "SetContinuousStates": ("fmi3Instance", "const fmi3Float64*", "size_t"),
    "GetContinuousStateDerivatives": ("fmi3Instance", _REALS, "size_t"),
    "GetEventIndicators": ("fmi3Instance", _REALS, "size_t"),
    "GetContinuousStates": ("fmi3Instance", _REALS, "size_t"),
    "GetNominalsOfContinuousStates": ("fmi3Instance", _REALS, "size_t"),
    "GetNumberOfEventIndicators": ("fmi3Instance", "size_t*"),
    "GetNumberOfContinuousStates": ("fmi3Instance", "size_t*"),
    "GetOutputDerivatives": (*_GET_3, "const fmi3Int32*", _REALS, "size_t"),
    "ActivateModelPartition": ("fmi3Instance", "fmi3ValueReference", "fmi3Float64"),
}
_INSTANCES_3: dict[str, tuple[str, ...]] = {
    "InstantiateModelExchange": (
        *("fmi3String",) * 3,
        *("fmi3Boolean", "fmi3Boolean", "fmi3InstanceEnvironment", "fmi3LogMessageCallback"),
    ),
    "InstantiateScheduledExecution": (
        *("fmi3String",) * 3,
        *("fmi3Boolean", "fmi3Boolean", "fmi3InstanceEnvironment", "fmi3LogMessageCallback"),
        *("fmi3ClockUpdateCallback", "fmi3LockPreemptionCallback", "fmi3UnlockPreemptionCallback"),
    ),
}


def absent_functions(version: int) -> str:
    """Their definitions in C, of FMI 2 or 3."""
    absent = _ABSENT_2 if version == 2 else _ABSENT_3
    texts = [_function(version, f"fmi{version}Status", name, a) for name, a in absent.items()]
    if version == 3:
        texts += [_function(3, "fmi3Instance", name, a) for name, a in _INSTANCES_3.items()]
    return "\n".join(texts)


def _function(version: int, kind: str, name: str, types: tuple[str, ...]) -> str:
    declared = ", ".join(
        f"{t.format(v=version)} a{k}".replace("* a", " *a") for k, t in enumerate(types)
    )
    answer = "NULL" if kind.endswith("Instance") else f"fmi{version}Error"
    head = "\n           ".join(
        wrapped(f"FMU_EXPORT({kind}, fmi{version}{name}, ({declared}))", 86)
    )
    body = [*(f"(void)a{k};" for k in range(len(types))), f"return {answer};"]
    return f"{head}\n{{\n{indented(body)}\n}}\n"


__all__ = ["absent_functions"]
