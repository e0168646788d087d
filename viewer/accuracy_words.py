# SPDX-License-Identifier: Apache-2.0
"""What `geopage accuracy` found, in a few lines for the terminal."""

from viewer.tally import Json


def parts_of(report: Json) -> list[Json]:
    """Return the figures of each threshold."""
    found: list[Json] = report.get("thresholds", [report])
    return found


def summary(report: Json) -> str:
    """Say what was measured in a few lines."""
    said = [line for found in parts_of(report) for line in _lines(found, report["views"])]
    said += [
        f"heights of {one['name']}: off by at most {one['max_m']:.3f} m at"
        f" {one['places']:,} places, {one['share_of_bound']:.2f} x what the tile states"
        for one in report.get("heights", [])
        if one["places"]
    ]
    said += [
        f"flight {one['flight']} at {one['threshold_px']:g} px: {one['triangles']:,.0f}"
        f" triangles, {one['triangles_ratio']:.2f} x those at 45 degrees"
        for one in report.get("flights", [])
    ]
    said += [
        f"selection over {one['cells']:,} cells of {one['index']}: p50"
        f" {one['p50_ms']:.3f} ms, p99 {one['p99_ms']:.3f}"
        for one in report.get("selection", [])
    ]
    return "\n".join(said)


def _lines(found: Json, views: int) -> list[str]:
    if not found["pixels_judged"]:
        return ["no pixel could be judged: no view shows a place where a source has posts"]
    share = {k: 100 * v for k, v in shares(found).items()}
    lines = [
        f"geometric error of {views} views at {found['threshold_px']:g} px:"
        f" p50 {found['p50']:.2f} px,"
        f" p95 {found['p95']:.2f}, p99 {found['p99']:.2f}, largest {found['max']:.2f}",
        f"{share['within_threshold']:.4f} % of {found['pixels_judged']:,} pixels are"
        f" within {found['threshold_px']:g} px or the leaf's own bound; the leaf limits"
        f" {share['limited_by_leaf']:.2f} %; {share['not_judged']:.2f} % were not judged",
        f"worst pixel: {worst_pixel(found)}",
    ]
    if "views_with_raised_threshold" in found:
        raised = found["views_with_raised_threshold"]
        lines.append(
            f"{raised} views needed more than --budget: their threshold was raised"
        )
    if "silhouette" in found:
        moved = {k: 100 * v for k, v in shares(found["silhouette"]).items()}
        lines.append(
            f"silhouettes: {moved['displaced']:.3f} % of pixels show another side,"
            f" {moved['beyond_limit']:.3f} % by more than the limit and a pixel"
        )
    return lines


def worst_pixel(found: Json) -> str:
    """Say how far off the worst pixel is, and from where it is seen."""
    worst = found["worst_view"]
    return (
        f"{worst['error_px']:.2f} px, allowed {worst['limit_px']:.2f} px;"
        f" seen with --at {worst['lat_deg']:.6f},{worst['lon_deg']:.6f},"
        f"{worst['height_m']:.2f} --height-reference ellipsoid"
        f" --look {worst['heading_deg']:.3f},{worst['pitch_deg']:.3f}"
    )


def shares(found: Json) -> Json:
    """Return the shares of a report, by their names without `share_`."""
    prefix = "share_"
    return {
        key.removeprefix(prefix): value
        for key, value in found.items()
        if key.startswith(prefix)
    }
