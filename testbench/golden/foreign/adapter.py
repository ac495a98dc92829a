"""Wrapper of a design: a module with the ports of the bundle, and in it the design under its own names.

    bundle's input --> extended or cut, inverted --> bits of the design's port
    bits of the design's port --> inverted --> extended; if it is wider, inverted where the bits above are no extension

It has the ports that the level judges. Each association of the design has a line of its own: tools name
lines, and `rtl_run` turns those into ports.
Source  docs/foreign_designs.md
"""

from testbench.errors import FileError
from testbench.golden.stimulus import levels
from testbench.golden.stimulus.levels import rtl_parameters

VERILOG, VHDL = "verilog", "vhdl"


def adapter_name(manifest):
    """Module or entity of the wrapper; never that of a block of ours. The benches of the whole design know its name."""
    return "gyro_top" if manifest["block"] == "top" else f"golden_{manifest['block']}"


def _design_ports(port_map):
    """{port of the design: [(bundle's name, entry, Port)]} of inputs and of outputs."""
    inputs, outputs = {}, {}
    for p, port in port_map.inputs:
        if port.name:
            inputs.setdefault(port.name, []).append((p["name"], p, port))
    for name, p, port in port_map.outputs:
        outputs.setdefault(port.name, []).append((name, p, port))
    return inputs, outputs


def _port_width(name, port_entries):
    """Bits of a port of the design; FileError if two entries disagree."""
    if all(port.hi is None for *_, port in port_entries):
        widths = {port.width for *_, port in port_entries}
        if len(widths) > 1:
            raise FileError(f"map: port {name} of the design has both {' and '.join(map(str, sorted(widths)))} bits")
        return widths.pop()
    return 1 + max(port.hi or 0 for *_, port in port_entries)


def widths(port_map):
    """{port of the design: bits} of a `design_map.DesignMap`."""
    return {name: _port_width(name, entries) for ports in _design_ports(port_map) for name, entries in ports.items()}


def _check_undriven_bits(name, port_entries):
    """FileError where bits of an input have no driver."""
    if any(port.hi is None for *_, port in port_entries):
        return
    driven = {bit for *_, port in port_entries for bit in range(port.lo, port.hi + 1)}
    free = sorted(set(range(max(driven) + 1)) - driven)
    if free:
        raise FileError(f"map: bit {free[0]} of input {name} of the design has no driver")


def _span(width):
    return f"[{width - 1}:0]"


class _Verilog:
    """Expressions of Verilog; nets are vectors, also of one bit."""

    @staticmethod
    def input_expression(name, p, port):
        """A bundle's input as bits for the design."""
        wide, port_width = p["width"], port.width
        sign = f"{name}[{wide - 1}]" if p["signed"] else "1'b0"
        text = f"{{{{{port_width - wide}{{{sign}}}}}, {name}}}" if port_width > wide else f"{name}[{port_width - 1}:0]"
        return f"~{text}" if port.invert else text

    @staticmethod
    def output_expression(net, p, port):
        """(declarations, expression) of a bundle's output from bits of the design."""
        wide, port_width = p["width"], port.width
        hi, lo = (port_width - 1, 0) if port.hi is None else (port.hi, port.lo)
        bits = f"{'~' if port.invert else ''}{net}[{hi}:{lo}]"
        if port_width <= wide:
            sign = f"v_{net}_{lo}[{port_width - 1}]" if p["signed"] else "1'b0"
            extended = f"{{{{{wide - port_width}{{{sign}}}}}, v_{net}_{lo}}}" if port_width < wide else f"v_{net}_{lo}"
        else:
            sign = f"v_{net}_{lo}[{wide - 1}]" if p["signed"] else "1'b0"
            low = f"v_{net}_{lo}[{wide - 1}:0]"
            extended = f"(v_{net}_{lo}[{port_width - 1}:{wide}] === {{{port_width - wide}{{{sign}}}}}) ? {low} : ~{low}"
        return f"    wire {_span(port_width)} v_{net}_{lo} = {bits};", extended


def _mapped_omitted_params(manifest, port_map):
    """Entries of the parameters that the map lists and the bundle leaves at 0."""
    mapped_names = {name for name, *_ in port_map.parameters}
    return [p for p in levels.omitted_params(manifest) if p["name"] in mapped_names]


def verilog(manifest, port_map):
    """Text of the wrapper in Verilog-2005, of a `design_map.DesignMap`."""
    inputs, outputs = _design_ports(port_map)
    params = [f"    parameter {name} = {value}" for name, value in rtl_parameters(manifest)]
    for p in (*levels.used_params(manifest), *_mapped_omitted_params(manifest, port_map)):
        params.append(f"    parameter {'signed ' * p['fmt'][0]}{_span(sum(p['fmt']))} {p['name']} = {sum(p['fmt'])}'d0")
    params += [f'    parameter {name} = ""' for name in levels.roms(manifest)]
    head = f" #(\n{(',' + chr(10)).join(params)}\n)" if params else ""
    ports = ["    input wire clk", *(f"    input wire {_span(p['width'])} {p['name']}" for p in manifest["inputs"])]
    ports += [f"    output wire {_span(p['width'])} {name}" for name, p, _ in port_map.outputs]
    lines, links = [], [f".{port_map.clock}(clk)"]
    if port_map.reset[0]:
        links.append(f".{port_map.reset[0]}({'' if port_map.reset[1] else '~'}rst)")
    for name, port_entries in inputs.items():
        _check_undriven_bits(name, port_entries)
        lines.append(f"    wire {_span(_port_width(name, port_entries))} d_{name};")
        for bundle_name, p, port in port_entries:
            bits = "" if port.hi is None else f"[{port.hi}:{port.lo}]"
            lines.append(f"    assign d_{name}{bits} = {_Verilog.input_expression(bundle_name, p, port)};")
        links.append(f".{name}(d_{name})")
    links += [f".{name}({value})" for name, value in port_map.ties]
    for name, port_entries in outputs.items():
        lines.append(f"    wire {_span(_port_width(name, port_entries))} d_{name};")
        for bundle_name, p, port in port_entries:
            declared, text = _Verilog.output_expression(f"d_{name}", p, port)
            lines += [declared, f"    assign {bundle_name} = {text};"]
        links.append(f".{name}(d_{name})")
    generics = [f".{design_param}({name})" for name, design_param, _ in port_map.parameters]
    generics += [f".{name}({value})" for name, value in port_map.constants]
    parameter_text = f" #(\n{(',' + chr(10)).join(generics)}\n)" if generics else ""
    return f"""// {port_map.top} with the names of {manifest["block"]}/{manifest["case"]}
module {adapter_name(manifest)}{head} (
{(("," + chr(10)).join(ports))}
);
{chr(10).join(dict.fromkeys(lines))}
    {port_map.top}{parameter_text} yours (
{("," + chr(10)).join(links)}
    );
endmodule
"""


def _type(width):
    return "std_logic" if width == 1 else f"std_logic_vector({width - 1} downto 0)"


class _Vhdl:
    """Expressions of VHDL; every net within the wrapper is a std_logic_vector."""

    @staticmethod
    def vector(name, width):
        """A port of the wrapper as a vector."""
        return f"vec({name})" if width == 1 else name

    @staticmethod
    def input_expression(name, p, port):
        text = f"resized({_Vhdl.vector(name, p['width'])}, {port.width}, {str(p['signed']).lower()})"
        return f"not {text}" if port.invert else text

    @staticmethod
    def output_expression(net, p, port):
        hi, lo = (port.width - 1, 0) if port.hi is None else (port.hi, port.lo)
        bits = f"{net}({hi} downto {lo})"
        text = f"held({'not ' + bits if port.invert else bits}, {p['width']}, {str(p['signed']).lower()})"
        return f"{text}(0)" if p["width"] == 1 else text

    @staticmethod
    def link(name, net, width, kind, is_out):
        """Association of a port of the design with a net of the wrapper."""
        kind = kind or ("std_logic" if width == 1 else "std_logic_vector")
        if kind == "std_logic":
            return f"{name} => {net}(0)"
        if kind == "std_logic_vector":
            return f"{name} => {net}"
        return f"std_logic_vector({name}) => {net}" if is_out else f"{name} => {kind}({net})"

    @staticmethod
    def generic_association(name, design_param, kind, fmt):
        vector = _Vhdl.vector(name, sum(fmt))
        number = "signed" if fmt and fmt[0] else "unsigned"
        expressions = {"signed": f"signed({vector})", "unsigned": f"unsigned({vector})", "std_logic_vector": vector,
                "integer": f"to_integer({number}({vector}))"}  # fmt: skip
        return f"{design_param} => {expressions.get(kind, name)}"


HELPERS = """    function vec(bit_in : std_logic) return std_logic_vector is
        constant wide : std_logic_vector(0 downto 0) := (0 => bit_in);
    begin
        return wide;
    end function;
    function resized(a : std_logic_vector; width : positive; is_signed : boolean) return std_logic_vector is
        alias b : std_logic_vector(a'length - 1 downto 0) is a;
    begin
        if width <= b'length then
            return b(width - 1 downto 0);
        elsif is_signed then
            return std_logic_vector(resize(signed(b), width));
        end if;
        return std_logic_vector(resize(unsigned(b), width));
    end function;
    function held(a : std_logic_vector; width : positive; is_signed : boolean) return std_logic_vector is
        constant low : std_logic_vector(width - 1 downto 0) := resized(a, width, is_signed);
    begin
        if width < a'length and resized(low, a'length, is_signed) /= a then
            return not low;  -- the bits above are no extension: differs for certain
        end if;
        return low;
    end function;"""


def vhdl(manifest, port_map):
    """The same in VHDL-2008."""
    inputs, outputs = _design_ports(port_map)
    resting = {p["name"]: p["fmt"] for p in _mapped_omitted_params(manifest, port_map)}
    formats = {p["name"]: p["fmt"] for p in manifest.get("params", [])} | resting
    generic_declarations = [f"        {name} : natural" for name, _ in rtl_parameters(manifest)]
    zero = {name: " := '0'" if sum(fmt) == 1 else " := (others => '0')" for name, fmt in resting.items()}
    generic_declarations += [f"        {name} : {_type(sum(fmt))}{zero.get(name, '')}" for name, fmt in formats.items()]
    generic_declarations += [f"        {name} : string" for name in levels.roms(manifest)]
    head = f"    generic (\n{(';' + chr(10)).join(generic_declarations)}\n    );\n" if generic_declarations else ""
    ports = [
        "        clk : in std_logic",
        *(f"        {p['name']} : in {_type(p['width'])}" for p in manifest["inputs"]),
    ]
    ports += [f"        {name} : out {_type(p['width'])}" for name, p, _ in port_map.outputs]
    signals, lines, links = [], [], [f"{port_map.clock} => clk"]
    if port_map.reset[0]:
        lines.append(f"    d_reset <= {'' if port_map.reset[1] else 'not '}rst;")
        links.append(f"{port_map.reset[0]} => d_reset")
    for name, port_entries in inputs.items():
        _check_undriven_bits(name, port_entries)
        width = _port_width(name, port_entries)
        signals.append(f"    signal d_{name} : std_logic_vector({width - 1} downto 0);")
        for bundle_name, p, port in port_entries:
            bits = "" if port.hi is None else f"({port.hi} downto {port.lo})"
            lines.append(f"    d_{name}{bits} <= {_Vhdl.input_expression(bundle_name, p, port)};")
        kind = next((port.type for *_, port in port_entries if port.type), "")
        sliced = any(port.hi is not None for *_, port in port_entries)
        links.append(_Vhdl.link(name, f"d_{name}", width, kind or "std_logic_vector" * sliced, False))
    for name, value in port_map.ties:
        if value not in (0, 1):
            raise FileError(f"map: [ties] {name}: {value} is not 0 or 1, the values of a VHDL input of one bit")
        links.append(f"{name} => '{value}'")
    for name, port_entries in outputs.items():
        width = _port_width(name, port_entries)
        signals.append(f"    signal d_{name} : std_logic_vector({width - 1} downto 0);")
        lines += [f"    {out} <= {_Vhdl.output_expression(f'd_{name}', p, port)};" for out, p, port in port_entries]
        kind = next((port.type for *_, port in port_entries if port.type), "")
        sliced = any(port.hi is not None for *_, port in port_entries)
        links.append(_Vhdl.link(name, f"d_{name}", width, kind or "std_logic_vector" * sliced, True))
    generics = [
        _Vhdl.generic_association(name, design_param, kind, formats.get(name, ()))
        for name, design_param, kind in port_map.parameters
    ]
    generics += [f"{name} => {value}" for name, value in port_map.constants]
    generic_map_text = f"        generic map (\n{(',' + chr(10)).join(generics)}\n        )\n" if generics else ""
    return f"""-- {port_map.top} with the names of {manifest["block"]}/{manifest["case"]}
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
library {port_map.library};

entity {adapter_name(manifest)} is
{head}    port (
{(";" + chr(10)).join(ports)}
    );
end entity;

architecture wrap of {adapter_name(manifest)} is
    signal d_reset : std_logic;
{chr(10).join(signals)}
{HELPERS}
begin
{chr(10).join(lines)}
    yours : entity {port_map.library}.{port_map.top}
{generic_map_text}        port map (
{("," + chr(10)).join(links)}
        );
end architecture;
"""
