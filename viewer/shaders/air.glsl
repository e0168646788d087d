// Air and sun. Colours are linear.

const float SCALE_HEIGHT = 8000.0 / EARTH;
const float SHELL = 5.0 * SCALE_HEIGHT;
const vec3 AIR_LIGHT = vec3(0.74, 0.85, 0.98);

float daylight(vec3 up) {
    // Never black: the night side stays readable.
    return mix(sun.w, 1.0, smoothstep(-0.45, 0.55, dot(up, sun.xyz)));
}

float relative_air(float height, float other, float length_) {
    // Air between two heights on a straight way of some length, in scale heights.
    float x = (other - height) / SCALE_HEIGHT;
    float mean = abs(x) < 1e-3 ? 1.0 : (1.0 - exp2(-1.442695 * x)) / x;
    return length_ / SCALE_HEIGHT * exp2(-1.442695 * height / SCALE_HEIGHT) * mean;
}

float air_to(float distance_, float height, float mu) {
    // Air between the eye and a point at a height whose up and way to the eye make mu.
    float from_shell = sqrt(mu * mu + 2.0 * SHELL) - mu;
    float way = min(distance_ / EARTH, from_shell);
    float start = distance_ / EARTH > from_shell ? height + SHELL : eye.w / EARTH;
    return relative_air(height, start, way);
}

float hazy(float air) {
    // Steep views are clearer than air alone, level ones hazier: mist lies low. So the
    // ground is clear from above and the horizon melts.
    return air * (0.35 + 0.05 * air + 0.05 * air * air) * zenith.w;
}

float haze_to(vec3 seen, out vec3 up, out float mu) {
    // Haze before a point.
    float distance_ = length(seen);
    vec3 q = eye.xyz + seen * TO_UNIT;
    float inverse = inversesqrt(dot(q, q));
    up = q * inverse;
    mu = max(-dot(up, seen) / max(distance_, 1e-3), 0.0);
    return hazy(air_to(distance_, max(1.0 / inverse - 1.0, 0.0), mu));
}

vec3 clear_through(float haze) {
    float t = exp2(-0.12 * haze);
    return vec3(t, t * t, t * t * t);
}
