// Air and sun: single scattering, shortened. Colours are linear.
//
// Air scatters blue most: optical depths straight up are 0.046, 0.108 and 0.265 in red,
// green and blue, over a scale height of 8 km; mist scatters all colours, over a sixth of
// that (Bruneton and Neyret 2008, Precomputed Atmospheric Scattering). The former are
// nearly as 1 : 2 : 4, so one power gives all three. A low sun loses blue in the same way.

const float SCALE_HEIGHT = 8000.0 / EARTH;
const float SHELL = 5.0 * SCALE_HEIGHT;
const float MIST = 0.036;  // optical depth straight up, of base 2
const vec3 HORIZON = vec3(0.60, 0.71, 0.86);
const vec3 ZENITH = vec3(0.50, 0.70, 1.02);
const vec3 DUSK = vec3(0.20, 0.30, 0.55);
const vec3 AFTERGLOW = vec3(0.90, 0.42, 0.16);
const vec3 MOON = vec3(0.75, 0.95, 1.30);

vec3 moonlight() {
    // The night side stays readable.
    return sun.w * mix(MOON, vec3(1.0), sun.w);
}

vec3 through_air(float day) {
    // Colour of the sun where a share of its green arrives.
    return vec3(sqrt(day), day, day * day);
}

vec3 sunlight(float rise) {
    // On level ground, of 1 by day; the sine of the sun's height.
    return mix(moonlight(), vec3(1.0), through_air(smoothstep(-0.12, 0.40, rise)));
}

vec3 skylight(float near, float rise, float thick) {
    // Of so much air along a way that none passes through. Near is 1 towards the sun, 0
    // away from it; thick air has lost its blue.
    float day = smoothstep(-0.12, 0.40, rise);
    float late = max(smoothstep(-0.30, 0.20, rise) - day, 0.0);
    vec3 air = mix(ZENITH, HORIZON, thick) * through_air(day);
    return air * (1.14 - 1.12 * near * (1.0 - near))
        + late * (0.3 + near) * mix(DUSK, AFTERGLOW, thick * near)
        + 0.05 * moonlight() * HORIZON;
}

float rise_at(vec3 up) {
    // Sine of the sun's height: the eye's at 30 km, where it serves for all that is seen,
    // and from 120 km on that of each place.
    return mix(ground_light.w, dot(up, sun.xyz), clamp(eye.w / 9e4 - 1.0 / 3.0, 0.0, 1.0));
}

float near_sun(vec3 way) {
    return 0.5 + 0.5 * dot(way, sun.xyz);
}

vec3 sun_by_axes() {
    return vec3(thin_air[0].w, thin_air[1].w, thin_air[2].w);
}

vec3 thin_here(float near) {
    // The same at the eye's place, in thin air and in thick.
    return thin_air[0].rgb + near * (thin_air[1].rgb + near * thin_air[2].rgb);
}

vec3 thick_here(float near) {
    return thick_air[0].rgb + near * (thick_air[1].rgb + near * thick_air[2].rgb);
}

vec2 dense(float height) {
    // Of air and mist at a height, 1 at sea level.
    float air = exp2(-1.442695 * height / SCALE_HEIGHT), cube = air * air * air;
    return vec2(air, cube * cube);
}

vec2 air_per_way(float height) {
    // Air and mist, in scale heights, on a straight way from a height to the eye.
    vec2 here = dense(height), at_eye = vec2(thick_air[0].w, thick_air[1].w);
    float climb = eye.w / EARTH - height;
    return abs(climb) < 1e-6 ? here * vec2(1.0, 6.0) / SCALE_HEIGHT : (here - at_eye) / climb;
}

float relative_air(float height, float other, float length_) {
    // Air between two heights on a straight way of some length, in scale heights.
    float x = (other - height) / SCALE_HEIGHT;
    float mean = abs(x) < 1e-3 ? 1.0 : (1.0 - exp2(-1.442695 * x)) / x;
    return length_ / SCALE_HEIGHT * dense(height).x * mean;
}

float air_to(float distance_, float height, float mu) {
    // Air between the eye and a point at a height whose up and way to the eye make mu.
    float from_shell = sqrt(mu * mu + 2.0 * SHELL) - mu;
    float way = min(distance_ / EARTH, from_shell);
    float start = distance_ / EARTH > from_shell ? height + SHELL : eye.w / EARTH;
    return relative_air(height, start, way);
}

vec3 clear_through(vec2 way) {
    // Share of the light that passes so much air and mist. Steep views are clearer than by the air alone, as
    // pictures from above are developed.
    float t = exp2(-0.085 * way.x * (0.4 + 0.11 * way.x) * zenith.w), t2 = t * t;
    return vec3(t, t2, t2 * t2) * exp2(-MIST * way.y * zenith.w);
}
