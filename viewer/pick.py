# SPDX-License-Identifier: Apache-2.0
"""What is drawn at a pixel: a building with its attributes, or a place on the ground."""

from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from tiles import cells, objects
from tiles.errors import InputError
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_geodetic
from tiles.lanes import Lane
from tiles.objects import PROXY_ORDINAL, ObjectTile
from tiles.query import Standing
from viewer.session import Session

Json = dict[str, Any]
ORDINALS = PROXY_ORDINAL + 1


def pick(session: Session, drawn: DrawList, pixel: tuple[int, int]) -> Json:
    """Say what the session's last frame shows at a pixel.

    Parameters
    ----------
    drawn : the list that the frame was drawn from
    pixel : x to the right and y down, from the top left corner

    Returns
    -------
    `kind` is sky, ground, building or proxy; all but the sky have `lat_deg`, `lon_deg` and
    `height_m` above the ellipsoid of the drawn point, and its `cell`. A building has
    `object`, as the store lists it. A proxy has `count`, the buildings that it stands for,
    and `object`, the one that is nearest to the drawn point (None where none is near).

    Raises
    ------
    InputError
    """
    x, y = require_pixel(pixel, session.picture.size_px)
    shown = int(session.renderer.read_ids()[y, x])
    if shown == 0:
        return {"kind": "sky", "pixel": [x, y]}
    point = session.renderer.read_positions()[y, x]
    lon_rad, lat_rad, height_m = (float(one) for one in to_geodetic(Ecef(point)))
    place = {
        "pixel": [x, y],
        "lat_deg": np.degrees(lat_rad),
        "lon_deg": np.degrees(lon_rad),
        "height_m": height_m,
    }
    if shown > 0:
        cell = session.pager.forests[Lane.TERRAIN].records["cell"][drawn.terrain[shown - 1]]
        return place | {"kind": "ground", "cell": cells.text(cell)}
    entry, ordinal = divmod(-1 - shown, ORDINALS)
    tile = _tile(session, int(drawn.objects[entry]))
    if ordinal != PROXY_ORDINAL:
        number: int | None = int(tile.objects["id"][ordinal])
        about: Json = {"kind": "building", "cell": cells.text(tile.cell)}
        return place | about | _object(session, number)
    proxy = _nearest_proxy(tile, point - tile.mesh.centre, int(drawn.proxies[entry]))
    child = int(cells.children(tile.cell)[proxy["child"]])
    standing = Standing(session.store, session.pager.forests[Lane.OBJECTS])
    number = standing.nearest(lon_rad, lat_rad)
    about = {"kind": "proxy", "cell": cells.text(child), "count": int(proxy["count"])}
    return place | about | _object(session, number)


def find_drawn(session: Session, drawn: DrawList, number: int) -> tuple[int, int] | None:
    """Return row of the tile and ordinal of an object; None where it is not drawn.

    Parameters
    ----------
    number : its id
    """
    query = "SELECT cell FROM object WHERE id = ?"
    held = session.store.connection.execute(query, (number,)).fetchone()
    there = session.pager.forests[Lane.OBJECTS].records["cell"][drawn.objects]
    for row in drawn.objects[there == (held[0] if held else -1)].tolist():
        for ordinal in np.flatnonzero(_tile(session, row).objects["id"] == number).tolist():
            return row, ordinal
    return None


def require_pixel(pixel: tuple[int, int], size_px: tuple[int, int]) -> tuple[int, int]:
    """Check that a pixel is in a picture.

    Raises
    ------
    InputError
    """
    (x, y), (width, height) = pixel, size_px
    if not (0 <= x < width and 0 <= y < height):
        reason = f"is not in the picture of {width}x{height}"
        raise InputError(f"pixel {x},{y}", reason, "count from 0,0 at the top left")
    return x, y


def _object(session: Session, number: int | None) -> Json:
    found = session.store.objects([] if number is None else [number])
    return {"object": found[0] if found else None}


def _tile(session: Session, row: int) -> ObjectTile:
    record = session.pager.forests[Lane.OBJECTS].records[row]
    key = int(record["cell"]), int(record["row"]), int(record["check"])
    return objects.decode(session.store.checked_body(Lane.OBJECTS, *key))


def _nearest_proxy(tile: ObjectTile, local: Floats, shown: int) -> np.void:
    """Return the drawn proxy whose box is nearest to a point, (3,) m from the centre."""
    where = tile.mesh.local
    boxes = []
    for proxy in tile.proxies:
        span = tile.mesh.indices[proxy["index_start"] : proxy["index_end"]]
        low, high = where[span].min(axis=0), where[span].max(axis=0)
        hidden = np.inf if not shown >> int(proxy["child"]) & 1 else 0.0
        boxes.append(hidden + np.linalg.norm(np.maximum(low - local, local - high).clip(0)))
    chosen: np.void = tile.proxies[int(np.argmin(boxes))]
    return chosen


def pick_lines(found: Json) -> list[str]:
    """Return what was picked in words."""
    if found["kind"] == "sky":
        return ["sky"]
    place = f"{found['lat_deg']:.7f},{found['lon_deg']:.7f},{found['height_m']:.2f}"
    at = f"at {place} (height above the ellipsoid)"
    if found["kind"] == "ground":
        return [f"ground {at}"]
    one = found["object"]
    named = "none" if one is None else _named(one)
    if found["kind"] == "building":
        return [f"{named} {at}"]
    return [
        f"{found['count']} buildings of cell {found['cell']}, none resolved at this"
        f" distance, {at}; the nearest: {named}"
    ]


def _named(one: Json) -> str:
    return (
        f"object {one['id']} of {one['source']}, {one['height_m']:.1f} m high,"
        f" {one['attributes']}"
    )
