# SPDX-License-Identifier: Apache-2.0
"""Heights of a store against the source file's own triangles, at random places.

The source is read by rasterio and its datum applied by PROJ, at the posts; `ingest` has no
part in it. With `-s` the worst place is printed. `GEOPAGE_STORE=world.geopage` measures a
store made of the sample files instead, 10,000 places a source.
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import rasterio

from ingest.terrain import ingest_rasters
from tests.ingest.rasters import (
    EGM96,
    Floats,
    own_surface_m,
    places_in,
    posts_m,
)
from tiles.samples import SAMPLES
from tiles.store import Store
from tiles.surface import Surface
from tiles.winner import Winners

SIDE = 300
PLACES = 10_000
MARGIN_M = 1e-3
"""Two programs' geodesy, and an error that is stored as float32"""


@dataclass(frozen=True, slots=True)
class Sampled:
    """What was found at those places where the source wins."""

    lon_deg: Floats
    lat_deg: Floats
    gap_m: Floats
    """drawn height less the source's"""
    error_m: Floats
    """what the store states there"""
    left_out: int
    """places where a finer source wins, or bends the ground"""

    @property
    def excess_m(self) -> Floats:
        """How far each place is beyond its stated error; negative within."""
        return np.abs(self.gap_m) - self.error_m


def sampled(store: Path, source: Path, rng: np.random.Generator) -> Sampled:
    """Compare heights at random places of a source that lies on EGM96."""
    lon, lat = places_in(source, PLACES, rng)
    with Store(store) as opened:
        winners = Winners(opened)
        found = winners.at(np.radians(lon), np.radians(lat))
        wins = np.array([one.source == source.stem and not one.feathered for one in found])
        lon, lat = lon[wins], lat[wins]
        height, error = Surface(opened).heights(np.radians(lon), np.radians(lat))
    gap = height - own_surface_m(source, lon, lat, egm96=True)
    known = np.isfinite(gap)
    left_out = PLACES - int(known.sum())
    return Sampled(lon[known], lat[known], gap[known], error[known], left_out)


def report(name: str, one: Sampled) -> None:
    """Print the share within the stated error, and the worst place."""
    excess = one.excess_m
    worst, share = int(excess.argmax()), float((excess <= MARGIN_M).mean())
    gap = np.abs(one.gap_m)
    sys.stdout.write(
        f"\n{name}: {len(gap)} places ({one.left_out} are another source's), "
        f"{share:.2%} within the stated error (median {np.median(one.error_m):.3f} m); "
        f"off by p50 {np.median(gap):.3f}, p99 {np.quantile(gap, 0.99):.3f}, "
        f"max {gap.max():.3f} m; worst excess {excess[worst]:+.4f} m "
        f"at {one.lat_deg[worst]:.6f} {one.lon_deg[worst]:.6f}\n"
    )


def cut(
    path: Path, source: Path, left_top: tuple[int, int], shape: tuple[int, int]
) -> Path:
    """Write (rows, columns) posts of a raster from a column and row on."""
    (left, top), (high, wide) = left_top, shape
    with rasterio.open(source) as whole:
        a, _, west, _, e, north = tuple(whole.transform)[:6]
        where = rasterio.Affine(a, 0.0, west + left * a, 0.0, e, north + top * e)
        profile = whole.profile | {"width": wide, "height": high, "transform": where}
        with rasterio.open(path, "w", **profile) as out:
            out.write(whole.read()[:, top : top + high, left : left + wide])
    return path


def middle_of(path: Path, source: Path) -> Path:
    """Cut SIDE x SIDE posts out of the middle of a raster."""
    with rasterio.open(source) as whole:
        corner = (whole.width - SIDE) // 2, (whole.height - SIDE) // 2
    return cut(path, source, corner, (SIDE, SIDE))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["langtang", "sanfrancisco"])
def test_heights_are_within_the_stated_error_of_the_source(
    name: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    source = SAMPLES / f"{name}.tif"
    if name == "langtang":
        source = middle_of(tmp_path / "langtang.tif", source)
    store = tmp_path / "world.geopage"
    ingest_rasters(store, [(source, EGM96)], workers=1)
    found = sampled(store, source, rng)
    report(name, found)
    assert len(found.gap_m) > 0.98 * PLACES
    assert (found.excess_m <= MARGIN_M).all()
    # An error that allows everything would prove nothing.
    relief_m = float(np.nanstd(posts_m(source, egm96=True)))
    assert np.median(found.error_m) < relief_m / 30


@pytest.mark.slow
@pytest.mark.skipif("GEOPAGE_STORE" not in os.environ, reason="names no store")
@pytest.mark.parametrize("name", ["earth", "himalaya", "langtang", "sanfrancisco"])
def test_heights_of_a_store_of_the_samples(name: str, rng: np.random.Generator) -> None:
    found = sampled(Path(os.environ["GEOPAGE_STORE"]), SAMPLES / f"{name}.tif", rng)
    report(name, found)
    assert (found.excess_m <= MARGIN_M).all()
