"""systemrdl-compiler reads the SystemRDL, and finds the printed register map in it."""

import pytest

from testbench.register_map import systemrdl
from tests.testbench.register_map import printed_map


@pytest.fixture
def compile_text(tmp_path):
    rdl = pytest.importorskip("systemrdl", reason="systemrdl-compiler is not installed: SystemRDL was NOT compiled")

    def compiled(text):
        path = tmp_path / "map.rdl"
        path.write_text(text)
        compiler = rdl.RDLCompiler()
        compiler.compile_file(str(path))
        return compiler.elaborate().top

    return compiled


def test_the_compiler_finds_every_word_with_its_fields_and_properties(compile_text):
    regs = list(compile_text(systemrdl.text()).registers())
    expected = list(printed_map.parts())
    assert [(r.inst_name, r.absolute_address) for r in regs] == [(part.name, part.address) for part in expected]
    for reg, part in zip(regs, expected, strict=True):
        row = part.row
        fields = [(f.inst_name, f.low, f.width, f.get_property("reset")) for f in reg.fields()]
        assert fields == part.fields, part.name
        assert (
            reg.get_property("gyro_format")
            == f"[{row.signed},{row.width - row.signed - row.fraction_bits},{row.fraction_bits}]"
        )
        assert reg.get_property("gyro_signed") == bool(row.signed)
        assert reg.get_property("gyro_low_bit") == (32 if part.name.endswith("_HI") else 0)
        assert row.text in reg.get_property("desc")
        constant = row.access == "ro" and row.reset is not None
        for field in reg.fields():
            assert field.get_property("sw").name == ("r" if row.access == "ro" else "rw")
            assert field.get_property("hw").name == ("na" if constant else printed_map.HW[row.access])
            clears = field.get_property("onwrite")
            assert (clears and clears.name) == ("woclr" if row.access == "w1c" else None)


def test_a_wrong_map_is_refused_by_the_compiler(compile_text):
    rdl = pytest.importorskip("systemrdl")
    for old, new in (
        ("RATE @ 0x258", "RATE @ 0x248"),
        ("VALUE[23:0]", "VALUE[32:0]"),
        ("gyro_unit    {", "gyro_unite {"),
    ):
        assert old in systemrdl.text()
        with pytest.raises(rdl.RDLCompileError):
            compile_text(systemrdl.text().replace(old, new))


def test_texts_with_quotes_stay_texts(compile_text, monkeypatch):
    first, *rest = systemrdl.words()
    quoted = first._replace(register=first.register._replace(doc='say "run" \\ stop'))
    monkeypatch.setattr(systemrdl, "words", lambda _: (quoted, *rest))
    reg = next(iter(compile_text(systemrdl.text()).registers()))
    assert reg.get_property("desc") == 'say "run" \\ stop.'
