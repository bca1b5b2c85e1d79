"""A functional mock-up unit for co-simulation, FMI 2.0 or 3.0: description, sources, library.

What the model is, in C, comes from `fmu_plant` and `fmu_controllers`; here it gets its
modelDescription.xml, the functions of the standard around it, and a library for this machine
where a C compiler is there.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import quoteattr

from sysid.exporters.c_text import comment_text, number
from sysid.exporters.fmi_absent import absent_functions

OPTIMIZED = "-O2"
_FLAGS = ("-std=c99", "-fPIC", "-shared", "-fvisibility=hidden")
_COMPILERS = ("cc", "gcc", "clang")
_KINDS = {"r": ("Float64", "Real"), "b": ("Boolean", "Boolean"), "i": ("Int32", "Integer")}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file in the archive: the same bundle, the same bytes


Role = Literal["input", "output", "tunable", "fixed"]


@dataclass(frozen=True)
class FmuVariable:
    """A variable: its C place in the struct `model`, and what modelDescription.xml says.

    `kind` "r" real, "b" truth value, "i" whole number; `role` "input", "output", "tunable" or
    "fixed" (parameters). `start` of all but outputs; `bounds`: a parameter's interval. `is_held`:
    an input or output that changes in steps.
    """

    name: str
    place: str
    meaning: str
    role: Role
    unit: str = ""
    start: float | None = None
    bounds: tuple[float, float] | None = None
    kind: str = "r"
    is_held: bool = False


@dataclass(frozen=True)
class FmuContent:
    """A model: its C (`model.h` and what it includes, by name), and what describes it."""

    identifier: str
    title: str
    sources: dict[str, str]
    variables: tuple[FmuVariable, ...]
    step: float
    created: str
    tool: str
    notes: str


def fmu_bytes(content: FmuContent, version: str) -> tuple[bytes, list[str]]:
    """The archive, and notices; `version` "2" or "3" of FMI."""
    number_of = int(version)
    sources = dict(content.sources)
    core = _template("fmu_core.h.in")
    main = f"fmi{version}.c"
    code = _template(f"{main}.in").replace("@absent@", absent_functions(number_of))
    shape = repr([(v.name, v.place, v.role, v.kind, v.start) for v in content.variables])
    token = hashlib.sha256("\0".join([version, code, core, shape, *sources.values()]).encode())
    guid = f"{{{token.hexdigest()[:32]}}}"
    sources |= {"model.h": _with_table(sources["model.h"], content, guid), "fmu_core.h": core}
    sources[main] = code
    library, said = _library(sources, main, content.identifier, number_of)
    description = _description_2 if number_of == 2 else _description_3
    files: dict[str, bytes] = {"modelDescription.xml": description(content, guid).encode()}
    files |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    if number_of == 3:
        files["sources/buildDescription.xml"] = _build(content.identifier, main).encode()
    files["documentation/index.html"] = content.notes.encode()
    return _zipped(files | library), said


def _template(name: str) -> str:
    return resources.files("sysid.exporters").joinpath(name).read_text("utf-8")


def _zipped(files: dict[str, bytes]) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return held.getvalue()


# --- C ---------------------------------------------------------------------------------


def _with_table(text: str, content: FmuContent, guid: str) -> str:
    """model.h with its table of variables, in the order of their references: 0 is the time."""
    roles = {"input": "i", "output": "o", "tunable": "p", "fixed": "f"}
    rows = ["{0, 'r', 't', \"time\"}"]
    rows += [
        f"{{offsetof(model, {v.place}), '{v.kind}', '{roles[v.role]}', \"{comment_text(v.name)}\"}}"
        for v in content.variables
    ]
    table = ",\n".join(f"    {row}" for row in rows)
    return text.replace(
        "@table@",
        f"""\
#define MODEL_TOKEN "{guid}"
#define MODEL_VARIABLES {len(rows)}u

/* Every variable by its reference: its place, r(eal), b(oolean) or i(nteger); i(nput), o(utput),
   p (a parameter that may be tuned), f (one that is fixed) or t(ime). */
static const struct {{
    size_t place;
    char kind, causality;
    const char *name;
}} fmu_variables[MODEL_VARIABLES] = {{
{table}
}};
""",
    )


def _library(
    sources: dict[str, str], main: str, identifier: str, version: int
) -> tuple[dict[str, bytes], list[str]]:
    """The library for this machine by its place in the archive; nothing, and why, without one."""
    folder, suffix = _platform(version)
    compiler = c_compiler()
    if not folder or compiler is None:
        what = "no C compiler was found" if folder else "FMI has no name for this machine"
        return {}, [f"{what}: the FMU holds its sources alone, which importers have to compile"]
    with tempfile.TemporaryDirectory() as place:
        for name, text in sources.items():
            (Path(place) / name).write_text(text, "utf-8")
        out = f"{identifier}{suffix}"
        command = [compiler, OPTIMIZED, *_FLAGS, main, "-o", out, "-lm"]
        run = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            line = (run.stderr.strip().splitlines() or ["no message"])[0]
            said = f"{Path(compiler).name} failed ({line[:120]}): the FMU holds its sources alone"
            return {}, [said]
        return {f"binaries/{folder}/{out}": (Path(place) / out).read_bytes()}, []


def c_compiler() -> str | None:
    """The C compiler: that of the variable CC, else the first known one."""
    asked = os.environ.get("CC")
    found = map(shutil.which, [asked] if asked else _COMPILERS)
    return next((path for path in found if path), None)


def _platform(version: int) -> tuple[str, str]:
    """The folder of this machine's libraries in the archive, "" without one, and their suffix."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system, suffix = {
        "Linux": ("linux", ".so"),
        "Darwin": ("darwin", ".dylib"),
        "Windows": ("windows", ".dll"),
    }.get(platform.system(), ("", ""))
    if version == 3:
        return (f"{machine}-{system}" if system else ""), suffix
    short = {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}.get(system, "")
    return (short if machine == "x86_64" else ""), suffix


# --- descriptions ----------------------------------------------------------------------


def _attributes(**values: str | None) -> str:
    return "".join(f" {k}={quoteattr(v)}" for k, v in values.items() if v is not None)


def _text(variable: FmuVariable, value: float) -> str:
    if variable.kind == "b":
        return "true" if value else "false"
    return str(int(value)) if variable.kind == "i" else number(value)


def _identity(variable: FmuVariable, reference: int) -> dict[str, str]:
    """The attributes that say which variable it is, and who sets it when."""
    causality, variability = _causality(variable)
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.meaning,
        "causality": causality,
        "variability": variability,
    }


def _values(variable: FmuVariable) -> dict[str, str | None]:
    """The attributes of its values."""
    start = None if variable.start is None else _text(variable, variable.start)
    return {"unit": variable.unit or None, **_limits(variable), "start": start}


def _causality(variable: FmuVariable) -> tuple[str, str]:
    """Causality and variability."""
    if variable.role in ("tunable", "fixed"):
        return "parameter", variable.role
    held = variable.is_held or variable.kind != "r"
    return variable.role, "discrete" if held else "continuous"


def _limits(variable: FmuVariable) -> dict[str, str | None]:
    if variable.bounds is None:
        return {}
    pairs = zip(("min", "max"), variable.bounds, strict=True)
    return {name: _text(variable, value) for name, value in pairs if math.isfinite(value)}


def _description_3(content: FmuContent, guid: str) -> str:
    lines = [
        '    <Float64 name="time" valueReference="0" causality="independent" '
        'variability="continuous" unit="s"/>'
    ]
    outputs = []
    for reference, v in enumerate(content.variables, start=1):
        attributes = _attributes(**_identity(v, reference), **_values(v))
        lines.append(f"    <{_KINDS[v.kind][0]}{attributes}/>")
        outputs += [str(reference)] if v.role == "output" else []
    structure = [f'    <Output valueReference="{r}"/>' for r in outputs]
    structure += [f'    <InitialUnknown valueReference="{r}"/>' for r in outputs]
    head = _attributes(
        fmiVersion="3.0", modelName=content.title, instantiationToken=guid, **_made(content)
    )
    able = _attributes(
        modelIdentifier=content.identifier,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
    )
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f"<fmiModelDescription{head}>",
            f"  <CoSimulation{able}/>",
            *_middle(content, lines),
            *("  <ModelStructure>", *structure, "  </ModelStructure>"),
            "</fmiModelDescription>\n",
        ]
    )


def _description_2(content: FmuContent, guid: str) -> str:
    lines = [
        '    <ScalarVariable name="time" valueReference="0" causality="independent" '
        'variability="continuous"><Real unit="s"/></ScalarVariable>'
    ]
    outputs = []
    for reference, v in enumerate(content.variables, start=1):
        who, what = _attributes(**_identity(v, reference)), _attributes(**_values(v))
        lines.append(f"    <ScalarVariable{who}><{_KINDS[v.kind][1]}{what}/></ScalarVariable>")
        outputs += [f'      <Unknown index="{reference + 1}"/>'] if v.role == "output" else []
    head = _attributes(fmiVersion="2.0", modelName=content.title, guid=guid, **_made(content))
    able = _attributes(
        modelIdentifier=content.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f"<fmiModelDescription{head}>",
            f"  <CoSimulation{able}>",
            '    <SourceFiles><File name="fmi2.c"/></SourceFiles>',
            "  </CoSimulation>",
            *_middle(content, lines),
            "  <ModelStructure>",
            *("    <Outputs>", *outputs, "    </Outputs>"),
            *("    <InitialUnknowns>", *outputs, "    </InitialUnknowns>"),
            *("  </ModelStructure>", "</fmiModelDescription>\n"),
        ]
    )


def _made(content: FmuContent) -> dict[str, str]:
    """By what and when an FMU was made, as attributes of its description."""
    return {
        "generationTool": content.tool,
        "generationDateAndTime": content.created,
        "variableNamingConvention": "structured",
    }


def _middle(content: FmuContent, variables: Sequence[str]) -> list[str]:
    """What both versions of a description share between the kind of FMU and its structure."""
    return [
        *_units(content),
        "  <LogCategories>",
        '    <Category name="logStatusError"/>',
        "  </LogCategories>",
        f'  <DefaultExperiment startTime="0" stepSize="{number(content.step)}"/>',
        *("  <ModelVariables>", *variables, "  </ModelVariables>"),
    ]


def _build(identifier: str, main: str) -> str:
    return f"""\
<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{identifier}">
    <SourceFileSet language="C99">
      <SourceFile name="{main}"/>
    </SourceFileSet>
    <Library name="m" external="true"/>
  </BuildConfiguration>
</fmiBuildDescription>
"""


_BASE = {
    "s": {"s": 1},
    "m": {"m": 1},
    "kg": {"kg": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Nm": {"kg": 1, "m": 2, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}
_FACTOR = re.compile(r"([A-Za-z]+)(\^?-?[\d.]+)?")


def _units(content: FmuContent) -> list[str]:
    names = dict.fromkeys(["s", *(v.unit for v in content.variables if v.unit)])
    lines = ["  <UnitDefinitions>"]
    for name in names:
        base = _base(name)
        if base is None:
            lines.append(f"    <Unit name={quoteattr(name)}/>")
        else:
            powers = "".join(f' {k}="{v}"' for k, v in base.items() if v)
            lines.append(f"    <Unit name={quoteattr(name)}><BaseUnit{powers}/></Unit>")
    return [*lines, "  </UnitDefinitions>"]


def _base(unit: str) -> dict[str, int] | None:
    """Powers of the base units; None where a power is not whole or a unit is not known."""
    found: dict[str, int] = {}
    above, _, below = unit.partition("/")
    for sign, part in ((1, above), (-1, below.strip("()"))):
        for factor in part.split():
            if factor == "1":
                continue
            match = _FACTOR.fullmatch(factor)
            power = float((match[2] or "1").lstrip("^")) if match else 0.5
            if match is None or match[1] not in _BASE or not power.is_integer():
                return None
            for name, own in _BASE[match[1]].items():
                found[name] = found.get(name, 0) + sign * own * int(power)
    return found


__all__ = ["FmuContent", "FmuVariable", "Role", "c_compiler", "fmu_bytes"]
