"""One line declares an option: check, default and reference."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import OptionError
from hal.options import bound_text, describe, option, read, table_of


@dataclass(frozen=True)
class Inner:
    gain: float = option(2.0, low=0.0, high=10.0, unit="V", doc="a gain")
    steps: int = option(3, low=1, doc="a count")


@dataclass(frozen=True)
class Outer:
    inner: Inner
    name: str = option(doc="required")
    mode: str = option("slow", choices=("slow", "fast"), doc="a word")
    pair: tuple[float, ...] = option((1.0, 2.0), shape=(2,), high=5.0, doc="two numbers")
    table: tuple[tuple[float, ...], ...] = option(((1.0,), (2.0,)), shape=(2, 1), doc="nested")
    maybe: float | None = option(None, low=0.0, doc="may be absent")
    on: bool = option(False, doc="a switch", live=True)
    free: dict = option({}, doc="somebody else's")


def test_defaults_fill_what_is_absent_and_required_options_are_missed():
    assert read(Outer, {"name": "x"}) == Outer(Inner(), "x")
    with pytest.raises(OptionError, match="name is missing; set it: required"):
        read(Outer, {})


def test_an_integer_is_a_float_but_nothing_else_is_converted():
    value = read(Inner, {"gain": 3}).gain
    assert (value, type(value)) == (3.0, float)
    for wrong in ({"gain": "3"}, {"steps": 3.0}, {"steps": True}, {"gain": False}, {"gain": None}, {"gain": [1.0]}):
        with pytest.raises(OptionError):
            read(Inner, wrong)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_numbers_must_be_finite_everywhere(value):
    for table in ({"inner": {"gain": value}}, {"pair": [1.0, value]}, {"maybe": value}, {"table": [[value], [1.0]]}):
        with pytest.raises(OptionError):
            read(Outer, {"name": "x", **table})


def test_bounds_are_inclusive_and_hold_inside_lists():
    assert read(Inner, {"gain": 10.0}).gain == 10.0
    for table in ({"inner": {"gain": 10.0000001}}, {"inner": {"steps": 0}}, {"pair": [1.0, 5.1]}, {"maybe": -1.0}):
        with pytest.raises(OptionError, match="out of bounds"):
            read(Outer, {"name": "x", **table})


def test_shapes_are_kept_and_paths_name_the_element():
    assert read(Outer, {"name": "x", "table": [[3], [4]]}).table == ((3.0,), (4.0,))
    with pytest.raises(OptionError, match=r"here\.pair must be a list of 2"):
        read(Outer, {"name": "x", "pair": [1.0]}, "here")
    with pytest.raises(OptionError, match=r"here\.table\[1\]\[0\] must be a float"):
        read(Outer, {"name": "x", "table": [[1.0], ["a"]]}, "here")


def test_an_unknown_key_of_a_nested_table_is_refused_with_the_nearest():
    with pytest.raises(OptionError, match=r"unknown key inner\.gian; did you mean 'gain'\?"):
        read(Outer, {"name": "x", "inner": {"gian": 1}})


@pytest.mark.parametrize("wrong", [3, "text", [1], None])
def test_a_table_must_be_a_table(wrong):
    for key in ("inner", "free"):
        with pytest.raises(OptionError, match=f"{key} must be a table"):
            read(Outer, {"name": "x", key: wrong})
    with pytest.raises(OptionError, match="settings must be a table"):
        read(Outer, wrong)


def test_defaults_are_not_shared():
    one, two = read(Outer, {"name": "x"}), read(Outer, {"name": "y"})
    one.free["a"] = 1
    assert two.free == {}


numbers = st.floats(0.0, 5.0)


@given(
    gain=numbers,
    steps=st.integers(1, 99),
    pair=st.tuples(numbers, numbers),
    maybe=st.none() | numbers,
    on=st.booleans(),
)
def test_a_table_reads_back_to_the_same_options(gain, steps, pair, maybe, on):
    options = Outer(Inner(gain, steps), "n", "fast", pair, ((1.0,), (0.5,)), maybe, on, {"a": {"b": [1]}})
    table = table_of(options)
    assert ("maybe" in table) == (maybe is not None), "TOML has no null"
    assert read(Outer, table) == options


def test_the_reference_lists_every_leaf_in_order():
    names = [name for name, _, _ in describe(Outer)]
    assert names == ["inner.gain", "inner.steps", "name", "mode", "pair", "table", "maybe", "on", "free"]
    assert [name for name, _, f in describe(Outer) if f.metadata["live"]] == ["on"]


def test_bounds_in_words():
    texts = {name: bound_text(f) for name, _, f in describe(Outer)}
    assert texts["inner.gain"] == "0 .. 10 V"
    assert texts["inner.steps"] == "at least 1"
    assert texts["pair"] == "at most 5"
    assert texts["mode"] == "slow | fast"
    assert texts["name"] == ""
