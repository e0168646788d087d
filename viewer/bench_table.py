# SPDX-License-Identifier: Apache-2.0
"""The columns of results.csv, what each means, and writing the file."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from viewer.files import csv_text

Json = dict[str, Any]


class Column(NamedTuple):
    """One column; its name ends with the unit."""

    name: str
    means: str
    source: str = ""


ANDERSSON = "Andersson and others, FLIP, HPG 2020"
COLUMNS = (
    Column("method", "what chooses the detail; see the table of methods"),
    Column(
        "mode",
        "settled: key frames spread evenly over the path, each drawn when all that it wants"
        " is there. paced: the path flown in real time, tiles read by the pager meanwhile;"
        " its key frames are frames of that flight, as they were drawn",
    ),
    Column("threshold_px", "largest screen error that the method allows itself"),
    Column("frames", "frames that were timed: key frames, or all frames of the flight"),
    Column(
        "frame_p50_ms",
        "time of a frame, median. settled: warm, the median of 3 draws of each key frame,"
        " the rows drawn in turn; paced: uploads, culling, drawing and waiting for the GPU,"
        " each frame once",
    ),
    Column("frame_p95_ms", "95th percentile"),
    Column("frame_p99_ms", "99th percentile"),
    Column("frame_max_ms", "longest"),
    Column(
        "frame_spread_ms",
        "settled: largest minus least of a key frame's 3 draws, median of the key frames",
    ),
    Column(
        "jank_ms", "paced: sum over all frames of what is beyond 16.7 ms", "60 Hz screen"
    ),
    Column(
        "floor_p50_ms",
        "paced: the same frames again with everything resident, median: what the flight"
        " would have taken if paging were free",
    ),
    Column("floor_p99_ms", "99th percentile of the same"),
    Column("settle_ms", "paced: time from an empty pager to the first settled view"),
    Column("triangles", "drawn in a frame, mean"),
    Column("ground_triangles", "those of terrain alone, mean of the key frames"),
    Column("draw_calls", "draws inside the frame's multi-draws, mean"),
    Column("objects", "buildings and proxies drawn in a frame, mean"),
    Column(
        "bytes",
        "stored size of all tiles drawn, each once: the least that any pager must read",
    ),
    Column("tiles", "how many tiles these are"),
    Column("bytes_read", "paced: what the pager did read"),
    Column(
        "oracle_bytes",
        "paced, geopage: what a pager reads that knows the whole flight, by a virtual"
        " clock; a floor of bytes_read",
        "the clairvoyant pager of `geopage replay`",
    ),
    Column("oracle_tiles", "and the tiles that it loads"),
    Column("stand_in_frames", "paced: frames in which a coarser tile stood in for one"),
    Column(
        "selection_error_px",
        "error that the selection knows, mean over a frame's terrain pixels, median of the"
        " key frames; it is not measured on the picture",
    ),
    Column("hole_frames", "key frames with a pixel or an object missing"),
    Column(
        "error_p50_px",
        "geometric error of the drawn terrain, median of the judged pixels: the larger of"
        " the shortest distance from the drawn point to the sources' own posts joined by"
        " triangles, and of that from the reference ray's hit (float64) to the drawn"
        " triangles, times focal length / depth. This is the error that counts",
        "design of geopage; both ways as a Hausdorff distance",
    ),
    Column("error_p95_px", "95th percentile"),
    Column("error_p99_px", "99th percentile"),
    Column("error_max_px", "largest"),
    Column(
        "share_within_threshold",
        "share of judged pixels whose error is within the threshold or what the finest"
        " tile itself states",
    ),
    Column(
        "psnr_db",
        "10 log10(255² / mean squared difference) between key frames and reference frames,"
        " over all 8-bit sRGB channels of all key frames; inf: not a bit differs",
        "the usual definition",
    ),
    Column(
        "flip_mean",
        "LDR-FLIP between key frame and reference frame at 67 pixels a degree, mean of all"
        " pixels: 0 alike, 1 as different as can be",
        ANDERSSON,
    ),
    Column("flip_worst_frame", "the same, of the key frame where it is largest", ANDERSSON),
    Column(
        "popping_mean",
        "FLIP from a key frame to the next frame, where it is beyond the same of the"
        " reference frames; mean over pixels and key frames. Next is 1/60 s later when"
        " settled, the flight's next frame when paced",
        "FLIP as above",
    ),
    Column(
        "popping_max", "the same, of the key frame where it is largest", "FLIP as above"
    ),
)
NAMES = tuple(column.name for column in COLUMNS)


def as_csv(rows: Sequence[Json], about: Json) -> str:
    """Return results.csv: comment lines that say where it was measured, then the table."""
    table = [[cell(row[key]) if key in row else "" for key in NAMES] for row in rows]
    return csv_text(about, NAMES, table)


def cell(value: Any) -> str:
    """Return a value as text: six digits are more than any figure here has."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
