"""Bundles: packing is reversible, writing is whole or nothing, and a touched bundle is refused with one clear line."""

import hashlib
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench.errors import FileError
from testbench.golden.bundles import bundle


def port(name, width, signed=False):
    return {"name": name, "width": width, "signed": signed}


PORTS = {"inputs": [port("rst", 1), port("x", 5, True)], "registers": [port("y", 7, True)], "outputs": [port("z", 2)]}
STIM = np.array([[0, -16], [1, 15], [0, -1]])
EXP = np.array([[-64, 3], [63, 0], [-1, 1]])


def manifest(**changed):
    return {
        "schema": bundle.SCHEMA,
        "block": "toy",
        "case": "default",
        "clock": {"name": "clk", "hz": 26_000_000},
        "reset": {"name": "rst", "active": 1, "cycles": 2},
        "n": 3,
        **PORTS,
        "provenance": {"version": "1"},
        **changed,
    }


def files():
    return {
        "stim.hex": bundle.hex_text(bundle.pack(STIM, [1, 5]), 6),
        "exp.hex": bundle.hex_text(bundle.pack(EXP, [7, 2]), 9),
        "mask.hex": bundle.hex_text([0x1FF] * 3, 9),
        "ports/x.hex": "10\n0f\n1f\n",
    }


@pytest.fixture
def folder(tmp_path):
    bundle.write(tmp_path / "toy", manifest(), files())
    return tmp_path / "toy"


def forge(folder, change):
    """Change the manifest and give it a matching hash, as somebody who edits on purpose would."""
    path = folder / bundle.MANIFEST
    data = json.loads(path.read_text())
    change(data)
    data["manifest_sha256"] = bundle.seal(data)
    path.write_text(json.dumps(data))


def test_what_was_written_is_read(folder):
    found = bundle.read(folder)
    assert np.array_equal(found.stim, STIM)
    assert np.array_equal(found.exp, EXP)
    assert np.array_equal(found.mask, [[127, 3]] * 3)
    assert found.manifest["n"] == 3
    assert [p.name for p in folder.parent.iterdir()] == ["toy"]


def test_words_are_lower_case_twos_complement_with_a_final_newline(folder):
    assert (folder / "stim.hex").read_bytes() == b"10\n2f\n1f\n"
    assert (folder / "exp.hex").read_bytes() == b"103\n0fc\n1fd\n"


@given(st.data())
def test_packing_is_reversible(data):
    ports = [port(str(k), data.draw(st.integers(1, 63)), data.draw(st.booleans())) for k in range(5)]
    rows = []
    for _ in range(4):
        row = []
        for p in ports:
            half = 1 << (p["width"] - 1)
            row.append(data.draw(st.integers(-half, half - 1) if p["signed"] else st.integers(0, 2 * half - 1)))
        rows.append(row)
    rows = np.array(rows, np.int64)
    words = bundle.pack(rows, [p["width"] for p in ports])
    assert np.array_equal(bundle.unpack(words, ports), rows)
    assert all(0 <= word < 1 << bundle.total(ports) for word in words)


def test_writing_again_replaces_and_forgets_old_files(folder):
    bundle.write(folder, manifest(case="other"), {k: v for k, v in files().items() if "ports" not in k})
    assert bundle.read(folder).manifest["case"] == "other"
    assert not (folder / "ports").exists()
    assert [p.name for p in folder.parent.iterdir()] == ["toy"]


def test_a_failed_write_leaves_what_was_there(folder):
    def fail(part):
        raise OSError(28, "No space left on device")

    with pytest.raises(FileError, match="toy: cannot be written: No space left"):
        bundle.write(folder, manifest(), files(), [fail])
    bundle.read(folder)
    assert [p.name for p in folder.parent.iterdir()] == ["toy"]


def test_provenance_is_not_hashed(folder):
    path = folder / bundle.MANIFEST
    data = json.loads(path.read_text())
    data["provenance"] = {"version": "2"}
    path.write_text(json.dumps(data))
    bundle.read(folder)


def refused(folder, message):
    with pytest.raises(FileError, match=message) as caught:
        bundle.read(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["stim.hex", "exp.hex", "mask.hex", "ports/x.hex"])
def test_a_changed_file_is_refused(folder, name):
    path = folder / name
    path.write_text(path.read_text().replace("f", "e", 1))
    refused(folder, f"{name}: SHA-256 does not match")


@pytest.mark.parametrize("name", ["stim.hex", "ports/x.hex"])
def test_a_missing_file_is_refused(folder, name):
    (folder / name).unlink()
    refused(folder, f"{name}: missing")


def test_a_missing_or_damaged_manifest_is_refused(folder):
    path = folder / bundle.MANIFEST
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    refused(folder, "is not a readable JSON")
    path.write_text("[" * 100_000)
    refused(folder, "is not a readable JSON")
    path.write_text("[]")
    refused(folder, "should be a valid dictionary")
    path.unlink()
    refused(folder, "cannot be read")


def test_another_schema_is_refused(folder):
    forge(folder, lambda data: data.update(schema="gyro-golden/2.0"))
    refused(folder, "schema is 'gyro-golden/2.0', not 'gyro-golden/1.0'")


def test_an_edited_manifest_is_refused(folder):
    path = folder / bundle.MANIFEST
    path.write_text(path.read_text().replace('"cycles": 2', '"cycles": 3'))
    refused(folder, "the manifest was changed")


@pytest.mark.parametrize("name", ["../outside.hex", "/etc/hostname", "a/../../b", "..", "c:\\x", ""])
def test_a_path_that_leaves_the_folder_is_refused(folder, name):
    forge(folder, lambda data: data["sha256"].update({name: "0" * 64}))
    refused(folder, "is outside the bundle")


def test_a_link_that_leaves_the_folder_is_refused(folder):
    (folder.parent / "outside").write_text("x")
    (folder / "link").symlink_to(folder.parent / "outside")
    forge(folder, lambda data: data["sha256"].update({"link": "0" * 64}))
    refused(folder, "link is a link to a place outside")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a\0b", "embedded null"),
        ("x" * 5000, "name too long"),
        ("é.hex", "é.hex: missing"),
        ("ports", "ports: missing"),
    ],
)
def test_a_name_that_no_file_has_is_refused(folder, name, message):
    forge(folder, lambda data: data["sha256"].update({name: "0" * 64}))
    refused(folder, message)


def test_links_in_a_circle_are_refused(folder):
    (folder / "a").symlink_to("b")
    (folder / "b").symlink_to("a")
    forge(folder, lambda data: data["sha256"].update({"a": "0" * 64}))
    refused(folder, "'a' in manifest.json is not valid: Symlink loop")


def test_a_file_that_is_not_of_the_bundle_is_refused_by_verify_and_left_alone_by_read(folder):
    (folder / "build").mkdir()
    (folder / "build" / "dump.vcd").write_text("x")
    bundle.verify(folder)
    for name in ("json.py", "ports/y.hex", ".hidden"):
        (folder / name).write_text("x")
        bundle.read(folder)
        with pytest.raises(FileError, match=f"{name}: is not a file of this bundle; move it elsewhere or into build/"):
            bundle.verify(folder)
        (folder / name).unlink()
    (folder / "link").symlink_to(folder.parent)
    with pytest.raises(FileError, match="link: is not a file of this bundle"):
        bundle.verify(folder)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"10\n2\xff\n1f\n", "stim.hex: is not ASCII text"),
        ("10\n2\uff11\n1f\n".encode(), "stim.hex: is not ASCII text"),
        (b"10\n2f\n1\0\n", "line 3: '1.x00' is not 2 lower-case"),
        (b"10\r\n2f\r\n1f\r\n", "line 1: '10.r' is not 2 lower-case"),
        (b"", "truncated"),
    ],
)
def test_hex_in_another_alphabet_is_refused_even_with_a_right_hash(folder, raw, message):
    (folder / "stim.hex").write_bytes(raw)
    forge(folder, lambda data: data["sha256"].update({"stim.hex": hashlib.sha256(raw).hexdigest()}))
    refused(folder, message)


def test_a_manifest_in_another_alphabet_is_refused(folder):
    path = folder / bundle.MANIFEST
    path.write_bytes(path.read_bytes().replace(b"toy", b"t\xff\xfe"))
    refused(folder, "is not UTF-8 text")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("10\n2f\n", "2 rows, expected 3"),
        ("10\n2f\n1f", "no newline"),
        ("10\n2f\n1\n", "line 3: '1' is not 2 lower-case"),
        ("10\n2F\n1f\n", "line 2: '2F' is not"),
        ("10\n-f\n1f\n", "line 2: '-f' is not"),
        ("10\n7f\n1f\n", "line 2: more than 6 bits"),
        ("10\n2f\n1f\n00\n", "4 rows, expected 3"),
    ],
)
def test_truncated_or_foreign_hex_is_refused_even_with_a_right_hash(folder, text, message):
    (folder / "stim.hex").write_text(text)
    forge(folder, lambda data: data["sha256"].update({"stim.hex": hashlib.sha256(text.encode()).hexdigest()}))
    refused(folder, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.pop("reset"), "reset is missing"),
        (lambda data: data.update(n="3"), "n is missing or not of type int"),
        (lambda data: data.update(n=-1), "n is -1"),
        (lambda data: data["inputs"].append({"name": "a"}), "a port lacks"),
        (lambda data: data.update(n=10**15), "3 rows, expected 1000000000000000"),
        (lambda data: data["inputs"].append(port("a", 64)), "width 64 is outside"),
        (lambda data: data["registers"].append(port("a", 10**18)), "width 1000000000000000000 is outside"),
        (lambda data: data["outputs"].append(port("a", 0)), "width 0 is outside"),
        (lambda data: data["outputs"].append(port("a", True)), "a port lacks"),
        (lambda data: data.update(inputs=[port(str(k), 63) for k in range(10**4)]), "is not 157500 lower-case"),
        (lambda data: data["sha256"].pop("mask.hex"), "mask.hex is not listed"),
    ],
)
def test_a_manifest_without_what_it_needs_is_refused(folder, change, message):
    forge(folder, change)
    refused(folder, message)
