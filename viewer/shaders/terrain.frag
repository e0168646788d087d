// Below 30 km, air and light come from the vertices. Above (HIGH), a triangle may reach
// beyond the rim of the globe, so all is made at the pixels. Tiles whose texels are seen
// large get GRAIN, those that show blue get WATER.
layout(binding = 0) uniform sampler2DArray surface;

in vec2 place;
flat in vec4 draw;
#ifdef GRAIN
in float texels;
in vec2 spot;
#endif
#ifdef HIGH
in vec3 seen;
#else
in vec2 air;
#endif

layout(location = 0) out vec4 screen;

float wet(vec3 albedo) {
    return clamp(1.6 * (albedo.b - 1.7 * albedo.r) / (albedo.b + 0.01), 0.0, 1.0) * picture.z;
}

vec4 ground(out vec2 grains) {
    // Albedo, and how much of it is water, by its blueness.
#ifdef GRAIN
    vec2 x = dFdx(place), y = dFdy(place);
    float pixel = sqrt(max(dot(x, x), dot(y, y)));  // of the cell
    grains = ground_noise(draw.xy + spot * draw.z, pixel * draw.z) * picture.z;
    float texel_px = 1.0 / (256.0 * pixel);
    // Large texels are pulled about, so that their rows don't show; not at the edges,
    // where the neighbour's texels are out of reach.
    vec2 inside = min(place, 1.0 - place) * 120.0;
    float pull = clamp(0.12 * texel_px - 0.2, 0.0, 1.0) * min(6.0 / 256.0, 32.0 * pixel);
    pull *= clamp(min(inside.x, inside.y), 0.0, 1.0);
    vec2 seen_place = place + grains * pull;
    grains *= clamp(0.12 * texels * texel_px - 0.2, 0.0, 1.0);
#else
    grains = vec2(0.0);
    vec2 seen_place = place;
#endif
    vec3 albedo = linear_of(texture(surface, vec3(seen_place, draw.w)).rgb);
#ifdef WATER
    float water = wet(albedo);
    albedo *= 1.0 - 0.35 * water;
#else
    const float water = 0.0;
#endif
    albedo *= 1.0 + (0.7 - 0.5 * water) * grains.x;
    return vec4(albedo, water);
}

void main() {
    vec2 grains;
    vec4 land = ground(grains);
#ifdef HIGH
    vec3 way = normalize(seen), q = eye.xyz + seen * TO_UNIT;
    float radius = length(q), height = max(radius - 1.0, 0.0);
    vec3 up = q / radius;
    float mu = max(-dot(up, way), 0.0), rise = rise_at(up), near = near_sun(way);
    vec3 light = sunlight(rise), haze = skylight(near, rise, 1.0);
    vec2 before = vec2(air_to(length(seen), height, mu), dense(height).y / (mu + 0.02));
#else
    vec2 slope = slope_of_pixel();
    float stretch = sqrt(1.0 + dot(slope, slope)), distance_ = stretch / gl_FragCoord.w;
    float near = 0.5 + 0.5 * along_slope(slope, sun_by_axes()) / stretch;
    vec3 light = ground_light.rgb, haze = thick_here(near);
    vec2 before = distance_ * air;
#endif
    vec3 colour = land.rgb;
#ifdef WATER
#ifndef HIGH
    float down = along_slope(slope, upright.xyz) / stretch;
    float mu = clamp(-down - distance_ / EARTH, 0.0, 1.0);
    float rise = ground_light.w;
#endif
    vec3 mirror = MIRRORED_SKY + land.a * glint(near, rise, mu) / (mu + 0.3);
    colour = mix(colour, mirror, mirrored(mu) * land.a);
#endif
    screen = to_screen(mix(haze, colour * light * picture.w, clear_through(before)));
}
