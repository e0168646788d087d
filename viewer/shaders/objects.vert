out vec2 wall;          // windows along the wall, floors above the ground
flat out vec4 paint;    // lit colour behind the air; 1 for walls with windows
flat out vec3 pane;     // colour of windows behind the air
flat out vec3 air;      // light of the air before it
#ifdef FADE
flat out vec2 share;    // part of the screen's pattern that shows it
#endif

uint mixed(uint x) {
    x ^= x >> 16; x *= 0x7feb352du; x ^= x >> 15; x *= 0x846ca68bu; x ^= x >> 16;
    return x;
}

const vec3 WALLS[8] = vec3[8](
    vec3(0.81, 0.79, 0.75), vec3(0.86, 0.85, 0.83), vec3(0.76, 0.73, 0.68),
    vec3(0.70, 0.69, 0.68), vec3(0.79, 0.74, 0.65), vec3(0.64, 0.60, 0.55),
    vec3(0.73, 0.65, 0.58), vec3(0.74, 0.75, 0.77));
const vec3 ROOFS[8] = vec3[8](
    vec3(0.47, 0.47, 0.47), vec3(0.41, 0.42, 0.45), vec3(0.53, 0.52, 0.50),
    vec3(0.60, 0.59, 0.57), vec3(0.48, 0.45, 0.42), vec3(0.60, 0.42, 0.34),
    vec3(0.43, 0.41, 0.40), vec3(0.66, 0.65, 0.63));
// Their means, as light.
const vec3 MEAN_WALL = vec3(0.7572, 0.7298, 0.6936);
const vec3 MEAN_ROOF = vec3(0.5310, 0.5000, 0.4826);
const vec2 WINDOW_M = vec2(2.9, 3.1);

layout(std140, binding = 1) uniform Palette { vec4 palette[256]; };
layout(binding = 2) uniform usamplerBuffer coats;  // palette entries, 0: unstyled
uint style;
const float STYLED_WALL = 0.86;

vec3 own_colour(bool is_roof) {
    if (detail.y == 65535u) return is_roof ? MEAN_ROOF : MEAN_WALL;
    uint h = mixed(uint(draw_place.x) * 1021u + detail.y);
    float shade = 0.92 + 0.16 * float(h >> 8 & 255u) / 255.0;
    return shade * (is_roof ? ROOFS[h >> 3 & 7u] : WALLS[h & 7u]);
}

vec3 styled_colour(bool is_roof) {
    return is_roof ? palette[style].rgb : STYLED_WALL * palette[style].rgb;
}

void main() {
    int coat = int(draw_place.w);
    style = detail.y == 65535u ? uint(coat) : texelFetch(coats, coat + int(detail.y)).r;
#ifdef FADE
    share = draw_place.yz;
#endif
    vec3 seen = seen_from_eye();
    gl_Position = to_clip(seen);
    vec3 n = normal.xyz;
    bool is_roof = flags == 1;
    vec3 colour = linear_of(style != 0u ? styled_colour(is_roof) : own_colour(is_roof));
    float height = max(length(eye.xyz + seen * TO_UNIT) - 1.0, 0.0);
    // What lies between far buildings (trees, yards, shadows) is not drawn: it darkens them.
    float away = length(seen), crowd = 1.0 - 0.35 * smoothstep(1000.0, 8000.0, away);
    vec3 t = clear_through(air_per_way(height) * away / EARTH);
    vec3 light = t * (picture.w * crowd) * ground_light.rgb;
    float facing = dot(n, sun.xyz);
    float open_sky = 0.5 + 0.5 * dot(n, draw_up.xyz);
    vec3 ambient = mix(vec3(0.30, 0.28, 0.26), vec3(0.36, 0.42, 0.52), open_sky);
    vec3 lit = ambient * (1.0 + 0.25 * facing) + vec3(0.72, 0.66, 0.57) * max(facing, 0.0);
    paint = vec4(colour * lit * light, is_roof || style != 0u ? 0.0 : 1.0);
    pane = vec3(0.07, 0.10, 0.14) * (0.55 + 0.45 * max(facing, 0.0)) * light;
    air = thick_here(near_sun(seen / max(away, 1e-3))) * (1.0 - t);
    // The wall's level direction: whole along a flat wall, so windows stay in line.
    vec3 along = cross(draw_up.xyz, n);
    along *= inversesqrt(max(dot(along, along), 1e-6));
    float along_m = dot(vec3(step_position) * draw_origin.w, along);
    float above_ground_m = 0.1 * float(int(detail.x << 16) >> 16);
    wall = vec2(along_m, above_ground_m) / WINDOW_M;
}
