out vec2 place;  // in the texture
flat out vec4 draw;
#ifdef GRAIN
out float texels;  // across what the data show
out vec2 spot;     // in the cell
#endif
#ifdef HIGH
out vec3 seen;
#else
out vec2 air;  // scale heights of air, and mist, on a metre of the way
#endif

float width(vec3 q) {
    // The share of its texture that a cell takes across at a place (ingest/polar.py): the
    // angle to the pole by 45 degrees. From the unit sphere to the ellipsoid's up: by
    // (a / b)^2. The arc sine is a polynomial, off by less than 1e-4.
    float axis = dot(q.xy, q.xy), square = axis / (axis + 1.00673950 * q.z * q.z);
    float series = 1.0 + square * (0.16942 + square * (0.04971 + square * 0.10837));
    return min(sqrt(square) * series / 0.78539816, 1.0);
}

void main() {
    vec3 on_ground = seen_from_eye(), from_eye = on_ground + hem();
    place = vec2(detail) / 32768.0;
    float share = width(eye.xyz + on_ground * TO_UNIT);
    draw = draw_place;
#ifdef GRAIN
    spot = place;
    // Near a pole the grain, which follows longitudes, would be drawn out to fibres.
    texels = draw_entry.w * clamp(2.25 * share - 0.5, 0.0, 1.0);
#endif
    place.x = 0.5 + (place.x - 0.5) * share;
#ifdef HIGH
    seen = from_eye;
#else
    air = air_per_way(max(length(eye.xyz + from_eye * TO_UNIT) - 1.0, 0.0)) / EARTH;
#endif
    gl_Position = to_clip(from_eye);
}
