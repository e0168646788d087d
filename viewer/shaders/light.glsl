// Air, sun and the way to the screen. Colours are linear; the screen takes their root,
// and textures are squared when read, so an unlit texture comes out as it went in.

const float SCALE_HEIGHT = 8000.0 / EARTH;
const float SHELL = 5.0 * SCALE_HEIGHT;
const vec3 AIR_LIGHT = vec3(0.78, 0.88, 1.0);

vec3 through(float depth) {
    // exp(-depth * (1, 2.1, 4.2) * 0.062), with one exp
    float t = exp2(-0.0895 * depth);
    float t2 = t * t;
    return vec3(t, t2, t2 * t2);
}

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

vec3 hazy(vec3 colour, vec3 seen, vec3 up, float height) {
    float distance_ = length(seen);
    float mu = max(-dot(up, seen) / distance_, 0.0);
    vec3 t = through(air_to(distance_, height, mu) * zenith.w);
    return colour * t + AIR_LIGHT * daylight(up) * (1.0 - t);
}

vec4 to_screen(vec3 colour) {
    vec3 root = sqrt(clamp(colour, 0.0, 1.0));
    float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    return vec4(root + (noise - 0.5) / 255.0, 1.0);
}
