"""EDS files in the styles of their makers: what is read, and what is refused in which words."""

import contextlib
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.eds import ACCESS, DOMAIN, INTEGER_BITS, EdsObject, eds_of, read_eds
from common.errors import ConfigurationError

SIGNED = {code for code, bits in INTEGER_BITS.items() if bits < 0}


def one(text: str) -> EdsObject:
    (found,) = eds_of(text).objects.values()
    return found


@pytest.mark.parametrize(
    ("line", "default", "relative"),
    [
        ("", None, False), ("DefaultValue=", None, False), ("DefaultValue=128", 128, False),
        ("defaultvalue = 0X80 ; of SYNC", 128, False), ("DefaultValue=0080", 80, False),
        ("DefaultValue=0x80UL", 128, False), ("DefaultValue=-1", 0xFFFFFFFF, False),
        ("DefaultValue=$NODEID+0x80", 128, True), ("DefaultValue=$NodeID + 0x80", 128, True),
        ("DefaultValue=0x80+$NODEID", 128, True), ("DefaultValue=$NODEID", 0, True),
        ("DefaultValue=see manual", None, False), ("DefaultValue=0x1FFFFFFFF", None, False),
    ],
)  # fmt: skip
def test_numbers_as_makers_write_them(line, default, relative):
    found = one(f"[2000]\nParameterName=x\nDataType=0x7\nAccessType=rw\n{line}\n")
    assert (found.default, found.relative) == (default, relative)
    if default is not None:
        assert found.of_node(5) == default + 5 * relative


@pytest.mark.parametrize(
    ("lines", "low", "high"),
    [
        ("LowLimit=0xFFFD\nHighLimit=0x0000", -3, 0),
        ("LowLimit=-32768\nHighLimit=32767", -32768, 32767),
        ("LowLimit=5\nHighLimit=1", None, None),
        ("HighLimit=90000", None, None),
    ],
)
def test_limits_are_those_of_the_type(lines, low, high):
    found = one(f"[6060]\nDataType=3\nAccessType=RW\n{lines}\n")
    assert (found.low, found.high) == (low, high)


def test_letter_cases_spaces_comments_and_repeats():
    text = (
        "; made by hand\r\n# and so\r\n[Comments]\r\nby hand\r\n"
        "[deviceinfo]\r\nVENDORNUMBER = 0x26C\r\n1=2\r\n1=3\r\n"
        "[ 6041 ]\r\nparametername=Status\tword ; as CiA says\r\nAccessType=RO\r\n"
        "PDOMapping=0x01\r\n"
        "[1018SUB1]\r\nParameterName=Vendor\r\nDataType=0X0007\r\nAccessType=Ro\r\n"
        "[1018SubA]\r\nDataType=7\r\nAccessType=rw\r\n[6041]\r\nObjFlags=1\r\n \t\r\n"
    )
    eds = eds_of(text)
    assert eds.number("VendorNumber") == 0x26C
    assert eds.number("ProductNumber") == 0
    # The type of 0x6041 is fixed by CiA 402; sub 0 of an array is its highest subindex.
    assert eds.objects == {
        (0x6041, 0): EdsObject(0x6041, 0, "Status\tword", 6, "ro", mappable=True),
        (0x1018, 1): EdsObject(0x1018, 1, "Vendor", 7, "ro", mappable=False),
        (0x1018, 10): EdsObject(0x1018, 10, "Object 1018", 7, "rw", mappable=False),
        (0x1018, 0): EdsObject(
            0x1018, 0, "Highest sub-index supported", 5, "const", mappable=False, default=10
        ),
    }


@pytest.mark.parametrize("kind", ["ObjectType=0x8\n", "ObjectType=9\n", ""])
def test_compact_arrays_have_members_that_are_alike(kind):
    eds = eds_of(f"[1016]\n{kind}DataType=7\nAccessType=rw\nDefaultValue=0\nCompactSubObj=3\n")
    assert sorted(eds.objects) == [(0x1016, sub) for sub in range(4)]
    assert eds.objects[0x1016, 0].default == 3
    assert all(eds.objects[0x1016, sub].writable for sub in (1, 2, 3))


def test_an_unknown_type_is_no_number():
    assert one("[2039]\nAccessType=ro\nDefaultValue=3\n").type == DOMAIN


@pytest.mark.parametrize("code", ["utf-8-sig", "latin-1", "utf-16"])
def test_code_pages(tmp_path, code):
    (tmp_path / "drive.eds").write_bytes("[6041]\nParameterName=Zustand °\n".encode(code))
    assert read_eds(tmp_path / "drive.eds").objects[0x6041, 0].name == "Zustand °"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nothing", "line 1: 'nothing': must be [section], Key=Value or ; comment"),
        ("[6041]\nParameterName\n", "line 2: 'ParameterName': must be [section], Key=Value or ;"),
        ("[1000\n", "line 1: '[1000': must end in ]"),
        ("[6041]\nDataType=abc\n", "[6041] DataType='abc': must be a number such as 7 or 0x0007"),
        ("[6041]\nPDOMapping=yes\n", "[6041] PDOMapping='yes': must be a number"),
        ("[6041]\nObjectType=VAR\n", "[6041] ObjectType='VAR': must be a number"),
        ("[6041]\nAccessType=read\n",
         "[6041] AccessType='read': must be one of const, ro, wo, rw, rwr, rww"),
        ("[1016]\nCompactSubObj=900\n", "[1016] CompactSubObj=900: must be at most 254"),
    ],
)  # fmt: skip
def test_refusals_name_file_section_value_and_what_is_allowed(tmp_path, text, says):
    (tmp_path / "drive.eds").write_text(text)
    with pytest.raises(
        ConfigurationError, match=re.escape(f"drive.eds: not a readable EDS: {says}")
    ):
        read_eds(tmp_path / "drive.eds")


@given(st.text(max_size=300) | st.text(alphabet="[]=; 0x6041subSUB$NODEIDyp\n", max_size=300))
def test_any_text_is_read_or_refused_in_words(text):
    with contextlib.suppress(ConfigurationError):
        eds_of(text)


@st.composite
def variables(draw):
    code = draw(st.sampled_from(sorted(INTEGER_BITS)))
    bits = abs(INTEGER_BITS[code])
    span = (-(1 << bits - 1), (1 << bits - 1) - 1) if code in SIGNED else (0, (1 << bits) - 1)
    low, high = sorted(draw(st.tuples(st.integers(*span), st.integers(*span))))
    return EdsObject(
        draw(st.integers(0x1000, 0xFFFF)), draw(st.integers(0, 254)),
        draw(st.from_regex(r"[A-Za-z][a-z0-9_/()]{0,20}", fullmatch=True)), code,
        draw(st.sampled_from(ACCESS)), draw(st.booleans()),
        draw(st.none() | st.integers(*span)), draw(st.booleans()),
        *draw(st.sampled_from([(None, None), (low, high)])),
    )  # fmt: skip


@st.composite
def styles(draw):
    """Writers of one variable, each in a maker's style."""
    case = draw(st.sampled_from([str, str.upper, str.lower]))
    equals = draw(st.sampled_from(["=", " = ", "= "]))
    number = draw(st.sampled_from([str, hex]))
    comment = draw(st.sampled_from(["", " ; a comment", "\n;StorageLocation=RAM"]))
    end = draw(st.sampled_from(["\n", "\r\n"]))

    def written(of: EdsObject) -> str:
        default = "" if of.default is None else number(of.default)
        rows = [("ParameterName", of.name), ("DataType", number(of.type)),
                ("AccessType", case(of.access)), ("PDOMapping", number(int(of.mappable))),
                ("DefaultValue", f"$NODEID+{default}" if of.relative and default else default),
                ("LowLimit", "" if of.low is None else number(of.low)),
                ("HighLimit", "" if of.high is None else number(of.high))]  # fmt: skip
        lines = [case(f"[{of.index:04X}{f'sub{of.subindex:X}' if of.subindex else ''}]")]
        lines += [f"{case(key)}{equals}{value}{comment}" for key, value in rows]
        return end.join([*lines, ""])

    return written


@given(variables(), styles())
def test_a_variable_is_read_in_every_style(variable, written):
    # A sum with a negative number is written by no maker.
    negative = variable.default is not None and variable.default < 0
    if variable.default is None or negative:
        variable = replace(variable, relative=False)
    found = eds_of(written(variable)).objects[variable.index, variable.subindex]
    assert found == variable
