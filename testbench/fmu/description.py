"""modelDescription.xml of FMI 3.0 and 2.0, and buildDescription.xml of the sources.

Source    docs/fmu.md; FMI 3.0 and 2.0, Modelica Association
"""

import math
from xml.sax.saxutils import quoteattr

from analog_frontend.effects import acceleration
from testbench.fmu.variables import BOOLEAN, INPUT, INT32, INT64, OUTPUT, REAL, value_references
from testbench.version import VERSION

TYPES = {
    "3.0": {REAL: "Float64", INT32: "Int32", INT64: "Int64", BOOLEAN: "Boolean"},
    "2.0": {REAL: "Real", INT32: "Integer", INT64: "Real", BOOLEAN: "Boolean"},
}
DEG = math.pi / 180
UNITS = (
    '<Unit name="s"><BaseUnit s="1"/></Unit>',
    '<Unit name="m"><BaseUnit m="1"/></Unit>',
    f'<Unit name="deg/s"><BaseUnit s="-1" rad="1" factor="{DEG!r}"/></Unit>',
    f'<Unit name="rad/s"><BaseUnit s="-1" rad="1"/><DisplayUnit name="deg/s" factor="{1 / DEG!r}"/></Unit>',
    f'<Unit name="g"><BaseUnit s="-2" m="1" factor="{acceleration.G_M_PER_S2!r}"/></Unit>',
    '<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>',
)
STATES = {
    "3.0": 'canGetAndSetFMUState="true" canSerializeFMUState="true"',
    "2.0": 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"',
}


def _value(kind, value):
    if kind == BOOLEAN:
        return "true" if value else "false"
    return repr(float(value)) if kind == REAL else str(int(value))


def _attributes(v, version):
    """What is common to both versions: pairs of name and value."""
    discrete = v.kind != REAL
    yield from (("causality", v.causality), ("variability", "discrete" if discrete else "continuous"))
    if v.causality == OUTPUT:
        yield "initial", "calculated"


def _xml(pairs):
    return " ".join(f"{name}={quoteattr(str(value))}" for name, value in pairs)


def _variable_3(first, v):
    pairs = [("name", v.name), ("valueReference", first), ("description", v.text), *_attributes(v, "3.0")]
    if v.unit:
        pairs.append(("unit", v.unit))
    if v.causality == INPUT:
        pairs.append(("start", " ".join([_value(v.kind, v.start)] * v.size)))
    size = f'<Dimension start="{v.size}"/>' if v.size > 1 else ""
    name = TYPES["3.0"][v.kind]
    return f"<{name} {_xml(pairs)}>{size}</{name}>" if size else f"<{name} {_xml(pairs)}/>"


def _variables_2(first, v):
    for k in range(v.size):
        name = f"{v.name}[{k}]" if v.size > 1 else v.name
        pairs = [("name", name), ("valueReference", first + k), ("description", v.text), *_attributes(v, "2.0")]
        # a word of 48 bits is exact in a Real
        pairs = [(key, "discrete" if v.kind == INT64 and key == "variability" else value) for key, value in pairs]
        inner = [("start", _value(REAL if v.kind == INT64 else v.kind, v.start))] if v.causality == INPUT else []
        inner += [("unit", v.unit)] if v.unit else []
        kind = TYPES["2.0"][v.kind]
        yield f"<ScalarVariable {_xml(pairs)}><{kind}{' ' if inner else ''}{_xml(inner)}/></ScalarVariable>"


def _structure_3(variables):
    outputs = [first for first, v in value_references(variables) if v.causality == OUTPUT]
    lines = [f'<Output valueReference="{n}" dependencies=""/>' for n in outputs]
    return [*lines, *(f'<InitialUnknown valueReference="{n}" dependencies=""/>' for n in outputs)]


def _structure_2(variables):
    slots = [v for v in variables for _ in range(v.size)]
    xml_entries = [f'<Unknown index="{n}" dependencies=""/>' for n, v in enumerate(slots, 1) if v.causality == OUTPUT]
    return ["<Outputs>", *xml_entries, "</Outputs>", "<InitialUnknowns>", *xml_entries, "</InitialUnknowns>"]


def model(version, name, text, token, variables, sources, tick_hz):
    """Text of modelDescription.xml."""
    step = f"{1 / tick_hz!r}"
    head = [("fmiVersion", version), ("modelName", f"gyro_{name}"), ("description", text), ("version", VERSION)]
    head += [("instantiationToken" if version == "3.0" else "guid", token), ("variableNamingConvention", "structured")]
    head += [("generationTool", f"FTR gyro {VERSION}")]
    can = f'modelIdentifier="gyro_{name}" {STATES[version]} canHandleVariableCommunicationStepSize="false"'
    if version == "3.0":
        can = f'<CoSimulation {can} hasEventMode="false" fixedInternalStepSize="{step}"/>'
        body = [_variable_3(first, v) for first, v in value_references(variables)]
        structure = _structure_3(variables)
    else:
        files = "".join(f"<File name={quoteattr(file)}/>" for file in sources)
        can = f"<CoSimulation {can}><SourceFiles>{files}</SourceFiles></CoSimulation>"
        body = [line for first, v in value_references(variables) for line in _variables_2(first, v)]
        structure = _structure_2(variables)
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', f"<fmiModelDescription {_xml(head)}>", can]
    lines += ["<UnitDefinitions>", *UNITS, "</UnitDefinitions>"]
    lines += [f'<DefaultExperiment startTime="0.0" stopTime="0.001" stepSize="{step}"/>']
    lines += ["<ModelVariables>", *body, "</ModelVariables>", "<ModelStructure>", *structure, "</ModelStructure>"]
    return "\n".join([*lines, "</fmiModelDescription>", ""])


def build(name, sources):
    """Text of sources/buildDescription.xml, of FMI 3.0."""
    files = [f"<SourceFile name={quoteattr(file)}/>" for file in sources]
    options = 'language="C99" compiler="gcc" compilerOptions="-ffp-contract=off"'
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<fmiBuildDescription fmiVersion="3.0">',
            f'<BuildConfiguration modelIdentifier="gyro_{name}">',
            f"<SourceFileSet {options}>",
            *files,
            "</SourceFileSet>",
            "</BuildConfiguration>",
            "</fmiBuildDescription>",
            "",
        ]
    )
