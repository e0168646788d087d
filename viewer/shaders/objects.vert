out vec3 seen;
out vec2 wall;          // metres along the wall, metres above the base
flat out vec4 paint;    // lit colour; 1 for walls with windows
flat out vec2 glass;    // light on windows; height of a floor, m

uint mixed(uint x) {
    x ^= x >> 16; x *= 0x7feb352du; x ^= x >> 15; x *= 0x846ca68bu; x ^= x >> 16;
    return x;
}

const vec3 PLASTER[8] = vec3[8](
    vec3(0.86, 0.82, 0.74), vec3(0.90, 0.88, 0.84), vec3(0.80, 0.72, 0.60),
    vec3(0.84, 0.76, 0.66), vec3(0.74, 0.76, 0.76), vec3(0.88, 0.80, 0.66),
    vec3(0.78, 0.66, 0.58), vec3(0.70, 0.62, 0.54));
const vec3 TILES[8] = vec3[8](
    vec3(0.64, 0.44, 0.35), vec3(0.52, 0.51, 0.50), vec3(0.60, 0.50, 0.42),
    vec3(0.45, 0.45, 0.47), vec3(0.70, 0.67, 0.61), vec3(0.57, 0.42, 0.35),
    vec3(0.62, 0.62, 0.61), vec3(0.50, 0.45, 0.41));
const vec3 MEAN_PLASTER = vec3(0.81, 0.75, 0.67);
const vec3 MEAN_TILES = vec3(0.58, 0.51, 0.465);

vec3 own_colour(bool is_roof) {
    if (detail.y == 65535u) return is_roof ? MEAN_TILES : MEAN_PLASTER;
    uint h = mixed(uint(draw_place.x) * 1021u + detail.y);
    float shade = 0.9 + 0.2 * float(h >> 8 & 255u) / 255.0;
    return shade * (is_roof ? TILES[h >> 3 & 7u] : PLASTER[h & 7u]);
}

void main() {
    seen = seen_from_eye();
    gl_Position = to_clip(seen);
    vec3 n = normal.xyz;
    bool is_roof = flags == 1;
    float facing = dot(n, sun.xyz);
    float open_sky = 0.5 + 0.5 * dot(n, draw_up.xyz);
    vec3 ambient = mix(vec3(0.40, 0.36, 0.32), vec3(0.52, 0.58, 0.68), open_sky);
    vec3 lit = ambient * (1.0 + 0.25 * facing) + vec3(0.74, 0.68, 0.58) * max(facing, 0.0);
    vec3 colour = own_colour(is_roof);
    paint = vec4(colour * colour * lit * picture.w, is_roof ? 0.0 : 1.0);
    // The wall's level direction: whole along a flat wall, so windows stay in line.
    vec3 along = cross(draw_up.xyz, n);
    along *= inversesqrt(max(dot(along, along), 1e-6));
    wall = vec2(dot(vec3(step_position) * draw_origin.w, along), float(detail.x) * 0.1);
    glass = vec2(0.55 + 0.45 * max(facing, 0.0), 3.1);
}
