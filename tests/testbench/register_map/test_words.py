"""Words of the bus against the printed register map."""

from fpga_model import host_bus, registers
from testbench.register_map import words
from tests.testbench.register_map import printed_map


def test_every_register_has_its_words_and_fields():
    found = [(w.name, w.address, [(f.name, f.low, f.width, f.reset) for f in w.fields]) for w in words.words()]
    assert found == [(part.name, part.address, part.fields) for part in printed_map.parts()]


def test_registers_of_more_than_a_word_have_two_and_no_word_is_shared():
    found = words.words()
    assert len({word.address for word in found}) == len(found)
    assert [w.name for w in found if w.half == "HI"] == [
        f"{row.name}_HI" for row in printed_map.rows() if row.width > 32
    ]
    assert all(word.half in ("LO", "HI") or word.register.fmt.width <= 32 for word in found)


def test_names_of_states_are_those_of_the_map():
    (row,) = (row for row in printed_map.rows() if row.value_names())
    (word,) = (word for word in words.words() if any(field.values for field in word.fields))
    assert list(word.fields[0].values) == row.value_names()


def test_lsb_is_a_text_with_unit():
    lsb = {r.name: words.lsb(r) for r in registers.MAP}
    assert lsb["rate"] == "2^-20 deg/s"
    assert lsb["amplitude_fixed"] == "2^-23 x 10 V"
    assert lsb["control"] == "1"
    assert lsb["rate_scale"] == "2^-28"
    assert lsb["temperature"] == "1 x 256 code LSB"
    assert lsb["amplitude_setpoint"] == "1 magnitude LSB"


def test_the_rows_of_the_port_are_those_of_its_map():
    rows = [
        (f"0x{r.address:02X}", r.name.upper(), r.fmt, "-" if r.access == "ro" else f"0x{r.reset:X}", r.access,
         r.unit or "-", r.doc)
        for r in host_bus.MAP
    ]  # fmt: skip
    assert printed_map.PORT.strip().splitlines() == ["| " + " | ".join(map(str, row)) + " |" for row in rows]
