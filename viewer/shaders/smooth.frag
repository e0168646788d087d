// Softens the steps of edges: where neighbours differ, a pixel becomes the mean along the
// edge, farther where the edge is nearly level or upright (the idea is FXAA's, Lottes
// 2009). Green stands for lightness.
layout(binding = 0) uniform sampler2D picture_;
uniform vec2 pixel;  // 1 / size

layout(location = 0) out vec4 screen;

const float LEAST = 0.04;
const float FARTHEST = 4.0;

float light_at(ivec2 place) {
    return texelFetch(picture_, place, 0).g;
}

vec3 mean_along(vec2 way) {
    vec2 here = gl_FragCoord.xy * pixel;
    return 0.5 * (textureLod(picture_, here + way * pixel, 0.0).rgb
        + textureLod(picture_, here - way * pixel, 0.0).rgb);
}

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy);
    vec3 own = texelFetch(picture_, here, 0).rgb;
    float a = light_at(here + ivec2(-1, 1)), b = light_at(here + ivec2(1, 1));
    float c = light_at(here + ivec2(-1, -1)), d = light_at(here + ivec2(1, -1));
    float low = min(min(a, b), min(c, d)), high = max(max(a, b), max(c, d));
    float range = max(high, own.g) - min(low, own.g);
    // Along the edge, across the slope of the light.
    vec2 way = vec2(c + d - a - b, b + d - a - c);
    way /= max(min(abs(way.x), abs(way.y)), 0.1 * range + 1e-4);
    vec2 near = 0.5 * normalize(way + 1e-6), far = clamp(0.5 * way, -FARTHEST, FARTHEST);
    vec3 soft = mean_along(near), wide = 0.5 * (soft + mean_along(far));
    // What is neither lighter nor darker than the neighbours is of this edge.
    bool is_of_edge = wide.g >= low && wide.g <= high;
    screen = vec4(range < max(LEAST, 0.1 * high) ? own : is_of_edge ? wide : soft, 1.0);
}
