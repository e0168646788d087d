layout(location = 0) out vec4 screen;

float slant(float cosine) {
    // Air above a point towards a direction, relative to straight up: 1 to 38.
    return 1.0 / (cosine + 0.0263 * exp2(-12.0 * cosine));
}

float air_along(vec3 way, out vec3 up) {
    // Air from the eye to infinity, and up where the ray is nearest to the ground.
    float along = -dot(eye.xyz, way);
    vec3 nearest = along > 0.0 ? eye.xyz + way * along : eye.xyz;
    float radius = length(nearest);
    up = nearest / radius;
    float low = max(radius - 1.0, 0.0);
    float density = exp2(-1.442695 * low / SCALE_HEIGHT);
    if (along <= 0.0) return density * slant(-along / radius);
    float eye_radius = length(eye.xyz);
    float eye_density = exp2(-1.442695 * max(eye_radius - 1.0, 0.0) / SCALE_HEIGHT);
    return max(76.0 * density - eye_density * slant(along / eye_radius), 0.0);
}

void main() {
    vec3 way = way_of_pixel();
    vec3 up;
    float air = air_along(normalize(way * TO_UNIT), up);
    // exp(-depth * (1, 2.1, 4.2) * 0.062), with one exp: higher air is bluer than haze.
    float t1 = exp2(-0.0895 * 2.2 * air * zenith.w), t2 = t1 * t1;
    vec3 t = vec3(t1, t2, t2 * t2);
    float day = daylight(up);
    float near_sun = max(dot(way, sun.xyz), 0.0);
    near_sun *= near_sun; near_sun *= near_sun;
    vec3 light = AIR_LIGHT * day + vec3(0.25, 0.2, 0.12) * near_sun * near_sun;
    screen = to_screen(light * (1.0 - t));
}
