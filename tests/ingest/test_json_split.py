# SPDX-License-Identifier: Apache-2.0
"""Cutting JSON: the items are what a parser finds; what does not fit is refused."""

import io
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ingest import json_split
from ingest.json_split import split_features
from tiles.errors import InputError

values = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3)
    ),
    max_leaves=8,
)


def split(text: bytes) -> tuple[list[bytes], bytes]:
    outside = bytearray()
    items = [
        item
        for batch in split_features(Path("x.json"), io.BytesIO(text), outside)
        for item in batch
    ]
    return items, bytes(outside)


@given(
    st.lists(values, max_size=6),
    st.dictionaries(st.text(), values, max_size=3),
    st.sampled_from([None, 2]),
    st.sampled_from([1, 7, 4096]),
)
def test_items_are_those_that_a_parser_finds(
    features: list[Any], others: dict[str, Any], indent: int | None, block_bytes: int
) -> None:
    others.pop("features", None)
    whole = {**others, "features": features, "after": [1, {"features": [2]}]}
    text = json.dumps(whole, indent=indent).encode()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_split, "_BLOCK_BYTES", block_bytes)
        items, outside = split(text)
    assert [json.loads(item) for item in items] == features
    assert json.loads(outside) == {**whole, "features": []}


def test_without_a_collection_all_of_the_text_is_outside() -> None:
    text = b' {"type": "Polygon", "features": {"a": [1]}, "b": "\\"features\\": ["} '
    items, outside = split(text)
    assert items == []
    assert json.loads(outside) == json.loads(text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b'{"features": [{"a": 1}', "ends too early .at feature 0, byte 14"),
        (b'{"features": [{}, {}}', "broken JSON .at feature 1"),
        (b'{"features": [{}, , {}]}', "broken JSON .at feature 1, byte 19"),
        (b'{"features": [{}]', "ends too early .byte 17"),
        (b'{"features": []} {}', "more text after the end"),
        (b'{"a": "', "ends too early"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(text: bytes, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        split(text)


def test_two_items_without_a_comma_between_are_one_broken_item() -> None:
    assert split(b'{"features": [{} {}, 1]}')[0] == [b"{} {}", b"1"]


def test_any_depth_costs_no_recursion_and_an_endless_item_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    deep = b"[" * 50_000 + b"]" * 50_000
    assert split(b'{"features": [' + deep + b", 7]}")[0] == [deep, b"7"]
    monkeypatch.setattr(json_split, "MAX_ITEM_BYTES", 1000)
    monkeypatch.setattr(json_split, "_BLOCK_BYTES", 512)
    with pytest.raises(InputError, match=r"an endless feature .at feature 0, byte 14"):
        split(b'{"features": [' + deep + b"]}")
    with pytest.raises(InputError, match="too much text around"):
        split(b'{"a": "' + b"x" * 2000 + b'", "features": []}')
