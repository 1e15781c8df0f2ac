"""The error about a wrong field uses Hangtime's words, and never msgspec's."""

from __future__ import annotations

from typing import Literal

import msgspec
import pytest

from formats.wrong_fields import wrong_field


class Part(msgspec.Struct, forbid_unknown_fields=True):
    kind: Literal["a", "b"] | None = None
    at: tuple[float, float] = (0.0, 0.0)


class Whole(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    size: float = 1.0
    parts: list[Part] = []
    share: float | None = None
    many: bool = False
    kinds: list[Literal["x", "y"]] = []
    notes: dict[str, str] = {}

    def __post_init__(self) -> None:
        if self.size > 50:
            raise ValueError("the size is beyond all measure")


@pytest.mark.parametrize(
    ("held", "said"),
    [
        ({}, "the field `name` is missing"),
        ({"name": 3}, "name must be text (got a whole number)"),
        ({"name": "a", "size": "1"}, "size must be a number (got text)"),
        ({"name": "a", "size": True}, "size must be a number (got true or false)"),
        ({"name": "a", "share": []}, "share must be a number or nothing (got a list)"),
        ({"name": "a", "many": 1}, "many must be true or false (got a whole number)"),
        ({"name": "a", "parts": {}}, "parts must be a list (got a table)"),
        ({"name": "a", "parts": [3]}, "parts[0] must be a table (got a whole number)"),
        ({"name": "a", "parts": [{"kind": "c"}]}, "parts[0].kind must be one of a, b (got 'c')"),
        ({"name": "a", "kinds": ["x", "z"]}, "kinds[1] must be one of x, y (got 'z')"),
        ({"name": "a", "parts": [{"at": [1.0]}]}, "parts[0].at must be a list of 2 (got 1)"),
        ({"name": "a", "parts": [{"kid": "a"}]}, "unknown field `kid` in parts[0]; did you mean `kind`?"),
        ({"name": "a", "notes": {1: "b"}}, "a key of notes must be text (got a whole number)"),
        ({"name": "a", "size": 51.0}, "the size is beyond all measure"),
        ([], "the file must be a table (got a list)"),
    ],
)
def test_a_wrong_field_is_said_with_what_it_must_be(held: object, said: str) -> None:
    with pytest.raises(msgspec.ValidationError) as raised:
        msgspec.convert(held, Whole)
    assert wrong_field(raised.value, (Whole, Part)) == said


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (msgspec.Meta(ge=2.0), 1.0, "the file must be a number at least 2.0"),
        (msgspec.Meta(le=2.0), 3.0, "the file must be a number at most 2.0"),
        (msgspec.Meta(gt=2.0), 2.0, "the file must be a number above 2.0"),
        (msgspec.Meta(lt=2.0), 2.0, "the file must be a number below 2.0"),
    ],
)
def test_a_number_beyond_its_bound_is_said_with_the_bound(kind: msgspec.Meta, value: float, said: str) -> None:
    from typing import Annotated

    with pytest.raises(msgspec.ValidationError) as raised:
        msgspec.convert(value, Annotated[float, kind])  # type: ignore[valid-type]
    assert wrong_field(raised.value, ()) == said


def test_a_file_that_is_no_json_is_called_damaged() -> None:
    with pytest.raises(msgspec.DecodeError) as raised:
        msgspec.json.decode(b'{"name": ', type=Whole)
    assert wrong_field(raised.value, (Whole,)) == "the file is damaged or no JSON"
