# SPDX-License-Identifier: Apache-2.0
"""Pictures of the ground, painted from the vector tiles' other layers."""

from pathlib import Path

import numpy as np
import rasterio
from common import GEOGRAPHIC, VOID, write_rgb_jpeg
from mvt import Feature, TileSet
from numpy.typing import NDArray
from painter import Painter, anything, has
from rasterio.warp import Resampling, reproject
from scipy import ndimage

Array = NDArray[np.float64]
ROAD_M = {
    "primary": 15.0,
    "secondary": 13.0,
    "tertiary": 11.5,
    "street": 9.5,
    "street_limited": 8.0,
    "link": 7.0,
    "service": 4.5,
    "track": 3.0,
}


def road_width(feature: Feature) -> float:
    """Width of a carriageway in metres; 0 for paths, rails and tunnels."""
    if feature.properties.get("structure") == "tunnel":
        return 0.0
    return ROAD_M.get(str(feature.properties.get("class")), 0.0)


def path_width(feature: Feature) -> float:
    """Width of a footway in metres, 0 for anything else."""
    if feature.properties.get("type") in ("sidewalk", "crossing"):
        return 0.0
    return 2.2 if feature.properties.get("class") in ("path", "pedestrian") else 0.0


def paint_greens(p: Painter, fine: Array, broad: Array) -> None:
    """Gardens behind the houses, parks, meadows, woods and their trees."""
    footprints = p.areas("building", anything)
    built = ndimage.gaussian_filter(footprints, 16.0)
    roads = p.lines("road", road_width, 5.0)
    to_road = ndimage.distance_transform_edt(roads < 0.3) * p.metres
    wild = ndimage.gaussian_filter(p.areas("landcover", has("scrub")), 6.0)
    wood = ndimage.gaussian_filter(p.areas("landcover", has("wood")), 5.0)
    yards = np.clip((to_road - 12.0) / 10.0, 0.0, 1.0) * np.clip(built * 3.0, 0.0, 1.0)
    patches = np.clip(0.45 + 0.35 * p.noise(2.2), 0.0, 1.0)
    p.lay(0.75 * yards * patches, (112, 118, 86), 7 * fine)
    open_land = np.clip(1.0 - built * 4.0, 0.0, 1.0)
    p.lay(0.55 * open_land, (142, 138, 104), 5 * broad)
    p.lay(0.75 * wild * open_land, (116, 120, 82), 5 * broad + 4 * fine)
    park = p.areas("landuse", has("park"))
    p.lay(park, (114, 124, 86), 7 * broad + 3 * fine)
    dry = np.clip(0.5 + 0.6 * p.noise(14.0), 0.0, 1.0)
    p.lay(0.40 * park * dry, (148, 146, 100), 4 * fine)
    p.lay(p.areas("landuse", has("grass")), (126, 136, 92), 4 * fine)
    p.lay(p.areas("landuse", has("school", "hospital")) * 0.5, (160, 155, 143), 3 * fine)
    forest = np.maximum(p.areas("landuse", has("wood")), wood * np.maximum(park, wild))
    p.lay(0.8 * forest, (74, 92, 58), 6 * broad + 4 * fine)
    trees = 0.0045 * park + 0.05 * forest + 0.006 * yards + 0.004 * wild * open_land
    trees = trees * np.clip(1.0 - 2.0 * roads, 0.0, 1.0)
    crowns, tone = p.crowns(trees, (2.0, 5.0))
    shadow = np.roll(crowns, (1, 1), (0, 1))
    p.lay(0.35 * ndimage.gaussian_filter(shadow, 0.7), (52, 60, 44))
    p.lay(0.88 * crowns, (82, 98, 60), 0.9 * tone + 2 * fine)


def paint_streets(p: Painter, fine: Array) -> None:
    """Pavements, carriageways, car parks, paths and playing fields."""
    p.lay(0.9 * p.areas("landuse", has("pitch")), (120, 136, 98), 2 * fine)
    courts = p.areas("landuse", has("tennis", "basketball"))
    p.lay(courts, (108, 128, 116), 1.5 * fine)
    p.lay(0.9 * p.areas("landuse", has("baseball")), (132, 146, 92), 3 * fine)
    p.lay(0.95 * p.areas("landuse", has("parking")), (128, 127, 126), 4 * fine)
    p.lay(0.8 * p.lines("road", path_width), (186, 176, 154), 3 * fine)
    p.lay(p.lines("road", road_width, 6.0), (184, 180, 171), 3 * fine)
    asphalt = p.lines("road", road_width)
    p.lay(asphalt, (116, 115, 114), 3.0 * fine + 3.0 * p.noise(5.0))
    main = p.lines("road", lambda f: road_width(f) if road_width(f) > 11.0 else 0.0)
    p.lay(0.5 * main, (104, 103, 103), 2 * fine)
    kerb_trees = p.lines("road", road_width, 5.0) - p.lines("road", road_width, 1.5)
    crowns, tone = p.crowns(0.016 * np.clip(kerb_trees, 0.0, 1.0), (1.4, 2.8))
    p.lay(0.8 * crowns, (90, 104, 68), tone)
    water = p.areas("water", anything)
    p.lay(water, (86, 108, 122), 1.5 * p.noise(2.0))


def build_city_ground(tiles: TileSet, out: Path) -> NDArray[np.uint8]:
    """Write ``sanfrancisco_ground.tif`` (2 m)."""
    p = Painter(tiles, 1448, 1448, 2.0)
    fine, broad = p.noise(0.6), p.noise(25.0)
    p.colour += np.asarray((168.0, 160.0, 146.0))
    p.lay(np.ones((p.rows, p.columns)), (166, 159, 147), 4 * fine + 3 * broad)
    paint_greens(p, fine, broad)
    paint_streets(p, fine)
    picture = p.finished()
    path = out / "sanfrancisco_ground.tif"
    write_rgb_jpeg(path, picture, GEOGRAPHIC, p.transform, 86)
    return picture


def heights_at(p: Painter, dem: Path) -> Array:
    """Elevations of a terrain file at the picture's pixels, voids filled by neighbours."""
    found = np.full((p.rows, p.columns), np.nan)
    with rasterio.open(dem) as file:
        reproject(
            file.read(1).astype(np.float64),
            found,
            src_transform=file.transform,
            src_crs=file.crs,
            src_nodata=VOID,
            dst_transform=p.transform,
            dst_crs=GEOGRAPHIC,
            dst_nodata=np.nan,
            resampling=Resampling.bilinear,
        )
    holes = np.isnan(found)
    nearest = ndimage.distance_transform_edt(
        holes, return_distances=False, return_indices=True
    )
    return np.asarray(found[tuple(nearest)])


def build_mountain_ground(tiles: TileSet, out: Path) -> NDArray[np.uint8]:
    """Write ``langtang_ground.tif`` (about 20 m): cover by map and by height."""
    p = Painter(tiles, 1292, 2160, 20.0)
    height = heights_at(p, out / "langtang.tif")
    slope = np.hypot(*np.gradient(ndimage.gaussian_filter(height, 1.0), p.metres))
    fine, broad, middle = p.noise(0.6), p.noise(22.0), p.noise(4.0)
    level = height + 90.0 * broad + 60.0 * middle

    def above(start: float, end: float) -> Array:
        return np.clip((level - start) / (end - start), 0.0, 1.0)

    def cover(layer: str, *classes: str) -> Array:
        return ndimage.gaussian_filter(p.areas(layer, has(*classes)), 2.0)

    everywhere = np.ones((p.rows, p.columns))
    p.lay(everywhere, (122, 118, 78), 5 * middle + 4 * fine)
    wood = np.maximum(cover("landuse", "wood"), 0.7 * cover("landcover", "wood"))
    p.lay(
        0.55 * cover("landcover", "scrub") * (1 - above(4000, 4500)),
        (98, 104, 66),
        4 * fine,
    )
    p.lay(0.9 * wood * (1 - above(4000, 4300)), (62, 80, 50), 5 * middle + 5 * fine)
    p.lay(above(3700, 4300), (134, 122, 92), 5 * middle + 4 * fine)
    p.lay(0.9 * above(4500, 5000), (128, 120, 110), 6 * middle + 4 * fine)
    steep = np.clip((slope - 0.9) / 0.6, 0.0, 1.0) * (0.35 + 0.65 * above(2500, 4500))
    p.lay(0.75 * steep, (116, 110, 102), 8 * middle + 5 * fine)
    p.lay(0.5 * cover("landuse", "agriculture"), (146, 138, 92), 4 * fine)
    p.lay(0.8 * cover("landuse", "rock"), (138, 132, 124), 6 * fine)
    holds = 1.0 - 0.8 * np.clip((slope - 1.1) / 0.5, 0.0, 1.0)
    snow = np.maximum(above(5050, 5500) * holds, 0.8 * cover("landcover", "snow") * holds)
    p.lay(np.maximum(snow, cover("landuse", "glacier")), (233, 238, 244), 2 * middle)
    p.lay(p.areas("water", anything), (92, 122, 130))
    p.lay(0.75 * p.lines("waterway", river_width), (128, 146, 148))
    p.lay(0.5 * p.lines("road", lambda f: 9.0 if road_width(f) else 0.0), (172, 160, 134))
    picture = p.finished()
    write_rgb_jpeg(out / "langtang_ground.tif", picture, GEOGRAPHIC, p.transform, 86)
    return picture


def river_width(feature: Feature) -> float:
    """Drawn width of a waterway in metres."""
    return 22.0 if feature.properties.get("class") == "river" else 7.0
