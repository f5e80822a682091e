"""How numbers are written, and names listed."""

import json

import numpy as np
import pytest
from oarlock.base.errors import few
from oarlock.base.numbers import exact, figure, finite, percent, short


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0, "0"),
        (0.0, "0"),
        (12000, "12 000"),
        (1234567, "1 234 567"),
        (1.98641, "1.986"),
        (-1.98641, "-1.986"),
        (0.01, "0.010"),
        (0.00999, "9.99e-03"),
        (2.42e-10, "2.42e-10"),
        (1234.5, "1.23e+03"),
        (4.0, "4"),
        (True, "yes"),
        ("as it is", "as it is"),
        (float("inf"), "not finite"),
        (np.float64("nan"), "not finite"),
        (np.float64(2.5), "2.500"),
    ],
)
def test_figures_for_reading(value, text):
    assert figure(value) == text


def test_a_unit_stands_after_a_number_only():
    assert figure(0.25, "m") == "0.250 m"
    assert figure(None, "m") == "–"


def test_short_forms():
    assert [short(value) for value in (None, 1.23456, 1e-9, 12000, "a\nb", True)] == [
        "–",
        "1.23",
        "1e-09",
        "12000",
        "a b",
        "True",
    ]
    assert short(1.23456, 5) == "1.2346"


def test_shares():
    assert [percent(value) for value in (0.816, -0.194, 1.01, -0.001, float("nan"))] == [
        "82 %",
        "-19 %",
        "101 %",
        "0 %",
        "–",
    ]


@pytest.mark.parametrize("value", [0.1, 1 / 3, 2.0, 1e-17, 5e-324, -0.002])
def test_all_digits_are_there(value):
    assert float(exact(value)) == value
    assert not exact(value).endswith(".0")


def test_json_has_no_infinity():
    values = [1.5, 3, None, "text", float("inf"), float("nan"), -np.float64("inf")]
    assert [finite(value) for value in values] == [1.5, 3, None, "text", None, None, None]
    json.dumps([finite(value) for value in values], allow_nan=False)


@pytest.mark.parametrize(
    ("count", "given", "text"),
    [
        (0, {}, ""),
        (1, {}, "a"),
        (3, {}, "a, b and c"),
        (4, {}, "a, b, c and d"),
        (6, {}, "a, b, c, d and 2 more"),
        (3, {"last": "or"}, "a, b or c"),
        (5, {"last": "or"}, "a, b, c, d or 1 more"),
        (3, {"last": ""}, "a, b, c"),
        (6, {"last": ""}, "a, b, c, d and 2 more"),
        (4, {"most": 2}, "a, b and 2 more"),
    ],
)
def test_few_of_many_names(count, given, text):
    assert few(list("abcdef")[:count], **given) == text
