// Below 30 km the air's density comes from the vertices. Above (HIGH), a triangle may
// reach beyond the rim of the globe, so all is made at the pixels, and the sun glints on
// the sea. Tiles whose texels are seen large get GRAIN.
layout(binding = 0) uniform sampler2DArray surface;

in vec2 place;
flat in vec4 draw;
#ifdef HIGH
in vec3 seen;
#else
in vec2 air;
#endif

layout(location = 0) out vec4 screen;

float wet(vec3 albedo) {
    return clamp(1.6 * (albedo.b - 1.7 * albedo.r) / (albedo.b + 0.01), 0.0, 1.0) * picture.z;
}

vec4 ground() {
    // Albedo, and how much of it is water, by its blueness.
#ifdef GRAIN
    vec2 x = dFdx(place), y = dFdy(place);
    float pixel = sqrt(max(dot(x, x), dot(y, y)));  // of the cell
    vec2 grains = ground_noise(draw.xy + place * draw.z, pixel * draw.z) * picture.z;
    float texel_px = 1.0 / (256.0 * pixel);
    float strength = clamp(0.12 * texel_px - 0.2, 0.0, 1.0);
    // Large texels are pulled about, so that their rows don't show; not at the edges,
    // where the neighbour's texels are out of reach.
    vec2 inside = min(place, 1.0 - place) * 120.0;
    float pull = strength * min(6.0 / 256.0, 32.0 * pixel);
    pull *= clamp(min(inside.x, inside.y), 0.0, 1.0);
    vec2 seen_place = place + grains * pull;
#else
    vec2 seen_place = place;
#endif
    vec3 albedo = texture(surface, vec3(seen_place, draw.w)).rgb;
    albedo *= albedo;
    float water = wet(albedo);
#ifdef GRAIN
    albedo *= 1.0 + (0.7 - 0.5 * water) * strength * grains.x;
#endif
    return vec4(albedo, water);
}

void main() {
    vec4 land = ground();
#ifdef HIGH
    vec3 up;
    float mu;
    float haze = haze_to(seen, up, mu);
    float light = daylight(up);
#else
    vec2 slope = (2.0 * gl_FragCoord.xy / picture.xy - 1.0) / vec2(right.w, above.w);
    float distance_ = sqrt(1.0 + dot(slope, slope)) / gl_FragCoord.w;
    float haze = hazy(distance_ * air.x);
    float light = air.y;
    float mu = clamp(eye.w / distance_ - distance_ / (2.0 * EARTH), 0.0, 1.0);
#endif
    vec3 colour = mix(land.rgb, MIRRORED_SKY, mirrored(mu) * land.a) * (light * picture.w);
#ifdef HIGH
    vec3 halfway = normalize(sun.xyz - normalize(seen));
    float glint = max(dot(halfway, up), 0.0);
    glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint;
    glint *= glint; glint *= glint;
    float seldom = clamp(eye.w / 3e5 - 0.1, 0.0, 1.0);
    colour += vec3(0.95, 0.95, 0.9) * (0.08 * picture.z * seldom * land.a * glint * glint);
#endif
    vec3 t = clear_through(haze);
    screen = to_screen(colour * t + AIR_LIGHT * light * (1.0 - t));
}
