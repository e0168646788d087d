// Below 30 km, the eye's own up and light serve all of the sky. Above (HIGH), a ray has
// those of the place where it is nearest to the ground.
layout(location = 0) out vec4 screen;

const vec3 SUN = vec3(14.0, 13.0, 11.0);
const float SUN_COSINE = 0.99998925;  // of its radius, 0.266 degrees
const float LEVEL = 38.0;  // air along the horizon, of that straight up

float slant(float cosine) {
    // Air above a point towards a direction, relative to straight up: 1 to 38.
    float x = 1.0 + 9.0 * cosine;
    x *= x;
    return x / (cosine * x + 1.0 / LEVEL);
}

float air_along(float rise, float radius, float at_eye, out vec2 density) {
    // Air from the eye to infinity, and how dense it is where the ray is lowest.
    float low = rise < 0.0 ? radius * sqrt(1.0 - rise * rise) : radius;
    density = dense(max(low - 1.0, 0.0));
    float above_ = at_eye * slant(abs(rise));
    return rise < 0.0 ? max(2.0 * LEVEL * density.x - above_, 0.0) : above_;
}

void main() {
    vec2 slope = slope_of_pixel(), density;
#ifdef HIGH
    vec3 way = way_of_pixel(), q = normalize(way * TO_UNIT);
    float radius = length(eye.xyz), rise = dot(eye.xyz, q) / radius;
    float air = air_along(rise, radius, dense(max(radius - 1.0, 0.0)).x, density);
    vec3 up = normalize(eye.xyz - q * min(rise, 0.0) * radius);
    float near = near_sun(way), height = rise_at(up);
    vec3 thick = skylight(near, height, 1.0), thin = skylight(near, height, 0.0);
#else
    float shorter = inversesqrt(1.0 + dot(slope, slope));
    float near = 0.5 + 0.5 * along_slope(slope, sun_by_axes()) * shorter;
    float rise = along_slope(slope, upright.xyz) * shorter;
    float air = air_along(rise, thick_air[2].w, thick_air[0].w, density);
    vec3 thick = thick_here(near), thin = thin_here(near);
#endif
    // The whole sky is brighter than by single scattering: 2.2 times the air.
    float t1 = exp2(-0.187 * air * zenith.w), t2 = t1 * t1;
    vec3 t = vec3(t1, t2, t2 * t2);
    // Mist fills the lowest air only, and lies along the horizon.
    float mist = exp2(-0.063 * MIST * air * air * density.y * zenith.w);
    vec3 seen = mix(thick, mix(thick, thin, t2) * (1.0 - t), mist);
    float glow = near * near;  // to the power of 512: half at 6 degrees
    glow *= glow; glow *= glow; glow *= glow; glow *= glow;
    glow *= glow; glow *= glow; glow *= glow; glow *= glow;
    float disc = smoothstep(SUN_COSINE - 2e-6, SUN_COSINE + 2e-6, 2.0 * near - 1.0);
    screen = to_screen(seen + t * mist * (SUN * disc + (2.5 - 2.5 * t1 * mist) * glow));
}
