"""Units as people write them: the factor and offset that turn a reading into SI.

Anything that pint knows, and what it lacks or reads otherwise: spellings (`NM`, `KPA`, `1/min`,
`m3/h`), gauge and absolute pressures, mass flows given as a volume at a standard state, ratios
(`1/255`). What has two meanings is refused with the choice.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from typing import Any, NamedTuple

from sysid.errors import InputError, input_error

# The name of each SI unit's quantity in a message, and the units to choose from.
_KINDS = {
    "s": ("a time", "s, ms, us, min"),
    "Pa": ("a pressure", "Pa, kPa, MPa, bar, mbar, psi, with (g) for gauge"),
    "rad": ("an angle", "rad, mrad, deg, turn"),
    "rad/s": ("an angular velocity", "rad/s, deg/s, rpm"),
    "m/s": ("a velocity", "m/s, mm/s, in/s"),
    "m": ("a length", "m, cm, mm, um, inch"),
    "count": ("a number of encoder counts", "count"),
    "dimensionless": ("a ratio", "percent, or a bare factor such as 0.01 or 1/255"),
    "N*m": ("a torque", "Nm, mNm, Ncm, lbf*ft"),
    "N": ("a force", "N, kN, mN, kgf, lbf"),
    "V": ("a voltage", "V, mV"),
    "kg/s": (
        "a mass flow",
        "kg/s, g/s, l/min(ANR), scfm, or the value of one step, such as 2.0e-5 kg/s",
    ),
    "K": ("a temperature", "K, degC, degF"),
    "A": ("a current", "A, mA"),
    "m**3/s": ("a volume flow", "m3/s, l/min"),
    "kg": ("a mass", "kg, g"),
}
# Common spellings that pint lacks, or reads as something else ("Nm" as number-metre). Capitals are
# those of headings; where they change the meaning (mV and MV) a unit is taken as it stands.
_ALIASES = {
    **dict.fromkeys(("Nm", "NM", "Newtonmeter", "newtonmeter", "N m"), "N*m"),
    "mNm": "mN*m",
    "kNm": "kN*m",
    "Ncm": "N*cm",
    "Nmm": "N*mm",
    "ozin": "force_ounce*inch",
    "psig": "psi(g)",
    "psia": "psi(a)",
    "PSI": "psi",
    "Psi": "psi",
    "PSIG": "psi(g)",
    "PSIA": "psi(a)",
    "Bar": "bar",
    "BAR": "bar",
    "BARG": "bar(g)",
    "BARA": "bar(a)",
    "mBar": "mbar",
    "MBAR": "mbar",
    "KPA": "kPa",
    "KPa": "kPa",
    "MPA": "MPa",
    "HPA": "hPa",
    "PA": "Pa",
    "Torr": "torr",
    "TORR": "torr",
    **dict.fromkeys(("mmWS", "mmWC", "mmwc"), "mmH2O"),
    **dict.fromkeys(("inWC", "inwc", "iwc", "INH2O", "in.H2O", "in H2O", "inchH2O"), "inH2O"),
    "mbar H2O": "cmH2O",
    "at": "technical_atmosphere",
    "REV": "turn",
    "Grad": "deg",
    "DEG": "deg",
    "Deg": "deg",
    "KN": "kN",
    "Newton": "N",
    "Pascal": "Pa",
    "deg C": "degC",
    "° C": "degC",
    "deg F": "degF",
    "newtons": "N",
    "SEC": "s",
    "Sec": "s",
    "Second": "s",
    "Seconds": "s",
    "Volt": "V",
    "Volts": "V",
    "VOLT": "V",
    "volts": "V",
    "MM": "mm",
    "Meter": "m",
    "RPM": "rpm",
    "Rpm": "rpm",
    "Celsius": "degC",
    "Kelvin": "K",
    "Percent": "percent",
    "PERCENT": "percent",
    "Prozent": "percent",
    "cfm": "ft**3/min",
    "CFM": "ft**3/min",
    **dict.fromkeys(("lpm", "LPM"), "L/min"),
    **dict.fromkeys(
        ("Counts", "COUNTS", "cnt", "cts", "pulse", "pulses", "tick", "ticks"), "count"
    ),
    **dict.fromkeys(("step", "steps", "inc", "increment", "increments", "Inkremente"), "count"),
    **dict.fromkeys(("digit", "digits", "LSB"), "count"),
    **dict.fromkeys(("1", "-", "ratio", "unitless", "none"), "dimensionless"),
}
_SIGNS = str.maketrans(
    {
        **dict.fromkeys("·⋅∙•×", "*"),
        **dict.fromkeys("µμ", "u"),
        **dict.fromkeys("\u2212\u2010\u2011", "-"),
        **dict.fromkeys("\u00a0\u2009\u202f", " "),
        "º": "°",
        "²": "**2",
        "³": "**3",
        "℃": "degC",
        "℉": "degF",
    }
)
# What a misspelt unit is compared with.
_COMMON_UNITS = (
    *("s", "ms", "us", "min", "Pa", "kPa", "MPa", "hPa", "bar", "mbar", "barg", "bara"),
    *("psi", "psig", "atm", "torr", "mmHg", "kgf/cm**2", "rad", "mrad", "deg", "turn", "cycle"),
    *("m", "cm", "mm", "um", "inch", "count", "counts", "percent", "Nm", "mNm", "Ncm", "lbf*ft"),
    *("N", "kN", "mN", "kgf", "lbf", "V", "mV", "K", "degC", "degF", "mm/s", "deg/s", "rpm"),
    *("inH2O", "mmH2O", "l/min(ANR)", "m3/h(ANR)", "scfm", "slpm", "sccm"),
)
# A unit of another kind that is written for the one meant.
_MEANT = {
    "C": ("degC",),
    "F": ("degF",),
    "lb": ("lbf",),
    "lbs": ("lbf",),
    "oz": ("ozf",),
    "kg": ("kgf",),
    "g": ("gf", "g_0"),
    "kg/cm**2": ("kgf/cm2",),
    "lb/in**2": ("psi",),
    "lbs/in**2": ("psi",),
    **dict.fromkeys(("in*lb", "in*lbs", "lb*in", "lbs*in", "inch*lb"), ("in*lbf",)),
    **dict.fromkeys(("ft*lb", "ft*lbs", "lb*ft", "lbs*ft"), ("lbf*ft",)),
    **dict.fromkeys(("oz*in", "in*oz", "oz*inch"), ("ozf*in",)),
    **dict.fromkeys(("kg*cm", "kp*cm"), ("kgf*cm",)),
    "kg*m": ("kgf*m",),
    "g*cm": ("gf*cm",),
    "S": ("s",),
}
# SI values of units that are often mistaken for SI, the likeliest first.
TAKEN_FOR_SI = {
    "Pa": {"Pa": 1.0, "mbar": 1e2, "kPa": 1e3, "psi": 6894.757, "bar": 1e5, "MPa": 1e6},
    "s": {"ms": 1e-3, "us": 1e-6, "min": 60.0},
    "rad": {"deg": math.pi / 180.0, "rev": 2.0 * math.pi, "mrad": 1e-3},
    "m": {"mm": 1e-3, "um": 1e-6, "cm": 1e-2},
    "rad/s": {"deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi},
    "m/s": {"mm/s": 1e-3, "m/min": 1.0 / 60.0, "in/s": 0.0254},
}
# Both are written for one unit: the choice is the user's.
_TWO_MEANINGS = {
    ("rad", "grad"): ("may be a degree or a gon", "write deg or gon"),
    **{
        ("rad/s", name): (
            "may be turns or radians per second",
            "write rev/s or rad/s",
        )
        for name in ("1/s", "Hz", "s^-1", "s**-1", "s-1", "1/sec", "hertz")
    },
}
# What pint takes for a length or a speed, and a heading or a person hardly does.
_NO_UNITS = {
    **dict.fromkeys(("c", "c_0", "speed_of_light"), ("is the speed of light", "m/s, mm/s or in/s")),
    **dict.fromkeys(
        ("px", "pixel", "pixels"),
        ("is no length: it depends on the picture", "the value of one, such as 0.05 mm"),
    ),
}
_PER_MINUTE = re.compile(
    r"(?:1|u|r|rev|revs|umdr\.?|upm|tr)/min|min(?:\^|\*\*)?-1|u\.?p\.?m\.?", re.I
)


class StandardState(NamedTuple):
    """A state at which a volume of gas is counted: pressure in Pa, temperature in K.

    `density` is that of the air which the standard means, kg/m3.
    """

    name: str
    density: float
    pressure: float
    temperature: float

    def density_of(self, gas_constant: float) -> float:
        """Of a dry gas with this constant, J/(kg K), there: kg/m3."""
        return self.pressure / (gas_constant * self.temperature)


_ANR = StandardState("ISO 8778: 20 degC, 100 kPa, 65 % humidity", 1.185, 1e5, 293.15)
_DIN_1343 = StandardState("DIN 1343: 0 degC, 101.325 kPa, dry", 1.2929, 101325.0, 273.15)
_SEMI_E12 = StandardState("SEMI E12: 0 degC, 101.325 kPa, dry", 1.2929, 101325.0, 273.15)
_SCFM = StandardState("68 degF, 14.696 psi(a), dry", 1.2041, 101325.0, 293.15)
_ISO_13443 = StandardState("ISO 13443: 15 degC, 101.325 kPa, dry", 1.225, 101325.0, 288.15)
_STANDARD_FLOWS = {
    **dict.fromkeys(("slpm", "slm", "sl/min"), ("l/min", _SEMI_E12)),
    **dict.fromkeys(("sccm", "scm3/min", "sml/min"), ("cm**3/min", _SEMI_E12)),
    **dict.fromkeys(("scfm", "sft3/min"), ("ft**3/min", _SCFM)),
    "scfh": ("ft**3/hour", _SCFM),
    "sm3/h": ("m**3/hour", _ISO_13443),
    **dict.fromkeys(("nl/min", "nlpm", "ln/min", "l/min(n)"), ("l/min", _DIN_1343)),
    "nl/s": ("l/s", _DIN_1343),
    "nl/h": ("l/hour", _DIN_1343),
    **dict.fromkeys(("nml/min", "mln/min"), ("ml/min", _DIN_1343)),
    "nm3/min": ("m**3/min", _DIN_1343),
    **dict.fromkeys(("nm3/h", "m3/h(n)", "mn3/h"), ("m**3/hour", _DIN_1343)),
}
_REFERENCE_STATES = {"anr": _ANR, "iso8778": _ANR, "din1343": _DIN_1343}

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_RATIO = re.compile(rf"(?P<over>{_NUMBER.pattern})\s*/\s*(?P<number>{_NUMBER.pattern})")
_REFERENCE = re.compile(
    r"(?:\s*\(\s*(g|gauge|gage|r|rel|relative|a|abs|absolute)\s*\)|\s+(gauge|gage|rel|abs|absolute|g|a))"
    r"\s*$",
    re.IGNORECASE,
)
_STATE = re.compile(r"\s*\(?\s*(anr|iso\s*8778|din\s*1343)\s*\)?\s*$", re.IGNORECASE)
_OVER_NUMBER = re.compile(r"(?P<unit>[^\d\s/][^/]*)/(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)")
_ONE_OVER = re.compile(
    rf"(?P<over>{_NUMBER.pattern})\s*/\s*(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)\s*\*?\s*"
    r"(?P<unit>[^\d\s/].*)"
)
# Two numbers, or what a sensor gives for a quantity: "25 psi/V (V - 0.5)".
_LIKE_RANGE = re.compile(rf"{_NUMBER.pattern}.*[^\d.eE]{_NUMBER.pattern}|/\s*m?[AV]\b")
_RANGE = "a sensor's range is written as 0.5..4.5 V -> 0..100 psi(g)"
_POWER = re.compile(r"(?<![A-Za-z])(mm|cm|dm|km|m|inch|in|ft|sec|s|min|h)(\d)(?![A-Za-z\d])")
# Units that pint lacks, within a product or quotient.
_LACKING = {"rev": "turn", "revs": "turn", "kp": "kgf"}
_LACKED = re.compile(rf"(?<![A-Za-z])({'|'.join(_LACKING)})(?![A-Za-z])")
_PRODUCT = re.compile(r"(?<=[A-Za-z])[-.](?=[A-Za-z])")
_COMMA = re.compile(r"[+-]?\d*,\d")
LARGEST = 1e12
"""Upper limit in SI: no time, pressure, angle, force, voltage, flow or temperature of a log is
larger."""


class Conversion(NamedTuple):
    """SI value = `factor` * reading + `offset`, plus the atmosphere where `gauge` is True.

    `gauge` is None where neither gauge nor absolute is written; `remark` says what a unit was
    taken for where it does not say so itself; `standard` is the state at which a volume of air is
    counted, of one that is a mass by it.
    """

    gauge: bool | None
    factor: float
    offset: float
    remark: str = ""
    standard: StandardState | None = None


def parse_unit(text: str, si: str, where: str) -> Conversion:
    """What turns a reading in unit `text` into the SI unit `si`.

    `si` is a unit of `CANONICAL_UNITS`, or of a component's column ("": a ratio); `where` opens the
    message of an InputError. The offset never includes the atmosphere.
    """
    si = _known(si) if si else "dimensionless"
    text = _stripped(text)
    if len(text) > 80:
        raise _unknown_unit(text[:20] + "...", si, where)
    if is_ratio(si) and (ratio := _RATIO.fullmatch(text)):
        return Conversion(None, _quotient(ratio, where), 0.0)
    if si == "kg/s" and (flow := _standard_flow(text, where)) is not None:
        return flow
    if _COMMA.match(text):
        raise input_error(where, f"{text!r} has a comma", "write numbers with a decimal point")
    if (ratio := _RATIO.fullmatch(text)) is not None:
        raise input_error(where, f"{text!r} has no unit", f"write {text} {si.replace('*', '')}")
    multiple, unit = _split_multiple(per_number(text), where)
    unit, gauge = _split_reference(unit)
    if gauge is not None and si != "Pa" and not _is_same_kind("Pa", si):
        said = "gauge" if gauge else "absolute"
        raise input_error(
            where,
            f"{text!r} is declared {said}, but {_kind_of(si)[0]} is expected",
            f"omit the {'(g)' if gauge else '(a)'}",
        )
    if not unit:
        if not is_ratio(si) and multiple is not None:
            raise input_error(where, f"{text!r} has no unit", f"write {text} {si.replace('*', '')}")
        return Conversion(gauge, 1.0 if multiple is None else multiple, 0.0)
    try:
        factor, offset = _pint_factor(unit, si, where)
    except InputError as error:
        if multiple is None or not _LIKE_RANGE.search(text):
            raise
        raise InputError(f"{error}; {_RANGE}") from None
    return Conversion(gauge, factor if multiple is None else multiple * factor, offset)


def is_ratio(si: str) -> bool:
    """Whether a bare factor is a unit of this quantity's."""
    return si in ("", "dimensionless", "count")


def without_multiple(text: str) -> str | None:
    """The unit of a multiple (`35.15 N`: N), as a raw reading's is written; None for another."""
    multiple, unit = _split_multiple(per_number(_stripped(text)), "")
    return None if multiple is None else unit


def ratio_of(unit: str, other: str) -> float | None:
    """How many of `other` one `unit` is; None for different quantities or an unknown unit."""
    try:
        ours, theirs = (_split_reference(_stripped(u))[0] for u in (unit, other))
        if not _is_same_kind(ours, theirs):
            return None
        return float(_registry().Quantity(1.0, _parsed(ours)).to(_parsed(theirs)).magnitude)
    except Exception:  # pint and its tokenizer raise a dozen kinds
        return None


def in_any_capitals(unit: str, si: str) -> str:
    """A unit as headings write it, "KPA", "nm" of a torque, in the capitals that `si` asks for.

    Unchanged where it is one of this quantity as it stands, or in no capitals.
    """
    if unit not in (si, si.replace("*", "")) and ratio_of(unit, si) is None:
        for known in _COMMON_UNITS:
            if known.lower() == unit.lower() and ratio_of(known, si) is not None:
                return known
    return unit


def check_unit(unit: str, where: str) -> None:
    """InputError, which begins with `where`, for an unknown unit; an empty one is accepted."""
    try:
        if unit not in ("", "1"):
            _parsed(unit)
    except Exception:  # pint and its tokenizer raise a dozen kinds
        close = _closest(unit)
        fix = f"did you mean {close}?" if close else "write it as N*m or kg/s; a ratio has none"
        raise input_error(where, f"{unit!r} is not a known unit", fix) from None


def _quotient(ratio: re.Match[str], where: str) -> float:
    over, number = float(ratio["over"]), float(ratio["number"])
    if not (math.isfinite(over) and math.isfinite(number) and over and number):
        raise input_error(where, f"the ratio {ratio.group()} is unusable", "give another")
    return over / number


def _stripped(text: str) -> str:
    """A unit without the brackets of a heading, its signs those of a keyboard."""
    text = text.translate(_SIGNS).strip()
    if text[:1] == "[" and text[-1:] == "]":
        text = text[1:-1].strip()
    return text


def _known(unit: str) -> str:
    """A unit as pint writes it."""
    for text in (unit, _PRODUCT.sub("*", unit)):
        if text in _ALIASES:
            return _ALIASES[text]
    powers = _POWER.sub(r"\1**\2", _PRODUCT.sub("*", unit))
    return _LACKED.sub(lambda match: _LACKING[match[0]], powers)


def _parsed(unit: str) -> Any:
    # Brackets belong to Python's expressions, never to a unit that a person writes.
    if re.search(r"[\[\]{}=;,'\"]", unit):
        raise ValueError(unit)
    return _registry().parse_units(_known(unit))


def _standard_flow(text: str, where: str) -> Conversion | None:
    """A volume flow at a standard state as a mass flow; None for another unit."""
    multiple, unit = _split_multiple(text, where)
    times = 1.0 if multiple is None else multiple
    state = _STATE.search(unit)
    if state is not None:
        volume = unit[: state.start()]
        standard = _REFERENCE_STATES[re.sub(r"\s", "", state[1]).lower()]
        factor = times * _mass_of(volume, standard.density, where)
        return Conversion(None, factor, 0.0, standard=standard)
    found = _STANDARD_FLOWS.get(re.sub(r"[\s_*]", "", unit).lower())
    if found is None:
        return None
    volume, standard = found
    remark = (
        f"{unit} is taken at {standard.name} ({standard.density:g} kg/m3); other states: "
        "l/min(ANR) for ISO 8778, l/min(DIN 1343)"
    )
    factor = times * _mass_of(volume, standard.density, where)
    return Conversion(None, factor, 0.0, remark, standard)


def _mass_of(volume: str, density: float, where: str) -> float:
    """kg/s of one unit of a volume flow: of a litre a minute exactly its 60,000th part."""
    factor = _pint_factor(volume, "m**3/s", where)[0]
    parts = round(1.0 / factor)
    return density / parts if math.isclose(parts * factor, 1.0) else density * factor


def per_number(text: str) -> str:
    """`V/341.33`, `1/341.33 V` and `12/255 V`, of a converter's counts, as `0.0029297 V`."""
    over = _OVER_NUMBER.fullmatch(text) or _ONE_OVER.fullmatch(text)
    if over is None or not float(over["number"]):
        return text
    one = float(over.groupdict().get("over", 1.0))
    return f"{one / float(over['number'])!r} {over['unit']}"


def _split_multiple(text: str, where: str) -> tuple[float | None, str]:
    """A leading number and the rest; `1/s` is a unit, not a multiple."""
    match = _NUMBER.match(text)
    if match is None or text[match.end() :].lstrip().startswith("/"):
        return None, text
    multiple = float(match.group())
    if not math.isfinite(multiple) or multiple == 0.0:
        raise input_error(where, f"the multiple {match.group()} is unusable", "give another")
    rest = text[match.end() :].lstrip()
    return multiple, rest.removeprefix("*").lstrip()


def _split_reference(unit: str) -> tuple[str, bool | None]:
    """The unit without its `(g)` or `(a)`, and whether it was gauge."""
    if (meant := _ALIASES.get(unit, "")).endswith(")"):  # psig, BARG
        unit = meant
    match = _REFERENCE.search(unit)
    if match is not None:
        said = (match[1] or match[2]).lower()
        return _known(unit[: match.start()]), said.startswith(("g", "r"))
    # barg, mbarg, kPaa and similar; no pressure unit of pint itself ends like this.
    if re.fullmatch(r"[kMhm]?(?:Pa|bar)[ _]?[ga]", unit):
        return unit[:-1].rstrip(" _"), unit.endswith("g")
    return unit, None


@functools.cache
def _registry() -> Any:
    """Pint's registry; half a second to import, so only where a unit needs it."""
    import pint

    return pint.UnitRegistry()


def _pint_factor(unit: str, si: str, where: str) -> tuple[float, float]:
    """Factor and offset of a plain unit, neither gauge nor a multiple."""
    if unit in (si, si.replace("*", "")):
        return 1.0, 0.0
    if si == "rad/s" and _PER_MINUTE.fullmatch(unit):
        unit = "rpm"
    if (two := _TWO_MEANINGS.get((si, unit))) is not None:
        raise input_error(where, f"{unit!r} {two[0]}", two[1])
    if (none := _NO_UNITS.get(unit)) is not None and si in ("m", "m/s"):
        raise input_error(where, f"{unit!r} {none[0]}", f"write {none[1]}")
    registry = _registry()
    try:
        parsed = _parsed(unit)
        same = _is_same_kind(unit, si)
    except Exception:  # pint and its tokenizer raise a dozen kinds
        raise _unknown_unit(unit, si, where) from None
    if not same:
        raise _wrong_kind(unit, parsed, si, where)
    offset = float(registry.Quantity(0.0, parsed).to(si).magnitude)
    if offset == 0.0:
        return float(registry.Quantity(1.0, parsed).to(si).magnitude), 0.0
    delta = registry.parse_units(f"delta_{parsed}")
    return float(
        registry.Quantity(1.0, delta).to(f"delta_{si}" if "deg" in si else si).magnitude
    ), offset


def _unknown_unit(unit: str, si: str, where: str) -> InputError:
    kind, examples = _kind_of(si)
    close = _closest(unit)
    fix = f"did you mean {close}?" if close else f"give a unit of {kind}: {examples}"
    return input_error(where, f"{unit!r} is not a known unit", fix)


def _kind_of(si: str) -> tuple[str, str]:
    """The name of a unit's quantity, and units to choose from."""
    return _KINDS.get(si, (f"a quantity in {si}", si))


def _closest(unit: str) -> str | None:
    for known in _COMMON_UNITS:
        if known.lower() == unit.lower() and known != unit:
            return known
    close = difflib.get_close_matches(unit, _COMMON_UNITS, 1, 0.6)
    return close[0] if close and close[0] != unit else None


def _wrong_kind(unit: str, parsed: Any, si: str, where: str) -> InputError:
    registry = _registry()
    root = registry.get_root_units(parsed)[1]
    found = next(
        (kind for known, (kind, _) in _KINDS.items() if registry.get_root_units(known)[1] == root),
        f"{parsed}",
    )
    kind, examples = _kind_of(si)
    what = f"{unit!r} is {found}, not {kind}"
    if si == "kg/s" and found == "a volume flow":
        return input_error(
            where,
            f"{what}: its mass depends on the state at which it is counted",
            f"write {unit}(ANR) for ISO 8778, {unit}(DIN 1343), or scfm, slpm, sccm",
        )
    if (one := meant_by(unit, si)) is not None:
        return input_error(where, what, f"did you mean {one}?")
    if is_ratio(si):
        low, high = ("0..24", "0..1") if si == "dimensionless" else ("0..10", "0..4096")
        worth = f"0.001; a sensor or a command has a range, {low} -> {high}"
    else:
        worth = f"0.5 {si.replace('*', '')}"
    return input_error(
        where,
        what,
        f"give a unit such as {examples}; for a raw reading, the value of one unit of it "
        f"(such as {worth})",
    )


def meant_by(unit: str, si: str) -> str | None:
    """The unit of this quantity that another, known one is written for: of C degC, of lb lbf."""
    meant = [*_MEANT.get(_known(unit), ())]
    meant += [one for one in _COMMON_UNITS if one.lower() == unit.lower() and one != unit]
    fitting = (one for one in meant if "(" not in one and _is_same_kind(one, si))
    if (one := next(fitting, None)) is not None:
        return one
    flows = ratio_of(unit, "m**3/s") is not None and si == "kg/s"
    return f"{unit}(ANR)" if flows else None


def _is_same_kind(unit: str, si: str) -> bool:
    """Compares root units: by dimension an angle, a ratio and a count are the same."""
    if unit == si:
        return True
    registry = _registry()
    return bool(
        registry.get_root_units(_parsed(unit))[1] == registry.get_root_units(_parsed(si))[1]
    )


__all__ = [
    "LARGEST",
    "TAKEN_FOR_SI",
    "Conversion",
    "check_unit",
    "in_any_capitals",
    "is_ratio",
    "meant_by",
    "parse_unit",
    "per_number",
    "ratio_of",
    "without_multiple",
]
